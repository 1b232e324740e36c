"""Augments a folder of training meshes: stretched, bent, twisted, tapered, and placed side by side.

    python scripts/vary_meshes.py MESHES OUT [--each 4] [--seed 0]

A network overfits to few shapes; variants of them are new to it and cost only their rendering. Every mesh gets --each
variants; a third of them are joined by a second mesh, varied likewise, that touches them.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from z2p_core.placement.bounding_sphere import bounding_sphere
from z2p_renderer.storage.meshes import find_meshes, read_mesh, write_mesh

STRETCH = 0.35
"""Standard deviation of the logarithm of each axis's scale."""
BEND = 0.5
"""Standard deviation of the bend's curvature, 1 / radius."""
TWIST = 0.8
"""Standard deviation of the twist, radians per radius."""
TAPER = 0.3
"""Standard deviation of the relative change of width per radius."""
PAIR_SHARE = 1 / 3
"""Share of the variants with a second mesh beside them."""


def main() -> None:
    """Writes the varied meshes as PLY files."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("meshes", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--each", type=int, default=4, help="varied meshes for each")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    meshes = {name: read_mesh(path) for name, path in find_meshes(options.meshes).items()}
    options.out.mkdir(parents=True, exist_ok=True)
    for index, name in enumerate(meshes):
        for number in range(options.each):
            rng = np.random.default_rng([options.seed, index, number])
            one = varied(meshes[name].vertices, rng), meshes[name].faces
            if rng.random() < PAIR_SHARE:
                other = meshes[str(rng.choice(list(meshes)))]
                one = place_beside(one, (varied(other.vertices, rng) * rng.uniform(0.4, 1.0), other.faces), rng)
            write_mesh(options.out / f"{name}-{number}.ply", *one)


def varied(vertices: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Vertices (V, 3), scaled to the unit sphere, then stretched, tapered, twisted and bent in a random direction.

    Up stays about up: objects stand as they stood.
    """
    points = bounding_sphere(vertices).normalise(vertices)
    points = points * np.exp(STRETCH * rng.normal(size=3))
    points /= np.linalg.norm(points, axis=1).max()
    rotation = _random_rotation(rng)
    x, y, z = (points @ rotation.T).T
    grow = np.clip(1 + TAPER * rng.normal() * z, 0.4, 2.0)
    x, y = x * grow, y * grow
    angle = TWIST * rng.normal() * z
    x, y = x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle)
    curvature = BEND * rng.normal() + 1e-6  # the z axis becomes an arc in the plane of x and z
    x, z = (x - 1 / curvature) * np.cos(curvature * z) + 1 / curvature, (1 / curvature - x) * np.sin(curvature * z)
    result: np.ndarray = np.column_stack([x, y, z]) @ rotation
    return result


def place_beside(
    first: tuple[np.ndarray, np.ndarray], second: tuple[np.ndarray, np.ndarray], rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of both meshes, the second pushed against the first from a random side, on one floor."""
    angle = rng.uniform(0, 2 * np.pi)
    side = np.array([np.cos(angle), np.sin(angle), 0.0])
    placed = second[0] + side * ((first[0] @ side).max() - (second[0] @ side).min() - rng.uniform(0, 0.3))
    placed[:, 2] += first[0][:, 2].min() - placed[:, 2].min()
    return np.vstack([first[0], placed]), np.vstack([first[1], second[1] + len(first[0])])


def _random_rotation(rng: np.random.Generator) -> np.ndarray:
    """A uniformly random rotation (3, 3)."""
    rows, upper = np.linalg.qr(rng.normal(size=(3, 3)))
    rows *= np.sign(np.diag(upper))
    rotation: np.ndarray = rows if np.linalg.det(rows) > 0 else -rows
    return rotation


if __name__ == "__main__":
    main()
