"""Screen-space depth filling with deferred shading: neither normals nor a mesh are reconstructed in 3D.

After Pintus, Gobbetti and Agus: Real-Time Rendering of Massive Unstructured Raw Point Clouds using Screen-Space
Operators, VAST 2011. Points are projected to pixels; points behind others that nearly surround them are removed; the
depth between the rest is filled in and smoothed; normals are the depth's, and are lit by the light's center and the
sky. There are no shadows.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from z2p_core import native
from z2p_core.camera import DISTANCE, Camera, light_position
from z2p_core.images import srgb_from_linear
from z2p_core.interfaces import Painter, ScanError
from z2p_core.scene import AMBIENT, DEFAULT_BASE_COLOR, LIGHT_RADIANCE, LIGHT_SIDE, SceneDescription

SECTORS = 8
"""Sectors of the image around a pixel in which the visibility test looks for occluders."""
MIN_OPENNESS = 0.6
"""Least openness of a visible point, in radians: the mean over the sectors of the angle between the direction to the
viewer and that to the nearest occluder."""
WINDOW_RADIUS_SPACINGS = 3.0
"""Radius of the window in which occluders and neighbors are looked for, in spacings on the screen."""
WINDOW_RADIUS_LIMITS = (2, 12)
"""Its limits, in pixels."""
SMOOTHING_ROUNDS = 3.0
"""Rounds of smoothing after gaps are filled, for each pixel of the square of half a spacing."""
MAX_DEPTH_STEP_SPACINGS = 2.5
"""Largest difference of neighboring depths that are averaged, in spacings."""
MIN_GROWTH = 1.25
"""Growth of the covered area in one dilation, below which gaps between points count as closed."""


class ScreenSpace(Painter):
    """An image with Lambertian shading under the light and the sky."""

    name = "screen"
    version = "1"

    def paint(self, cloud: np.ndarray, camera: Camera, scene: SceneDescription) -> np.ndarray:
        """Image (H, W, 4) float32 in [0, 1], straight sRGB RGBA; alpha is 0 or 1.

        Raises:
            ScanError: no point is in the picture.
        """
        depth, _ = self._find_surface(cloud, camera)
        base = scene.material.get("Base Color", DEFAULT_BASE_COLOR)
        color = np.array(base[:3] if isinstance(base, tuple) else (base,) * 3)
        with self.timed("shade"):
            return _shade(depth, color, camera, scene)

    def paint_colored(
        self, cloud: np.ndarray, albedo: np.ndarray, camera: Camera, scene: SceneDescription
    ) -> np.ndarray:
        """The same image in the colors of the visible points, which are interpolated in the picture as depth is."""
        depth, visible = self._find_surface(cloud, camera)
        with self.timed("shade"):
            colors = _pixel_colors(cloud, albedo, visible, camera)
            return _shade(depth, colors, camera, scene)

    def _find_surface(self, cloud: np.ndarray, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
        """Depth (H, W) of the surface, filled in and smoothed, and of the visible points; infinity elsewhere."""
        with self.timed("project"):
            depth = _nearest_depth(cloud, camera)
        if not np.isfinite(depth).any():
            raise ScanError(f"expected points before the camera, got {len(cloud)} of which none is in the picture")
        with self.timed("visibility"):
            spacing = _pixel_spacing(depth)
            least, most = WINDOW_RADIUS_LIMITS
            radius = min(most, max(least, math.ceil(WINDOW_RADIUS_SPACINGS * spacing)))
            visible = np.where(_openness(depth, camera, radius) >= MIN_OPENNESS, depth, np.inf)
        with self.timed("fill"):
            max_step = MAX_DEPTH_STEP_SPACINGS * spacing / camera.focal * DISTANCE
            return _fill_and_smooth(visible, radius, spacing, max_step), visible


def _nearest_depth(cloud: np.ndarray, camera: Camera) -> np.ndarray:
    """Depth (H, W) of the nearest point in each pixel, infinity where there is none."""
    row, column, depths, _ = _project(cloud, camera)
    nearest = np.full((camera.height, camera.width), np.inf)
    np.minimum.at(nearest, (row, column), depths)
    return nearest


def _pixel_colors(cloud: np.ndarray, albedo: np.ndarray, visible: np.ndarray, camera: Camera) -> np.ndarray:
    """Colors (H, W, 3) of the points at the visible depths (H, W), and between them means of those around."""
    row, column, depths, index = _project(cloud, camera)
    is_nearest = depths == visible[row, column]
    height, width = visible.shape
    colors, known = np.zeros((3, height, width), np.float32), np.isfinite(visible)
    colors[:, row[is_nearest], column[is_nearest]] = albedo[index[is_nearest]].T
    around = native.extend_halved(colors, known.astype(np.float32)).repeat(2, axis=1).repeat(2, axis=2)
    return np.moveaxis(np.where(known, colors, around[:, :height, :width]), 0, 2)


def _project(cloud: np.ndarray, camera: Camera) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Row, column and depth (M,) of the points of a cloud that are in the picture, and their indices in the cloud."""
    pixels, depths = camera.project(np.asarray(cloud, np.float64))
    column, row = np.floor(pixels).astype(int).T
    inside = (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height) & (depths > 0)
    return row[inside], column[inside], depths[inside], np.flatnonzero(inside)


def _pixel_spacing(depth: np.ndarray) -> float:
    """Distance between points in pixels: the side of a point's share of the area that they cover, with gaps closed."""
    valid = np.isfinite(depth)
    grown, area_before = valid, 0
    while grown.sum() > MIN_GROWTH * area_before and grown.sum() < grown.size:
        area_before, grown = int(grown.sum()), _dilate(grown, 1)
    return math.sqrt(grown.sum() / valid.sum())


def _openness(depth: np.ndarray, camera: Camera, radius: int) -> np.ndarray:
    """Openness (H, W) of each pixel's point, radians: see `MIN_OPENNESS`. Occluders are looked for within a radius."""
    column, row = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    rays = np.stack([(column - camera.width / 2) / camera.focal, (row - camera.height / 2) / camera.focal,
                     np.ones_like(row)], -1)  # fmt: skip
    positions = rays * np.where(np.isfinite(depth), depth, 0)[..., None]
    view = -rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    nearest_cosine = np.full((SECTORS, *depth.shape), -1.0)  # of the angle to the nearest occluder
    for down, right in _window_steps(radius):
        offset = _shift(positions, down, right) - positions
        length = np.linalg.norm(offset, axis=-1)
        is_known = np.isfinite(_shift(depth, down, right, np.inf)) & (length > 0)
        cosine = np.where(is_known, (offset * view).sum(-1) / np.maximum(length, 1e-9), -1)
        sector = int((math.atan2(down, right) + math.pi) / (2 * math.pi) * SECTORS) % SECTORS
        np.maximum(nearest_cosine[sector], cosine, out=nearest_cosine[sector])
    return np.minimum(np.arccos(np.clip(nearest_cosine, -1, 1)), math.pi / 2).mean(0)


def _fill_and_smooth(depth: np.ndarray, radius: int, spacing: float, max_step: float) -> np.ndarray:
    """The depth with gaps of about `radius` pixels filled, smoothed within `max_step`; infinity beyond the outline."""
    valid = np.isfinite(depth)
    inside = ~_dilate(~_dilate(valid, radius // 2 + 1), radius // 2 + 1, True)
    filled = depth
    for _ in range(4 * radius):
        missing = inside & ~np.isfinite(filled)
        if not missing.any():
            break
        filled = np.where(missing, _average_neighbors(filled, np.inf), filled)
    for _ in range(2 + round(SMOOTHING_ROUNDS * (spacing / 2) ** 2)):
        filled = np.where(inside & np.isfinite(filled), _average_neighbors(filled, max_step), np.inf)
    return filled


def _average_neighbors(depth: np.ndarray, max_step: float) -> np.ndarray:
    """Mean (H, W) of each pixel and its eight neighbors: of those that are known and differ by at most `max_step`."""
    total, weight = np.zeros_like(depth), np.zeros_like(depth)
    for down, right in ((0, 0), *_window_steps(1)):
        neighbor = _shift(depth, down, right, np.inf)
        with np.errstate(invalid="ignore"):
            counts = np.isfinite(neighbor) & ((max_step == np.inf) | (np.abs(neighbor - depth) <= max_step))
        share = 1 / (1 + abs(down) + abs(right))
        total += np.where(counts, share * np.where(counts, neighbor, 0), 0)
        weight += share * counts
    return np.where(weight > 0, total / np.maximum(weight, 1e-9), np.inf)


def _shade(depth: np.ndarray, color: np.ndarray, camera: Camera, scene: SceneDescription) -> np.ndarray:
    """Image (H, W, 4) float32 under the light's center and the sky, without shadows; `color` (..., 3) is linear."""
    inside = np.isfinite(depth)
    column, row = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    z = np.where(inside, depth, 0)
    positions = np.stack([(column - camera.width / 2) / camera.focal * z,
                          (row - camera.height / 2) / camera.focal * z, z], -1)  # fmt: skip
    normals = np.cross(_difference(positions, inside, 0, 1), _difference(positions, inside, 1, 0))
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-12)
    normals *= -np.sign((normals * positions).sum(-1, keepdims=True))
    world, normals = positions @ camera.rotation + camera.position, normals @ camera.rotation
    light = light_position(scene.light)
    to_light = light - world
    distance = np.linalg.norm(to_light, axis=-1)
    n_dot_l = np.maximum((normals * to_light).sum(-1) / distance, 0)
    cos_light = np.maximum((to_light @ light) / (distance * np.linalg.norm(light)), 0)
    radiance = LIGHT_RADIANCE * LIGHT_SIDE**2 * n_dot_l * cos_light / distance**2 / math.pi
    shaded = srgb_from_linear(np.clip((radiance + AMBIENT)[..., None] * color, 0, 1))
    return np.dstack([np.where(inside[..., None], shaded, 0), inside]).astype(np.float32)


def _difference(positions: np.ndarray, inside: np.ndarray, down: int, right: int) -> np.ndarray:
    """Difference (H, W, 3) to the next position in one direction, or from the previous one where that is nearer."""
    forward, backward = _shift(positions, down, right) - positions, positions - _shift(positions, -down, -right)
    has_next, has_previous = (_shift(inside, sign * down, sign * right, False) for sign in (1, -1))
    is_shorter = (forward**2).sum(-1) <= (backward**2).sum(-1)
    use_forward = has_next & (is_shorter | ~has_previous)
    return np.where(use_forward[..., None], forward, np.where(has_previous[..., None], backward, 0))


def _dilate(mask: np.ndarray, radius: int, outside: bool = False) -> np.ndarray:
    """Mask (H, W) dilated by a square of that radius; `outside` is its value beyond the image."""
    rows = mask.copy()
    for step in range(1, radius + 1):
        rows |= _shift(mask, 0, step, outside) | _shift(mask, 0, -step, outside)
    square = rows.copy()
    for step in range(1, radius + 1):
        square |= _shift(rows, step, 0, outside) | _shift(rows, -step, 0, outside)
    return square


def _shift(values: np.ndarray, down: int, right: int, outside: float | bool = 0) -> np.ndarray:
    """Values whose entry (row, column) is the given (row + down, column + right); `outside` where there is none."""
    shifted = np.full_like(values, outside)
    height, width = values.shape[:2]
    rows, columns = slice(max(down, 0), height + min(down, 0)), slice(max(right, 0), width + min(right, 0))
    to_rows, to_columns = slice(max(-down, 0), height + min(-down, 0)), slice(max(-right, 0), width + min(-right, 0))
    shifted[to_rows, to_columns] = values[rows, columns]
    return shifted


def _window_steps(radius: int) -> Iterator[tuple[int, int]]:
    """Steps (down, right) to the other pixels of a square window of that radius."""
    span = range(-radius, radius + 1)
    yield from ((down, right) for down in span for right in span if down or right)
