"""Makes the sample scans of `samples/`: procedural objects, scanned by a simulated depth camera with noise and holes.

    python examples/make_samples.py [FOLDER]

All random numbers derive from one seed. Suzanne needs the pipeline extra (Blender); the others need numpy alone.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from sample_shapes import Mesh, amphora, chair, knot_on_plinth

from z2p_core.camera import turn

FOLDER = Path(__file__).parents[1] / "samples"
SEED = 2022


@dataclass(frozen=True)
class Scanner:
    """A simulated depth camera: its viewpoints and errors. Lengths in units of the object's radius."""

    azimuths: tuple[float, ...]
    """Degrees about +Z, 0 at -Y; one view each, all merged into one cloud."""
    elevation: float = 22.0
    distance: float = 4.0
    pixels: int = 130
    noise: float = 0.004
    """Standard deviation along the ray."""
    holes: int = 6
    """Patches without measurements per view, as from gloss or dirt."""
    grazing: float = 0.3
    """Cosine between ray and normal below which more and more points are lost."""


def scan(mesh: Mesh, scanner: Scanner, rng: np.random.Generator) -> np.ndarray:
    """Points (N, 3) float64 that the scanner measures on a mesh in the unit sphere, in the mesh's axes."""
    points, normals = _dense_samples(mesh, 1_500_000, rng)
    views = [_one_view(points, normals, azimuth, scanner, rng) for azimuth in scanner.azimuths]
    return np.concatenate(views)


def _dense_samples(mesh: Mesh, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Points and unit normals (count, 3), uniform over the surface."""
    corners = mesh[0][mesh[1]]  # (M, 3, 3)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(cross, axis=1)
    face = rng.choice(len(area), size=count, p=area / area.sum())
    a, b = rng.uniform(size=(2, count, 1))
    inside = a + b <= 1
    a, b = np.where(inside, a, 1 - a), np.where(inside, b, 1 - b)
    first, second, third = corners[face].transpose(1, 0, 2)
    return first + a * (second - first) + b * (third - first), cross[face] / area[face, None]


def _one_view(
    points: np.ndarray, normals: np.ndarray, azimuth: float, scanner: Scanner, rng: np.random.Generator
) -> np.ndarray:
    """Points (N, 3) of one view: the nearest surface per pixel, without lost points, with noise along the ray."""
    angle = np.radians(scanner.elevation)
    back = np.array([0.0, -np.cos(angle), np.sin(angle)]) @ turn(azimuth).T  # from the object to the camera
    right = np.array([1.0, 0.0, 0.0]) @ turn(azimuth).T
    rays = points - scanner.distance * back
    depth = -rays @ back
    focal = scanner.pixels / 2 * scanner.distance / 1.15
    column = np.floor(rays @ right / depth * focal + scanner.pixels / 2).astype(int)
    row = np.floor(rays @ np.cross(back, right) / depth * focal + scanner.pixels / 2).astype(int)
    order = np.lexsort((depth, row * scanner.pixels + column))
    pixel = (row * scanner.pixels + column)[order]
    seen = order[np.r_[True, pixel[1:] != pixel[:-1]]]  # the first point of each pixel is the nearest
    ray = rays[seen] / np.linalg.norm(rays[seen], axis=1, keepdims=True)
    cosine = np.abs((ray * normals[seen]).sum(1))
    kept = rng.uniform(size=len(seen)) < np.clip(cosine / scanner.grazing, 0, 1) ** 1.5
    for centre in points[rng.choice(seen, scanner.holes)]:
        stretched = (points[seen] - centre) * rng.uniform(0.7, 1.6, 3)
        kept &= np.linalg.norm(stretched, axis=1) > rng.uniform(0.04, 0.1)
    jitter = rng.normal(scale=scanner.noise, size=(len(seen), 1)) / np.maximum(cosine, 0.3)[:, None]
    return (points[seen] + jitter * ray)[kept]


def suzanne() -> Mesh:
    """Blender's monkey, smoothed by two rounds of subdivision."""
    import trimesh

    from z2p_renderer.pipeline.render import export_suzanne

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "suzanne.npz"
        export_suzanne(path)
        with np.load(path) as arrays:
            vertices, faces = arrays["vertices"], arrays["faces"]
    return trimesh.remesh.subdivide_loop(vertices.astype(np.float64), faces, iterations=2)


def in_unit_sphere(mesh: Mesh) -> Mesh:
    """The mesh, centred on its box and scaled so that its farthest vertex is at 1."""
    vertices, faces = mesh
    centred = vertices - (vertices.min(0) + vertices.max(0)) / 2
    return centred / np.linalg.norm(centred, axis=1).max(), faces


def write_ply(path: Path, points: np.ndarray) -> None:
    """Writes points as binary PLY, float32."""
    columns = "".join(f"property float {axis}\n" for axis in "xyz")
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n{columns}end_header\n"
    path.write_bytes(header.encode() + points.astype("<f4").tobytes())


def write_xyz(path: Path, points: np.ndarray) -> None:
    """Writes points as rows of text."""
    np.savetxt(path, points, fmt="%.2f")


def write_painted(path: Path, points: np.ndarray) -> None:
    """PLY of an amphora (N, 3) with painted bands, a zigzag and rays, a temperature in degrees, and four parts."""
    height = (points[:, 2] - points[:, 2].min()) / np.ptp(points[:, 2])
    angle = np.arctan2(*(points[:, 1::-1] - points[:, 1::-1].mean(axis=0)).T) / (2 * np.pi)
    color = np.tile(TERRACOTTA, (len(points), 1))
    for low, high in BANDS:
        color[(height >= low) & (height < high)] = BLACK
    frieze = (height >= 0.39) & (height < 0.62)
    color[frieze] = CREAM
    zigzag = 0.15 + 0.7 * np.abs(2 * (14 * angle % 1) - 1)
    color[frieze & (np.abs((height - 0.39) / 0.23 - zigzag) < 0.16)] = BLUE
    rays = np.abs(2 * (18 * angle % 1) - 1) < 0.8 * (1 - (height - 0.19) / 0.17)
    color[(height >= 0.19) & (height < 0.36) & rays] = BLACK
    hot = points[np.argmax(points[:, 0])]
    table = np.zeros(len(points), [*((axis, "<f4") for axis in "xyz"), *((name, "u1") for name in COLOR_NAMES),
                                   ("temperature", "<f4"), ("part", "u1")])  # fmt: skip
    for column, axis in enumerate("xyz"):
        table[axis] = points[:, column]
    for column, name in enumerate(COLOR_NAMES):
        table[name] = np.round(255 * color[:, column])
    table["temperature"] = 18 + 9 * np.exp(-((points - hot) ** 2).sum(axis=1) / 0.25) + 3 * height
    table["part"] = np.select([height < 0.08, height < 0.65, height < 0.83], [1, 2, 3], 4)
    kinds = {"<f4": "float", "|u1": "uchar"}
    properties = "".join(f"property {kinds[table.dtype[name].str]} {name}\n" for name in table.dtype.names or ())
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(table)}\n{properties}end_header\n"
    path.write_bytes(header.encode() + table.tobytes())


PAINTED = "painted.ply"
"""The amphora with colors, a temperature and parts of its points."""
COLOR_NAMES = ("red", "green", "blue")
TERRACOTTA, BLACK, CREAM, BLUE = (0.80, 0.42, 0.22), (0.10, 0.09, 0.09), (0.93, 0.86, 0.70), (0.15, 0.32, 0.55)
"""sRGB."""
BANDS = ((0.0, 0.08), (0.16, 0.19), (0.36, 0.39), (0.62, 0.65), (0.80, 0.83), (0.93, 1.01))
"""Heights of black bands, as shares of the whole."""
SAMPLES: dict[str, tuple[Callable[[], Mesh], Scanner, float]] = {
    "suzanne.ply": (suzanne, Scanner((10.0, 100.0, 190.0, 280.0), elevation=16.0, pixels=100, holes=1), 1.0),
    "amphora.ply": (amphora, Scanner((0.0, 90.0, 180.0, 270.0), pixels=95, holes=1), 0.31),
    "chair.ply": (chair, Scanner((-35.0, 60.0, 180.0), pixels=125, noise=0.003), 0.62),
    "knot.xyz": (knot_on_plinth, Scanner((-12.0, 78.0, 168.0, 258.0), elevation=25.0, pixels=95, holes=1), 240.0),
}
"""File name -> shape, scanner, and the object's radius in the file's unit: metres, and millimetres for the knot."""


def main(folder: Path) -> None:
    """Write every sample into `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in (*SAMPLES, PAINTED):
        points = make_sample(name)
        write = write_painted if name == PAINTED else write_xyz if name.endswith(".xyz") else write_ply
        write(folder / name, points)
        print(f"{folder / name}: {len(points)} points, {(folder / name).stat().st_size / 1000:.0f} kB")


def make_sample(name: str) -> np.ndarray:
    """Points (N, 3) float64 of a sample, in its file's unit."""
    name = "amphora.ply" if name == PAINTED else name
    shape, scanner, radius = SAMPLES[name]
    rng = np.random.default_rng([SEED, list(SAMPLES).index(name)])
    return scan(in_unit_sphere(shape()), scanner, rng) * radius


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER)
