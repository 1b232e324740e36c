"""The shadow on the floor as the camera sees it: missing light, and what the floor mirrors of the cloud."""

from __future__ import annotations

import math

import numpy as np

from z2p_core import native
from z2p_core.camera import Camera
from z2p_core.camera_placement.placed_camera import PlacedCamera
from z2p_core.shading.floor_occlusion import FLOOR_HALF_WIDTH, FloorOcclusion, eroded_share
from z2p_core.shading.general_floor_shadow import draw_general_floor_shadow
from z2p_core.shading.light_transport import BouncedLight, LightScene, sending_to_floor
from z2p_core.shading.microfacet import specular_directions

FLOOR_ROUGHNESS = 0.5
FLOOR_IOR = 1.5
"""Roughness and index of refraction of the floor, Blender's defaults for a surface without a material."""
SECOND_BOUNCE_SHARE = 0.5
"""Share of the second bounce in the cloud's mirror image: with it shadows are as dark as in path traced images."""


def draw_floor_shadow(
    scene: LightScene, occlusion: FloorOcclusion, cloud_radiance: np.ndarray, mirror_directions: int, camera: Camera,
    out: np.ndarray,
) -> None:  # fmt: skip
    """Draws into `out` (H, W) the alpha in [0, 1] of the floor's shadow as the camera sees it.

    The floor is slightly glossy: where it mirrors the cloud instead of the sky, `cloud_radiance` (G, G), see
    `cloud_radiance_from_floor`, replaces the sky's. `mirror_directions` sample the floor's specular lobe.
    """
    height = scene.floor.height
    if camera.position[2] <= height:  # from below, the floor hides nothing and shows nothing
        out.fill(0)
        return
    cells = len(occlusion.light) // 2  # coarser ones will do for what is mirrored
    viewpoints = mirrored_viewpoints(camera.position, height, mirror_directions)
    eroded = eroded_share(scene.spacing, cells)
    mirrored = native.floor_occlusion(scene.points, viewpoints, height, FLOOR_HALF_WIDTH, cells, eroded)
    if isinstance(camera, PlacedCamera):
        draw_general_floor_shadow(*occlusion, mirrored, cloud_radiance, scene.floor, camera, out)
    else:
        native.floor_shadow(*occlusion, mirrored, cloud_radiance, scene.floor, camera, out)


def cloud_radiance_from_floor(
    bounced: BouncedLight, floor_visibility: np.ndarray, color: np.ndarray
) -> np.ndarray:  # fmt: skip
    """Mean radiance (G, G) of a cloud as the floor's cells see it, averaged over the color channels too.

    `color` is the linear color (3,) of the whole cloud, or (N, 3) of each point.
    """
    first, second = bounced.floor
    if color.ndim == 1:
        reflected = color.mean() * first
    else:
        sent = sending_to_floor(color.mean(axis=1) * bounced.points[0])
        reflected = native.floor_irradiance(sent, floor_visibility, len(first))
    radiance = reflected + SECOND_BOUNCE_SHARE * (color**2).mean() * second
    white = np.ones((2, floor_visibility.shape[2]), np.float32)
    coverage = native.floor_irradiance(white, floor_visibility, len(first))
    mean: np.ndarray = _sum_3x3(radiance) / np.maximum(_sum_3x3(coverage), 1e-6)
    return mean


def mirrored_viewpoints(viewer: np.ndarray, floor: float, count: int) -> np.ndarray:
    """Positions (count, 3) below a rough floor from which a viewer (3,) would see what the floor mirrors to it.

    The lobe that is reflected to the viewer is assumed to have the same shape everywhere, that below the origin.
    """
    view = viewer - (0.0, 0.0, floor)
    distance = float(np.linalg.norm(view))
    toward_viewer = np.array([view[0], view[1], 0.0]) / max(math.hypot(view[0], view[1]), 1e-9)
    axes = np.stack([toward_viewer, np.cross((0.0, 0.0, 1.0), toward_viewer), (0.0, 0.0, 1.0)])
    directions = specular_directions(round(float(view[2]) / distance, 4), FLOOR_ROUGHNESS, FLOOR_IOR, count)
    positions: np.ndarray = np.array([0.0, 0.0, floor]) - distance * directions @ axes
    return positions


def _sum_3x3(cells: np.ndarray) -> np.ndarray:
    """Sum (H, W) of each cell and the eight around it; cells beyond the border count as 0."""
    padded = np.pad(cells, 1)
    rows = padded[:-2] + padded[1:-1] + padded[2:]
    total: np.ndarray = rows[:, :-2] + rows[:, 1:-1] + rows[:, 2:]
    return total
