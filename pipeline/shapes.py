"""Meshes that the project makes itself, so that the pipeline runs before anybody has a mesh of their own.

Each is a parametric surface over a grid of u and v, both in [0, 1]; seams and poles are welded afterwards. Between
them they have what clouds are hard for: thin walls, holes, creases, an open rim, flat facets, inner surfaces.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from z2p_renderer.pipeline.render import export_suzanne
from z2p_renderer.storage.meshes import write_mesh

SUZANNE = "suzanne"
TRAINING_SHAPES = ("torus_knot", "rounded_block", "wavy_sheet", "seashell", "gear", "vase", SUZANNE)
VALIDATION_SHAPES = ("bumpy_ball", "klein_bottle")
"""Kept aside from training."""

Surface = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]
TURN = 2 * np.pi


def make_shapes(out: Path, suzanne: bool = True) -> list[Path]:
    """A PLY mesh in `out` for each training and validation shape, at `shape_path`; the same bytes every time.

    Suzanne comes from Blender, a child process of some seconds; the others need numpy alone.

    Raises:
        RenderError: Blender did not deliver Suzanne.
    """
    out.mkdir(parents=True, exist_ok=True)
    paths = []
    for name in (*TRAINING_SHAPES, *VALIDATION_SHAPES):
        if name == SUZANNE and not suzanne:
            continue
        write_mesh(shape_path(out, name), *(_suzanne(out) if name == SUZANNE else shape(name)))
        paths.append(shape_path(out, name))
    return paths


def shape_path(folder: Path, name: str) -> Path:
    """Where `make_shapes` puts a shape."""
    return folder / f"{name}.ply"


def shape(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) float64 and triangles (M, 3) int64 of a parametric shape, +Z up.

    Raises:
        ValueError: no such shape.
    """
    if name not in _SURFACES:
        raise ValueError(f"unknown shape {name!r}; parametric shapes: {', '.join(_SURFACES)}")
    surface, columns, rows = _SURFACES[name]
    u, v = np.meshgrid(np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1), indexing="ij")
    vertices = np.stack(np.broadcast_arrays(*surface(u, v)), axis=-1).reshape(-1, 3)
    corner = (np.arange(columns)[:, None] * (rows + 1) + np.arange(rows)).ravel()
    quads = np.stack([corner, corner + rows + 1, corner + rows + 2, corner + 1], axis=1)
    return _weld(vertices, np.vstack([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]))


def torus_knot(u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A tube along the (2, 3) torus knot."""

    def curve(at: np.ndarray) -> np.ndarray:
        radius = 2 + np.cos(3 * at)
        return np.stack([radius * np.cos(2 * at), radius * np.sin(2 * at), np.sin(3 * at)], axis=-1)

    along, step = TURN * u, 1e-3
    tangent = curve(along + step) - curve(along - step)
    outward = curve(along + step) + curve(along - step) - 2 * curve(along)  # where the curve bends to
    across = np.cross(tangent, outward)
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    normal = np.cross(across, tangent)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    angle = TURN * v[..., None]
    x, y, z = np.moveaxis(curve(along) + 0.45 * (np.cos(angle) * normal + np.sin(angle) * across), -1, 0)
    return x, y, z


def rounded_block(u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A superquadric: a block with rounded edges and corners."""

    def bent(wave: np.ndarray) -> np.ndarray:
        wave = np.round(wave, 9)  # the power would blow the last digit of sin(pi) up to a gap in the seam
        return np.sign(wave) * np.abs(wave) ** 0.3

    longitude, latitude = TURN * u, np.pi * (v - 0.5)
    ring = bent(np.cos(latitude))
    return 1.2 * ring * bent(np.cos(longitude)), ring * bent(np.sin(longitude)), 0.7 * bent(np.sin(latitude))


def wavy_sheet(u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A square sheet with waves, open at its rim and without thickness."""
    x, y = 2 * u - 1, 2 * v - 1
    return x, y, 0.18 * np.sin(5 * x + 1) * np.cos(4 * y) + 0.12 * x * y


def seashell(u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A tube that grows along a conical spiral, open at its mouth."""
    growth = np.exp(0.32 * 6 * (u - 1))
    angle, around = 3.2 * TURN * u, TURN * v
    ridges = 1 + 0.04 * np.cos(40 * np.pi * u)
    ring = growth * (1 + 0.78 * ridges * np.cos(around))
    return ring * np.cos(angle), ring * np.sin(angle), growth * (0.78 * ridges * np.sin(around) - 2.4) + 2.4


def gear(u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A gear wheel of sixteen teeth with a hole: flat sides that meet at sharp edges."""
    angle = TURN * u
    outer = 0.86 + 0.14 * np.clip(1.6 * np.sin(16 * angle), -1, 1)
    corners = np.linspace(0, 1, 5)  # inner bottom, outer bottom, outer top, inner top, inner bottom
    reach = np.interp(v, corners, [0.0, 1.0, 1.0, 0.0, 0.0])
    ring = 0.35 + (outer - 0.35) * reach
    return ring * np.cos(angle), ring * np.sin(angle), np.interp(v, corners, [-0.2, -0.2, 0.2, 0.2, -0.2])


def vase(u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A hollow vase with a thin wall: up the outside, over the lip, down the inside."""
    height = np.interp(v, [0, 0.1, 0.5, 0.55, 0.9, 1], [0, 0, 1, 1, 0.06, 0.06])
    outside = 0.3 + 0.22 * np.sin(4.6 * height + 0.3) * (1 - 0.3 * height)
    inset = 0.035 * np.interp(v, [0.5, 0.55], [0, 1])
    closed = np.interp(v, [0, 0.1, 0.9, 1], [0, 1, 1, 0])  # to a point at both ends: foot and inner bottom
    ring = closed * (outside - inset)
    return ring * np.cos(TURN * u), ring * np.sin(TURN * u), 1.4 * height


def bumpy_ball(u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A sphere swollen by two spherical harmonics, of degrees 4 and 9."""
    longitude, polar = TURN * u, np.pi * v
    sin, cos = np.sin(polar), np.cos(polar)
    radius = 1 + 0.45 * sin**3 * cos * np.cos(3 * longitude) + 0.08 * sin**9 * np.cos(9 * longitude)
    return radius * sin * np.cos(longitude), radius * sin * np.sin(longitude), -radius * cos


def klein_bottle(u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Klein's bottle, standing: a tube through its own wall, neither inside nor outside."""
    along, around = TURN * u, TURN * v
    radius = 4 * (1 - np.cos(along) / 2)
    below = along < np.pi
    x = 6 * np.cos(along) * (1 + np.sin(along)) + radius * np.cos(around) * np.where(below, np.cos(along), -1)
    z = 16 * np.sin(along) + np.where(below, radius * np.sin(along) * np.cos(around), 0)
    return x, radius * np.sin(around), z


_SURFACES: dict[str, tuple[Surface, int, int]] = {
    "torus_knot": (torus_knot, 160, 20),
    "rounded_block": (rounded_block, 64, 40),
    "wavy_sheet": (wavy_sheet, 40, 40),
    "seashell": (seashell, 140, 24),
    "gear": (gear, 192, 8),
    "vase": (vase, 48, 60),
    "bumpy_ball": (bumpy_ball, 72, 44),
    "klein_bottle": (klein_bottle, 96, 32),
}
"""Shape -> its surface, and into how many cells u and v are cut."""


def _weld(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The surface with vertices at one place joined and triangles without area left out.

    Rounding to 1e-6 closes the seams, and makes the bytes the same on machines whose sines differ in the last digit.
    """
    rounded = np.round(vertices, 6) + 0.0  # no -0.0
    places, which = np.unique(rounded, axis=0, return_inverse=True)
    faces = which.reshape(-1)[faces]
    a, b, c = faces.T
    return places, faces[(a != b) & (b != c) & (c != a)]


def _suzanne(out: Path) -> tuple[np.ndarray, np.ndarray]:
    """Blender's monkey as vertices and triangles; her ears point to +X and -X, she looks to -Y."""
    path = out / ".suzanne.npz"
    export_suzanne(path)
    with np.load(path, allow_pickle=False) as stored:
        vertices, faces = stored["vertices"].astype(np.float64), stored["faces"].astype(np.int64)
    path.unlink()
    return vertices, faces
