"""The shadow on the floor as any camera sees it: what the kernel does for the usual camera, for rays in any direction.

The kernel (`c/lighting/floor_shadow.c`) goes along rows of pixels that see rows of the floor. A camera that is rolled,
orthographic or off-center has none, so each pixel's ray is intersected with the floor on its own.
"""

from __future__ import annotations

import math

import numpy as np

from z2p_core.native.lighting import Floor
from z2p_core.placement.placed_camera import PlacedCamera

MIN_DROP = 1e-6
"""Height that a ray loses for each unit of depth from which on it meets the floor."""


def draw_general_floor_shadow(
    light_occlusion: np.ndarray, sky_occlusion: np.ndarray, reflection_occlusion: np.ndarray,
    cloud_radiance: np.ndarray, floor: Floor, camera: PlacedCamera, out: np.ndarray,
) -> None:  # fmt: skip
    """Draws into `out` (H, W) float32 what `z2p_core.native.floor_shadow` would, for any camera.

    It is 0 where the floor is not seen from above. The grids over the floor are those of that function.
    """
    out.fill(0)
    rows, columns, x, y, cos_view = _floor_hits(floor, camera)
    if not len(rows):
        return
    cells_per_unit = 1 / (2 * floor.half_size)
    u, v = (x + floor.half_size) * cells_per_unit, (y + floor.half_size) * cells_per_unit
    hidden_light, hidden_sky = _sample(light_occlusion, u, v), _sample(sky_occlusion, u, v)
    hidden_reflection = _sample(reflection_occlusion, u, v)
    lost = floor.sky_radiance - _sample(cloud_radiance, u, v)
    light, specular = _unoccluded_light(floor, x, y), _specular_albedo(cos_view)
    diffuse = floor.albedo * (1 - specular)
    missing = diffuse * (light * hidden_light + lost * hidden_sky) + specular * lost * hidden_reflection
    whole = diffuse * (light + floor.sky_radiance) + specular * floor.sky_radiance
    out[rows, columns] = np.clip(missing / whole, 0, 1)


def _floor_hits(
    floor: Floor, camera: PlacedCamera
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Rows and columns (M,) of the pixels that see the floor's square from above; there x, y and the rays' cosine."""
    (fx, fy), (cx, cy) = camera.focal_lengths, camera.principal_point
    across = (np.arange(camera.width) + 0.5 - cx) / fx
    down = (np.arange(camera.height) + 0.5 - cy)[:, None] / fy
    right, below, forward = camera.rotation
    position = camera.position
    if camera.orthographic:
        start = [position[a] + across * right[a] + down * below[a] for a in range(3)]
        ray = [np.full_like(start[0], forward[a]) for a in range(3)]
    else:
        start = [np.full((camera.height, camera.width), position[a]) for a in range(3)]
        ray = [across * right[a] + down * below[a] + forward[a] for a in range(3)]
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (floor.height - start[2]) / ray[2]
        x, y = start[0] + distance * ray[0], start[1] + distance * ray[1]
    falls = (ray[2] < -MIN_DROP) & (distance > MIN_DROP)
    falls &= (np.abs(x) < floor.half_size) & (np.abs(y) < floor.half_size)
    rows, columns = np.nonzero(falls)
    length = np.sqrt(ray[0] ** 2 + ray[1] ** 2 + ray[2] ** 2)
    return rows, columns, x[falls], y[falls], (-ray[2] / length)[falls]


def _sample(grid: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Values (M,) of a grid (S, S) at shares u, v of its square: linear between cell centers, 0 beyond them."""
    side = len(grid)
    column, row = u * side - 0.5, v * side - 0.5
    inside = (column >= 0) & (row >= 0) & (column < side - 1) & (row < side - 1)
    left, top = np.where(inside, column, 0).astype(np.intp), np.where(inside, row, 0).astype(np.intp)
    s, t = column - left, row - top
    upper = grid[top, left] * (1 - s) + grid[top, left + 1] * s
    lower = grid[top + 1, left] * (1 - s) + grid[top + 1, left + 1] * s
    values: np.ndarray = np.where(inside, upper * (1 - t) + lower * t, 0)
    return values


def _unoccluded_light(floor: Floor, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Radiance (M,) of a white diffuse floor under the area light alone, as `unoccluded_light` of `floor.h`."""
    total = np.zeros_like(x)
    axis = floor.light_axis
    for light in floor.light_positions:
        dx, dy, dz = light[0] - x, light[1] - y, light[2] - floor.height
        along_axis = -(dx * axis[0] + dy * axis[1] + dz * axis[2])
        total += np.maximum(along_axis, 0) * dz / (dx * dx + dy * dy + dz * dz) ** 2
    return total * (floor.light_power / (4 * math.pi))


def _specular_albedo(n_dot_v: np.ndarray) -> np.ndarray:
    """Directional albedo (M,) of the floor's specular lobe, as `specular_albedo` of the kernel."""
    grazing = 1 - n_dot_v
    albedo: np.ndarray = 0.0368 + grazing**2 * (0.1133 + 0.073 * grazing**3)
    return albedo
