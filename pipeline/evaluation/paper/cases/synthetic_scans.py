"""Clouds that samplers do not give: non-uniform density, points inside the mesh, simulated depth cameras."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from z2p_core.camera import DISTANCE, FIELD_OF_VIEW, turn
from z2p_core.errors.missing_system_libraries import explain_missing_libraries
from z2p_core.interfaces import ScanError
from z2p_core.meshes.triangle_sampling import sample_uniform
from z2p_renderer.storage.meshes import Mesh

DENSITY_RATIO = 10.0
"""Density of the densest side of a non-uniform cloud, relative to the sparsest."""
SENSOR_AZIMUTH = 40.0
"""Azimuth of the depth camera relative to the picture's camera, degrees."""
SENSOR_SIDE = 160
"""Side of the depth camera's image, pixels."""
SENSOR_NOISE = 0.004
"""Standard deviation of depth along the ray, world units."""
MIN_SENSOR_COSINE = 0.25
"""Smallest cosine between ray and normal at which the camera with holes still measures."""
HOLE_COUNT = 8
HOLE_RADIUS = 0.12
"""Radius of a hole without measurements, world units."""
MAX_REJECTION_ROUNDS = 60


def non_uniform(mesh: Mesh, count: int, rng: np.random.Generator) -> np.ndarray:
    """Points (count, 3) float64 on a mesh, `DENSITY_RATIO` times as dense at its +X end as at its -X end."""
    parts: list[np.ndarray] = []
    while sum(map(len, parts)) < count:
        points = sample_uniform(mesh.vertices, mesh.faces, 4 * count, rng)
        low, high = points[:, 0].min(), points[:, 0].max()
        share = DENSITY_RATIO ** ((points[:, 0] - low) / max(high - low, 1e-9) - 1)
        parts.append(points[rng.random(len(points)) < share])
    return np.concatenate(parts)[:count]


def inner_points(mesh: Mesh, count: int, rng: np.random.Generator) -> np.ndarray:
    """Points (count, 3) float64 inside a mesh, as generative networks produce them.

    A mesh that encloses almost no volume, like an open sheet, gets points between random pairs of surface points.
    """
    with explain_missing_libraries("open3d"):
        import open3d  # late: the pipeline extra

    if count == 0:
        return np.empty((0, 3))
    scene = _ray_scene(mesh)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    parts: list[np.ndarray] = []
    for _ in range(MAX_REJECTION_ROUNDS):
        candidates = rng.uniform(low, high, (4 * count, 3))
        inside = scene.compute_occupancy(
            open3d.core.Tensor.from_numpy(candidates.astype(np.float32)), nsamples=5
        ).numpy()
        parts.append(candidates[inside > 0.5])
        if sum(map(len, parts)) >= count:
            return np.concatenate(parts)[:count]
    first, second = (sample_uniform(mesh.vertices, mesh.faces, count, rng) for _ in range(2))
    between: np.ndarray = first + rng.random((count, 1)) * (second - first)
    return between


def single_view(
    mesh: Mesh, rotation: np.ndarray, elevation: float, kind: str, count: int, rng: np.random.Generator
) -> np.ndarray:
    """At most `count` points (N, 3) float64 of a mesh in the unit sphere, measured by a simulated depth camera.

    `rotation` takes the mesh to the world. `kind` is ``clean``, ``noise`` (along the ray) or ``holes`` (noise, and no
    measurement at grazing angles and in random patches). The points are in the mesh's own axes.

    Raises:
        ValueError: an unknown kind.
        ScanError: the camera sees nothing.
    """
    with explain_missing_libraries("open3d"):
        import open3d  # late: the pipeline extra

    if kind not in ("clean", "noise", "holes"):
        raise ValueError(f"single view: expected clean, noise or holes, got {kind!r}")
    position, rays = _sensor(rotation, elevation)
    origins_and_rays = np.concatenate([np.broadcast_to(position, rays.shape), rays], axis=1).astype(np.float32)
    cast = _ray_scene(mesh).cast_rays(open3d.core.Tensor.from_numpy(np.ascontiguousarray(origins_and_rays)))
    depth, normals = cast["t_hit"].numpy(), cast["primitive_normals"].numpy()
    hit = np.isfinite(depth)
    if kind == "holes":
        hit &= np.abs((normals * rays).sum(axis=1)) > MIN_SENSOR_COSINE
    if not hit.any():
        raise ScanError("the simulated depth camera sees nothing of the mesh; is it in the unit sphere?")
    depth, rays = depth[hit].astype(np.float64), rays[hit]
    if kind != "clean":
        depth = depth + rng.normal(0, SENSOR_NOISE, len(depth))
    points: np.ndarray = position + depth[:, None] * rays
    if kind == "holes":
        centres = points[rng.choice(len(points), HOLE_COUNT)]
        kept = (np.linalg.norm(points[:, None] - centres, axis=2) > HOLE_RADIUS).all(axis=1)
        points = points[kept] if kept.sum() > HOLE_COUNT else points
    return points[np.sort(rng.choice(len(points), min(count, len(points)), replace=False))]


def _sensor(rotation: np.ndarray, elevation: float) -> tuple[np.ndarray, np.ndarray]:
    """Position (3,) and unit rays (S * S, 3) of the depth camera, in the mesh's axes."""
    angle = math.radians(elevation)
    back = turn(SENSOR_AZIMUTH) @ np.array([0.0, -math.cos(angle), math.sin(angle)])
    right = np.cross(-back, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    reach = math.tan(math.radians(FIELD_OF_VIEW / 2))
    steps = ((np.arange(SENSOR_SIDE) + 0.5) / SENSOR_SIDE * 2 - 1) * reach
    across, down = (grid.reshape(-1, 1) for grid in np.meshgrid(steps, steps))
    rays = across * right + down * np.cross(-back, right) - back
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    return DISTANCE * back @ rotation, rays @ rotation


def _ray_scene(mesh: Mesh) -> Any:
    with explain_missing_libraries("open3d"):
        import open3d

    scene = open3d.t.geometry.RaycastingScene()
    vertices = open3d.core.Tensor.from_numpy(np.ascontiguousarray(mesh.vertices, dtype=np.float32))
    scene.add_triangles(vertices, open3d.core.Tensor.from_numpy(np.ascontiguousarray(mesh.faces, dtype=np.uint32)))
    return scene
