"""Clouds whose up axis is known: synthetic objects and labelled meshes, from all or one side, clean or noisy."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from build_standing import KINDS, OBJECTS, egg
from mesh_parts import TURN, Part, box, joined, tube

from z2p_core.camera import turn
from z2p_core.meshes.triangle_sampling import sample_uniform
from z2p_core.rotations import random_rotation
from z2p_core.up_axis.axis_names import UP_ROTATIONS
from z2p_renderer.pipeline.shapes import shape
from z2p_renderer.storage.meshes import read_mesh

STANDING = {
    "armadillo": "+Y", "beetle-alt": "+Y", "boat": "+Y", "brucewick": "+Y", "camel_b": "+Y", "cat": "+Y",
    "cheburashka": "+Y", "decimated-knight": "+Y", "decimated-max": "+Y", "demosthenes": "+Y", "face": "+Y",
    "falconstatue": "+Y", "goathead": "+Y", "human_man": "+Y", "koala": "+Y", "lilium": "+Z", "mountain": "+Y",
    "nefertiti": "+Z", "pizza": "+Y", "springer": "+Y", "suzanne": "+Y", "truck": "+Y",
    "cow": "+Y", "elephant": "+Y", "penguin": "+Y", "skull": "+Y", "spot": "+Y", "stanford-bunny": "+Y",
}  # fmt: skip
"""Common test meshes -> the axis that points up in their files, as seen in pictures of them. Tools, rings, flat shapes
and body parts without an up axis are left out."""
FROM_ABOVE = {"land", "street"}
"""Kinds that are measured from the air."""
DEPTH_MAP_SIDE = 48
"""Cells along a side of the depth map by which hidden points are removed."""


@dataclass(frozen=True)
class LabelledCloud:
    """A cloud (N, 3) with +Z up, and its kind."""

    name: str
    points: np.ndarray
    partial: bool
    noisy: bool


def synthetic_clouds(seed: int, each: int) -> list[LabelledCloud]:
    """This many clouds of each kind of synthetic object."""
    clouds = []
    for index, (kind, build) in enumerate(KINDS.items()):
        for number in range(each):
            rng = np.random.default_rng([seed, index, number])
            clouds.append(cloud_of(kind, *joined(build(rng)), rng))
    return clouds


def mesh_clouds(folder: Path, each: int, seed: int, stretch: float = 1.0) -> list[LabelledCloud]:
    """This many clouds of each mesh in a folder whose up axis is known, each axis stretched by up to that factor."""
    clouds = []
    for path in sorted(folder.glob("*.*")):
        if path.stem in STANDING:
            mesh = read_mesh(path)
            upright = np.asarray(mesh.vertices) @ np.array(UP_ROTATIONS[STANDING[path.stem]], dtype=float).T
            for number in range(each):
                rng = np.random.default_rng([seed, number, *path.stem.encode()])
                factors = stretch ** rng.uniform(-1, 1, 3)
                clouds.append(cloud_of(path.stem, upright * factors, np.asarray(mesh.faces), rng))
    return clouds


def unoriented_clouds(seed: int, each: int) -> list[LabelledCloud]:
    """Clouds without an up axis: balls, bricks, rings, knots, pipes, and synthetic objects at any angle."""
    clouds = []
    for number in range(each):
        rng = np.random.default_rng([seed, number])
        straight = [box((1, 1, 1), (0, 0, 0)), box(rng.uniform(0.7, 1, 3), (0, 0, 0)),
                    egg((0, 0, 0), *rng.uniform(0.6, 1, 3))]  # fmt: skip
        askew = [egg((0, 0, 0), *rng.uniform(0.5, 1, 3)), egg((0, 0, 0), 1, 1, 1), OBJECTS["pipes"](rng), _ring(rng),
                 [shape("torus_knot")], [*KINDS.values()][rng.integers(len(KINDS))](rng)]  # fmt: skip
        for index, parts in enumerate(straight + askew):
            vertices, faces = joined(parts)
            if index >= len(straight):
                vertices = vertices @ random_rotation(rng).T
            clouds.append(cloud_of("unoriented", vertices, faces, rng))
    return clouds


def _ring(rng: np.random.Generator) -> list[Part]:
    angle = np.linspace(0, TURN, 60)
    return tube(np.column_stack([np.cos(angle), np.sin(angle), 0 * angle]), rng.uniform(0.05, 0.4))


def cloud_of(name: str, vertices: np.ndarray, faces: np.ndarray, rng: np.random.Generator) -> LabelledCloud:
    """Points of a mesh with +Z up, turned about it; every third noisy, every fourth seen from one side only."""
    points = sample_uniform(vertices, faces, int(10 ** rng.uniform(2.9, 4.1)), rng)
    angle = 90.0 * rng.integers(4) if rng.random() < 0.5 else rng.uniform(0, 360)
    points = points @ turn(float(angle)).T
    partial, noisy = bool(rng.random() < 0.25), bool(rng.random() < 0.33)
    if partial:
        lowest, highest = (50, 90) if name in FROM_ABOVE else (0, 45)
        points = points[visible_points(points, rng.uniform(lowest, highest), rng.uniform(0, 360))]
    size = float(np.ptp(points, axis=0).max())
    if noisy:
        points = points + rng.normal(0, size * rng.uniform(0.001, 0.01), points.shape)
    where = rng.uniform(-1, 1, 3) * size * rng.choice([0.0, 0.3, 3.0])
    return LabelledCloud(name, points - (points.max(0) + points.min(0)) / 2 + where, partial, noisy)


def visible_points(points: np.ndarray, elevation: float, azimuth: float) -> np.ndarray:
    """Mask (N,) of the points (N, 3) that are visible from afar, at an elevation and azimuth in degrees."""
    up, around = math.radians(elevation), math.radians(azimuth)
    back = np.array([math.cos(around) * math.cos(up), math.sin(around) * math.cos(up), math.sin(up)])
    right = np.array([-math.sin(around), math.cos(around), 0.0])
    place = points @ np.stack([right, np.cross(back, right)], axis=1)
    cells = min(DEPTH_MAP_SIDE, max(8, int(math.sqrt(len(points) / 6))))
    step = float(np.ptp(place, axis=0).max()) / cells
    column, row = ((place - place.min(0)) / step).astype(int).T
    nearest = np.full((cells + 1) ** 2, -np.inf)
    np.maximum.at(nearest, column * (cells + 1) + row, points @ back)
    visible: np.ndarray = points @ back > nearest[column * (cells + 1) + row] - 2 * step
    return visible
