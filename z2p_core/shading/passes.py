"""What a camera sees of a cloud besides its picture: depth, normals, albedo, coverage, positions, and how sure that is.

Drawn from the same surfels as the rough rendering, without light and without the network, in full resolution. Depths
and positions are in the data's units and coordinates. Where less than half of a pixel is covered, there is no surface.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from z2p_core import native
from z2p_core.interfaces import PointColors
from z2p_core.linalg import rotate_points, row_dots
from z2p_core.pinhole import PinholeCamera
from z2p_core.placement.placed_camera import PlacedCamera, place_camera
from z2p_core.placement.viewpoint import Viewpoint
from z2p_core.shading.channels import RASTERIZED, GBufferChannel
from z2p_core.shading.surfels import make_surfels
from z2p_core.shading.textured_light import surface_albedo
from z2p_core.surface.normals import estimate_surface
from z2p_core.surface.subsampling import MAX_SURFACE_POINTS, subsample_hashed

BLENDING = native.Blending(blend_depth_radii=0.7, coverage_gain=15.0, full_weight=2.7)
"""As the rough rendering blends discs."""
FIRST_VALUE = GBufferChannel.DEPTH + 1
"""Channel of the first of a surfel's own values."""
MIN_SPACING = 1e-3
"""Smallest spacing of a cloud that counts, in world units."""
MIN_ALPHA = 0.5
"""Coverage from which on a pixel shows a surface."""
RIM_POINTS = 4
"""Points at the rim of a hole whose mean albedo its surfel gets."""


def draw_passes(
    names: Sequence[str], cloud: np.ndarray, viewpoint: Viewpoint, camera: PinholeCamera,
    color: np.ndarray | PointColors,
) -> dict[str, np.ndarray]:  # fmt: skip
    """Passes of a placed cloud (N, 3) float32, by their names: float32, but for positions, which are float64.

    Args:
        names: some of `z2p_core.pass_names.PASSES`, where they are explained.
        cloud: in the world that `viewpoint` places the data in.
        viewpoint: leads back to the data's units.
        camera: in the data's units.
        color: linear base color (3,), or those of points.
    """
    placed = place_camera(camera, viewpoint)
    depth_range = _depth_range(cloud, placed)
    surfels = _make_surfels(cloud, placed, color)
    image = surfels.rasterize(np.column_stack([surfels.normals, surfels.albedo]), placed, depth_range)
    coverage, density, nearness = image[: GBufferChannel.DEPTH + 1]
    seen = coverage >= MIN_ALPHA
    typical = float(np.median(density[seen])) if seen.any() else 1.0
    closed = np.minimum(density / max(typical, 1e-6), 1)
    near, far = depth_range
    row, column = np.nonzero(seen)
    world = placed.unproject(np.column_stack([column + 0.5, row + 0.5]), far - (far - near) * nearness[seen])
    positions = viewpoint.unplace(world)
    normals = rotate_points(image[3:6, seen].T, np.array(viewpoint.rotation).T.astype(np.float32))
    values = {
        "depth": lambda: camera.project(positions)[1].astype(np.float32),
        "normal": lambda: normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-6),
        "albedo": lambda: np.clip(image[6:9, seen].T, 0, 1),
        "position": lambda: positions,
    }
    whole = {
        "alpha": coverage.copy,
        "trust": lambda: closed * np.minimum(surfels.rasterize(surfels.support, placed, depth_range)[FIRST_VALUE], 1),
    }
    return {name: whole[name]() if name in whole else _spread(values[name](), seen) for name in names}


def _spread(values: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """An image (H, W) or (H, W, 3) with values (M,) or (M, 3) where `seen` (H, W) holds, NaN elsewhere."""
    image = np.full((*seen.shape, *values.shape[1:]), np.nan, values.dtype)
    image[seen] = values
    return image


def _depth_range(cloud: np.ndarray, camera: PlacedCamera) -> tuple[float, float]:
    """Depths between which all discs of the cloud (N, 3) lie, in world units."""
    depth = camera.project(cloud.astype(np.float64))[1]
    low, high = float(depth.min()), float(depth.max())
    return low - 0.5, high + 0.5


@dataclass(frozen=True)
class _Surfels:
    """The cloud's M surfels: discs in the camera's axes, and their values."""

    discs: native.Discs
    normals: np.ndarray
    """(M, 3) in world axes, towards the camera."""
    albedo: np.ndarray
    """(M, 3), linear."""
    support: np.ndarray
    """(M, 1): the median spacing over that of the surfel's point, at most 1; 0 where it closes a hole."""

    def rasterize(self, values: np.ndarray, camera: PlacedCamera, depth_range: tuple[float, float]) -> np.ndarray:
        """Coverage, density, nearness and up to six values (M, 6) of the surfels: (9, H, W) float32."""
        features = np.zeros((len(values), 6), np.float32)
        features[:, : values.shape[1]] = values
        image = np.empty((RASTERIZED.stop, camera.height, camera.width), np.float32)
        native.rasterize_surfels(self.discs, features, camera, BLENDING, depth_range, image)
        return image


def _make_surfels(cloud: np.ndarray, camera: PlacedCamera, color: np.ndarray | PointColors) -> _Surfels:
    """The surfels of a cloud (N, 3) that the camera sees."""
    surface = estimate_surface(subsample_hashed(cloud, MAX_SURFACE_POINTS))
    count, spacing = len(surface.points), max(float(np.median(surface.spacing)), MIN_SPACING)
    surfels, radii = make_surfels(surface, spacing)
    viewer = camera.position.astype(np.float32)
    away = row_dots(surfels.points - viewer, surfels.normals) > 0
    normals = surfels.normals * np.where(away, np.float32(-1), np.float32(1))[:, None]
    centers = native.offset_disc_centers(surfels.points, normals, radii, surfels.neighbors)
    rotation = camera.rotation.astype(np.float32)
    in_camera, facing = rotate_points(centers - viewer, rotation), rotate_points(normals, rotation)
    discs = native.Discs(in_camera, facing, radii, native.disc_clip_planes(in_camera, facing, radii, surfels.neighbors))
    if isinstance(color, PointColors):
        own = surface_albedo(surface, color)
        albedo = np.concatenate([own, own[surfels.neighbors[count:, :RIM_POINTS]].mean(axis=1)])
    else:
        albedo = np.broadcast_to(np.asarray(color, np.float32), (len(radii), 3))
    support = np.zeros((len(radii), 1), np.float32)
    support[:count, 0] = np.minimum(spacing / np.maximum(surface.spacing, 1e-9), 1)
    return _Surfels(discs, normals, albedo, support)
