"""What the compiled kernels compute, as functions of numpy arrays. They hold no lock, so threads run side by side.

The C files lie beside this one; installing the package compiles them. Everything is float32 and the same on every run.
"""

from __future__ import annotations

import ctypes
import importlib.machinery
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from z2p_core.camera import Camera
from z2p_core.threads import over_rows


MOST_LIT = 0xFFFF
"""Points whose numbers fit into shadow maps."""


@dataclass(frozen=True)
class Floor:
    """The floor's square and the light on it, in world units."""

    height: float
    half: float
    """How far it reaches to every side of the origin."""
    lamp: np.ndarray
    """Place (3,) of the light, which shines along its unit axis (3,)."""
    axis: np.ndarray
    power: float
    sky: float
    """Radiance of the sky."""
    albedo: float

    @property
    def numbers(self) -> np.ndarray:
        """The fields (11,) float32 in their order, as the kernels read them."""
        return np.array(
            [self.height, self.half, *self.lamp, *self.axis, self.power, self.sky, self.albedo], np.float32
        )


@lru_cache(maxsize=1)
def library() -> ctypes.CDLL:
    """The compiled kernels.

    Raises:
        ImportError: they were not compiled; the message says how.
    """
    for suffix in importlib.machinery.EXTENSION_SUFFIXES:
        path = Path(__file__).parent / f"kernels{suffix}"
        if path.exists():
            return ctypes.CDLL(str(path))
    raise ImportError(
        f"z2p's compiled kernels are missing beside {__file__}; install a C compiler (Debian: apt-get install gcc "
        "libc6-dev) and z2p again (pip install .)"
    )


def nearest_depth(cloud: np.ndarray, camera: Camera, margin: int) -> np.ndarray:
    """Depth (H + 2 margin, W + 2 margin) of the nearest of points (N, 3) in each pixel, infinity where there is none.

    A point falls into the pixel that holds its projection; `margin` pixels beyond each border are kept.
    """
    height, width = camera.height + 2 * margin, camera.width + 2 * margin
    depths = np.full(height * width + 1, np.inf, np.float32)  # the last takes the points that are not seen
    view = np.concatenate([camera.rotation.ravel(), camera.position])
    _call(
        "z2p_nearest_depth", _floats(cloud), ctypes.c_int64(len(cloud)), _floats(view), ctypes.c_float(camera.focal),
        width, height, margin, depths,
    )  # fmt: skip
    return depths[:-1].reshape(height, width)


def window_minimum(picture: np.ndarray, size: int) -> np.ndarray:
    """Minimum (H - size + 1, W - size + 1) of every size x size window of (H, W)."""
    height, width = picture.shape
    out = np.empty((height - size + 1, width - size + 1), np.float32)
    _call("z2p_window_minimum", _floats(picture), height, width, size, out)
    return out


def intensity(depth: np.ndarray, alpha: float, beta: float, out: np.ndarray) -> None:
    """Draws into `out` (H, W) exp((alpha - depth) / beta) of depths (H, W), whose rows may lie apart; 0 of infinity."""
    if depth.dtype != np.float32 or depth.strides[1] != 4:
        raise ValueError(f"expected float32 depths whose rows are whole, got {depth.dtype}, strides {depth.strides}")
    height, width = depth.shape
    _call(
        "z2p_intensity", depth, ctypes.c_int64(depth.strides[0] // 4), height, width, ctypes.c_float(alpha),
        ctypes.c_float(beta), _place(out, (height, width)),
    )  # fmt: skip


class Grid:
    """A cloud (N, 3), N >= 1, whose points are sorted by place, so that neighbours are found at once.

    Attributes:
        points: (N, 3) float32, in an order that does not depend on the cloud's.
    """

    def __init__(self, cloud: np.ndarray) -> None:
        self.points = np.empty((len(cloud), 3), np.float32)
        self._handle = np.zeros(1, np.uint64)
        _call("z2p_grid", _floats(cloud), len(cloud), self.points, self._handle)

    def __del__(self) -> None:
        if self._handle[0]:
            _call("z2p_grid_free", ctypes.c_void_p(int(self._handle[0])))

    def neighbours(self, asked: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Rows of `points` (M, count) int32, count <= 64, nearest to the points asked for (M,) int32, and spacing (M,).

        A point is its own neighbour, and the last neighbour is repeated where a cloud has fewer. Spacing is the side of
        the square patch of surface that is a point's share, by its 12 nearest points.
        """
        found, spacing = np.empty((len(asked), count), np.int32), np.empty(len(asked), np.float32)
        _call(
            "z2p_neighbours", ctypes.c_void_p(int(self._handle[0])), self.points, asked, len(asked), count, found,
            spacing,
        )  # fmt: skip
        return found, spacing


def planes(points: np.ndarray, found: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Planes through the neighbours found (M, K) among points (N, 3): normals (M, 3), of either sign, and spread (M,).

    Spread is the neighbours' standard deviation off the plane.
    """
    count = len(found)
    normals, spread = np.empty((count, 3), np.float32), np.empty(count, np.float32)
    _call("z2p_planes", points, found, count, found.shape[1], normals, spread)
    return normals, spread


def jets(
    points: np.ndarray, before: np.ndarray, asked: np.ndarray, found: np.ndarray, tolerance: np.ndarray,
    scale: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Normals (M, 3) of curved patches through the neighbours found (M, K) of points asked for (M,), and heights (M,).

    A height is how far the point lies above its patch, along the normal. Those neighbours count most that lie near the
    plane by its normal of `before` (N, 3), within tolerances (M,), that agree with it, and that are near by scale (M,).
    """
    normals, heights = np.empty((len(asked), 3), np.float32), np.empty(len(asked), np.float32)
    _call("z2p_jets", points, before, asked, found, len(asked), found.shape[1], tolerance, scale, normals, heights)
    return normals, heights


def illuminate(
    points: np.ndarray, normals: np.ndarray, lamps: np.ndarray, axes: np.ndarray, powers: np.ndarray,
    spacing: float, radius: float,
) -> np.ndarray:  # fmt: skip
    """Light (2, N) on points (N, 3) with normals: what of lamps (L, 3) that shine along unit axes (L, 3) reaches them.

    A lamp of power p gives p cos cos / distance^2 where the cloud, of that spacing and within `radius` of the origin,
    does not hide it: to the side that the normal points to, row 0, or to the other one.

    Raises:
        ValueError: more points than shadow maps can number.
    """
    if len(points) > MOST_LIT:
        raise ValueError(f"expected at most {MOST_LIT} points to light, got {len(points)}")
    light = np.empty((2, len(points)), np.float32)
    _call(
        "z2p_illuminate", _floats(points), _floats(normals), len(points), _floats(lamps), _floats(axes),
        _floats(powers), len(lamps), ctypes.c_float(spacing), ctypes.c_float(radius), light,
    )  # fmt: skip
    return light


def floor_shade(
    points: np.ndarray, lamps: np.ndarray, weights: np.ndarray, floor: float, half: float, side: int
) -> np.ndarray:
    """Shade (side, side) on a square floor at that height, `half` to each side of the origin; row by row along +Y.

    Each cell has the sum of the weights (L,) of the lamps (L, 3), L <= 64, that points (N, 3) hide from it.
    """
    shade = np.empty((side, side), np.float32)
    _call(
        "z2p_floor_shade", _floats(points), len(points), _floats(lamps), _floats(weights), len(lamps),
        ctypes.c_float(floor), ctypes.c_float(half), side, shade,
    )  # fmt: skip
    return shade


def first_hits(points: np.ndarray, normals: np.ndarray, axes: np.ndarray, spacing: float, radius: float) -> np.ndarray:
    """The point (2 A, N) int32 that each of points (N, 3) sees first along unit axes (A, 3), and against each.

    -1 where the view is free. The cloud has that spacing and lies within `radius` of the origin.
    """
    hits = np.empty((2 * len(axes), len(points)), np.int32)
    _call(
        "z2p_first_hits", _floats(points), _floats(normals), len(points), _floats(axes), len(axes),
        ctypes.c_float(spacing), ctypes.c_float(radius), hits,
    )  # fmt: skip
    return hits


def gather_open(
    points: np.ndarray, normals: np.ndarray, axes: np.ndarray, hits: np.ndarray, direct: np.ndarray, floor: Floor,
    lamp_shade: np.ndarray, sky_shade: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Radiance (2, N) of a white diffuse cloud under lamps, sky and the floor that they light, on both sides.

    `direct` (2, N) is what comes straight from the lamps, as a radiance; `hits` those of `first_hits`; the shades
    (S, S) those of `floor_shade`.
    """
    light, count = np.array(direct, np.float32), len(points)
    given = (_floats(points), _floats(normals), count), (
        _floats(axes), len(axes), hits, floor.numbers, _floats(lamp_shade), _floats(sky_shade), len(sky_shade), light,
    )  # fmt: skip
    over_rows(lambda begin, end: _call("z2p_gather_open", *given[0], begin, end, *given[1]), count)
    return light


def gather_bounced(
    points: np.ndarray, normals: np.ndarray, axes: np.ndarray, hits: np.ndarray, light: np.ndarray, floor: Floor,
    glow: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Radiance (2, N) that white diffuse points get from each other, and once more from the floor that they light.

    `light` (2, N) is what they send back on both sides; `hits` those of `first_hits`; `glow` (G, G) that light's
    `floor_glow`. Of points with an albedo it is so much for each time that the cloud sent it on.
    """
    bounced, count = np.empty((2, len(points)), np.float32), len(points)
    given = (_floats(points), _floats(normals), count), (
        _floats(axes), len(axes), hits, floor.numbers, _floats(glow), len(glow), _floats(light), bounced,
    )  # fmt: skip
    over_rows(lambda begin, end: _call("z2p_gather_bounced", *given[0], begin, end, *given[1]), count)
    return bounced


def floor_glow(
    points: np.ndarray, normals: np.ndarray, light: np.ndarray, axes: np.ndarray, weights: np.ndarray, floor: Floor,
    side: int,
) -> np.ndarray:  # fmt: skip
    """What the floor's cells (side, side) see of the cloud, as the radiance of a white floor.

    `light` (2, N) is the cloud's radiance on both sides; unit axes (A, 3) go up, their weights (A,) sum to 1.
    """
    glow = np.empty((side, side), np.float32)
    _call(
        "z2p_floor_glow", _floats(points), _floats(normals), _floats(light), len(points), _floats(axes),
        _floats(weights), len(axes), ctypes.c_float(floor.height), ctypes.c_float(floor.half), side, glow,
    )  # fmt: skip
    return glow


def floor_shadow(
    lamp_shade: np.ndarray, sky_shade: np.ndarray, glow: np.ndarray, floor: Floor, camera: Camera, out: np.ndarray
) -> None:
    """Draws into `out` (H, W) the alpha of the shadow on the floor as the camera sees it, 0 above the horizon.

    The shades (S, S) are those of `floor_shade` for the lamp and for the sky, the glow (G, G) that of `floor_glow`.
    """
    _call(
        "z2p_floor_shadow", _floats(lamp_shade), _floats(sky_shade), len(sky_shade), _floats(glow), len(glow),
        floor.numbers, _floats(camera.rotation), _floats(camera.position), ctypes.c_float(camera.focal), camera.width,
        camera.height, _place(out, (camera.height, camera.width)),
    )  # fmt: skip


def surfels(
    points: np.ndarray, normals: np.ndarray, radii: np.ndarray, features: np.ndarray, camera: Camera,
    slack: float, sure: float, full: float, near: float, far: float, out: np.ndarray,
    rows: tuple[int, int] | None = None,
) -> None:  # fmt: skip
    """Draws discs into `out` (9, H, W), 0 at first: coverage, density, depth and six features; 0 off the discs.

    Points (N, 3) and normals (N, 3) are in the camera's axes, the normals facing it; features are (N, 6). Where discs
    overlap, those at most `slack` of their radius behind the nearest are averaged, by weights w that fall from 1 to 0
    towards a disc's rim. Of their sum w, coverage is 1 - exp(-sure w) and density is w / full, up to 1; depth goes from
    1 at `near` to 0 at `far`. Only `rows` from the first up to the last, that one excluded, are drawn.
    """
    first, last = rows or (0, camera.height)
    _call(
        "z2p_surfels", _floats(points), _floats(normals), _floats(radii), _floats(features), len(points),
        ctypes.c_float(camera.focal), camera.width, camera.height, first, last, ctypes.c_float(slack),
        ctypes.c_float(sure), ctypes.c_float(full), ctypes.c_float(near), ctypes.c_float(far),
        _place(out, (9, camera.height, camera.width)),
    )  # fmt: skip


def straight_bytes(picture: np.ndarray) -> np.ndarray:
    """Straight RGBA (H, W, 4) uint8 of colour times alpha, and alpha (4, H, W); clipped, colour 0 where alpha is."""
    _, height, width = picture.shape
    out = np.empty((height, width, 4), np.uint8)
    _call("z2p_straight_bytes", _floats(picture), ctypes.c_int64(height * width), out)
    return out


def _call(name: str, *arguments: Any) -> None:
    given = [x.ctypes.data_as(ctypes.c_void_p) if isinstance(x, np.ndarray) else x for x in arguments]
    kernel = getattr(library(), name, None)
    if kernel is None:
        raise ImportError(f"z2p's compiled kernels are older than its code: {name} is missing; install z2p again")
    if not kernel(*given):
        raise MemoryError(f"{name}: not enough memory")


def _place(out: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """`out` itself, once it is sure that a kernel may write there."""
    if out.shape != shape or out.dtype != np.float32 or not out.flags.c_contiguous:
        raise ValueError(f"expected a contiguous float32 array {shape} to draw into, got {out.dtype} {out.shape}")
    return out


def _floats(array: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(array, dtype=np.float32)
