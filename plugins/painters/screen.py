"""Depth filled in on the screen, with deferred shading (after Pintus, Gobbetti, Agus, VAST 2011): no normals, no mesh.

Points fall into pixels; those that others in front hem in are dropped; the depth between the rest is filled in and
smoothed; normals come from the depth, and the light's place shades them. Shadows are beyond it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from z2p_core.camera import DISTANCE, Camera, light_position
from z2p_core.images import srgb_from_linear
from z2p_core.interfaces import Painter, ScanError
from z2p_core.scene import AMBIENT, LIGHT_RADIANCE, LIGHT_SIDE, SceneDescription

SECTORS = 8
OPEN = 0.6
"""Mean angle, radians, between the way to the viewer and the nearest obstacle in a sector; hidden points have less."""
REACH = 3.0
"""Of the window that points are looked for in, in spacings on the screen."""
SMOOTHING = 3.0
"""Rounds of smoothing for each pixel of the square of half a spacing, after the gaps are closed."""
STEP = 2.5
"""Depths of neighbours farther apart than so many spacings do not blend."""


class ScreenSpace(Painter):
    """A picture with Lambert's shading under the light and the sky."""

    name = "screen"
    version = "1"

    def paint(self, cloud: np.ndarray, camera: Camera, scene: SceneDescription) -> np.ndarray:
        """Picture (H, W, 4) float32 in [0, 1], straight sRGB RGBA; alpha is 0 or 1.

        Raises:
            ScanError: no point is in the picture.
        """
        with self.timed("project"):
            depth = _nearest(cloud, camera)
        if not np.isfinite(depth).any():
            raise ScanError(f"expected points before the camera, got {len(cloud)} of which none is in the picture")
        with self.timed("visibility"):
            spacing = _spacing(depth)
            reach = min(12, max(2, math.ceil(REACH * spacing)))
            depth = np.where(_openness(depth, camera, reach) >= OPEN, depth, np.inf)
        with self.timed("fill"):
            depth = _filled(depth, reach, spacing, STEP * spacing / camera.focal * DISTANCE)
        with self.timed("shade"):
            return _shaded(depth, camera, scene)


def _nearest(cloud: np.ndarray, camera: Camera) -> np.ndarray:
    """Depth (H, W) of the nearest point in each pixel, infinity where there is none."""
    pixels, depth = camera.project(np.asarray(cloud, np.float64))
    column, row = np.floor(pixels).astype(int).T
    seen = (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height) & (depth > 0)
    picture = np.full((camera.height, camera.width), np.inf)
    np.minimum.at(picture, (row[seen], column[seen]), depth[seen])
    return picture


def _spacing(depth: np.ndarray) -> float:
    """Pixels between points: the side of a point's share of the area that they cover, grown until it hardly grows."""
    valid = np.isfinite(depth)
    grown, before = valid, 0
    while grown.sum() > 1.25 * before and grown.sum() < grown.size:
        before, grown = int(grown.sum()), _spread(grown, 1)
    return math.sqrt(grown.sum() / valid.sum())


def _openness(depth: np.ndarray, camera: Camera, reach: int) -> np.ndarray:
    """Mean (H, W) over the sectors of the angle, radians, that each point sees free around the way to the viewer."""
    column, row = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    rays = np.stack([(column - camera.width / 2) / camera.focal, (row - camera.height / 2) / camera.focal,
                     np.ones_like(row)], -1)  # fmt: skip
    places = rays * np.where(np.isfinite(depth), depth, 0)[..., None]
    back = -rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    nearest = np.full((SECTORS, *depth.shape), -1.0)  # cosine of the angle to the nearest obstacle
    for down, right in _window(reach):
        towards = _moved(places, down, right) - places
        length = np.linalg.norm(towards, axis=-1)
        known = np.isfinite(_moved(depth, down, right, np.inf)) & (length > 0)
        cosine = np.where(known, (towards * back).sum(-1) / np.maximum(length, 1e-9), -1)
        sector = int((math.atan2(down, right) + math.pi) / (2 * math.pi) * SECTORS) % SECTORS
        np.maximum(nearest[sector], cosine, out=nearest[sector])
    return np.minimum(np.arccos(np.clip(nearest, -1, 1)), math.pi / 2).mean(0)


def _filled(depth: np.ndarray, reach: int, spacing: float, step: float) -> np.ndarray:
    """The depth with gaps of about `reach` pixels closed, smoothed within `step`; infinity beyond the outline."""
    valid = np.isfinite(depth)
    inside = ~_spread(~_spread(valid, reach // 2 + 1), reach // 2 + 1, True)
    filled = depth
    for _ in range(4 * reach):
        wanted = inside & ~np.isfinite(filled)
        if not wanted.any():
            break
        filled = np.where(wanted, _blended(filled, np.inf), filled)
    for _ in range(2 + round(SMOOTHING * (spacing / 2) ** 2)):
        filled = np.where(inside & np.isfinite(filled), _blended(filled, step), np.inf)
    return filled


def _blended(depth: np.ndarray, step: float) -> np.ndarray:
    """Mean (H, W) of a pixel and its eight neighbours, of those that are known and at most `step` away from it."""
    total, weight = np.zeros_like(depth), np.zeros_like(depth)
    for down, right in ((0, 0), *_window(1)):
        there = _moved(depth, down, right, np.inf)
        with np.errstate(invalid="ignore"):
            counts = np.isfinite(there) & ((step == np.inf) | (np.abs(there - depth) <= step))
        share = 1 / (1 + abs(down) + abs(right))
        total += np.where(counts, share * np.where(counts, there, 0), 0)
        weight += share * counts
    return np.where(weight > 0, total / np.maximum(weight, 1e-9), np.inf)


def _shaded(depth: np.ndarray, camera: Camera, scene: SceneDescription) -> np.ndarray:
    """Picture (H, W, 4) float32 under the light's centre and the sky, without shadows."""
    inside = np.isfinite(depth)
    column, row = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    flat = np.where(inside, depth, 0)
    places = np.stack([(column - camera.width / 2) / camera.focal * flat,
                       (row - camera.height / 2) / camera.focal * flat, flat], -1)  # fmt: skip
    normals = np.cross(_slope(places, inside, 0, 1), _slope(places, inside, 1, 0))
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-12)
    normals *= -np.sign((normals * places).sum(-1, keepdims=True))
    world, normals = places @ camera.rotation + camera.position, normals @ camera.rotation
    lamp = light_position(scene.light)
    towards = lamp - world
    distance = np.linalg.norm(towards, axis=-1)
    facing = np.maximum((normals * towards).sum(-1) / distance, 0)
    leaving = np.maximum((towards @ lamp) / (distance * np.linalg.norm(lamp)), 0)
    light = LIGHT_RADIANCE * LIGHT_SIDE**2 * facing * leaving / distance**2 / math.pi
    base = scene.material.get("Base Color", (0.8, 0.8, 0.8, 1.0))
    color = np.array(base[:3] if isinstance(base, tuple) else (base,) * 3)
    shaded = srgb_from_linear(np.clip((light + AMBIENT)[..., None] * color, 0, 1))
    return np.dstack([np.where(inside[..., None], shaded, 0), inside]).astype(np.float32)


def _slope(places: np.ndarray, inside: np.ndarray, down: int, right: int) -> np.ndarray:
    """Difference (H, W, 3) to the next place in one direction, or from the one before where that is nearer."""
    ahead, behind = _moved(places, down, right) - places, places - _moved(places, -down, -right)
    known_ahead, known_behind = (_moved(inside, sign * down, sign * right, False) for sign in (1, -1))
    shorter = (ahead**2).sum(-1) <= (behind**2).sum(-1)
    use_ahead = known_ahead & (shorter | ~known_behind)
    return np.where(use_ahead[..., None], ahead, np.where(known_behind[..., None], behind, 0))


def _spread(mask: np.ndarray, radius: int, beyond: bool = False) -> np.ndarray:
    """Mask (H, W) grown by a square of that radius; `beyond` says whether it holds outside of the picture."""
    grown = mask.copy()
    for step in range(1, radius + 1):
        grown |= _moved(mask, 0, step, beyond) | _moved(mask, 0, -step, beyond)
    rows = grown.copy()
    for step in range(1, radius + 1):
        grown |= _moved(rows, step, 0, beyond) | _moved(rows, -step, 0, beyond)
    return grown


def _moved(picture: np.ndarray, down: int, right: int, beyond: float | bool = 0) -> np.ndarray:
    """The picture whose pixel (row, column) is the given one's (row + down, column + right)."""
    out = np.full_like(picture, beyond)
    height, width = picture.shape[:2]
    rows, columns = slice(max(down, 0), height + min(down, 0)), slice(max(right, 0), width + min(right, 0))
    to_rows, to_columns = slice(max(-down, 0), height + min(-down, 0)), slice(max(-right, 0), width + min(-right, 0))
    out[to_rows, to_columns] = picture[rows, columns]
    return out


def _window(reach: int) -> Iterator[tuple[int, int]]:
    """Steps (down, right) to the other pixels of a window."""
    span = range(-reach, reach + 1)
    yield from ((down, right) for down in span for right in span if down or right)
