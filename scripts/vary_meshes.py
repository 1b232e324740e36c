"""Makes further meshes to train on out of a folder of them: stretched, bent, twisted, tapered, and set side by side.

    python scripts/vary_meshes.py MESHES OUT [--each 4] [--seed 0]

A network that knows few shapes learns them by heart; relatives of these are new to it, and cost only their rendering.
Every mesh gets so many; a third of them have a second mesh, varied likewise, that touches them.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from z2p_core.placement.bounding_sphere import bounding_sphere
from z2p_renderer.storage.meshes import find_meshes, read_mesh, write_mesh

STRETCH = 0.35
"""Standard deviation of the logarithm of each axis's scale."""
BEND, TWIST, TAPER = 0.5, 0.8, 0.3
"""Standard deviations: of the bend's curvature, of the twist in radians a radius, of the taper a radius."""
COMPANY = 1 / 3
"""Share of the meshes that have another one beside them."""


def main() -> None:
    """Write the varied meshes, as PLY files."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("meshes", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--each", type=int, default=4, help="varied meshes for each")
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    found = {name: read_mesh(path) for name, path in find_meshes(asked.meshes).items()}
    asked.out.mkdir(parents=True, exist_ok=True)
    for index, name in enumerate(found):
        for number in range(asked.each):
            rng = np.random.default_rng([asked.seed, index, number])
            one = varied(found[name].vertices, rng), found[name].faces
            if rng.random() < COMPANY:
                other = found[str(rng.choice(list(found)))]
                one = beside(one, (varied(other.vertices, rng) * rng.uniform(0.4, 1.0), other.faces), rng)
            write_mesh(asked.out / f"{name}-{number}.ply", *one)


def varied(vertices: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Vertices (V, 3) of the unit sphere's size, stretched, tapered, twisted and bent in a random direction.

    Up stays about up: objects stand as they stood.
    """
    points = bounding_sphere(vertices).normalise(vertices)
    points = points * np.exp(STRETCH * rng.normal(size=3))
    points /= np.linalg.norm(points, axis=1).max()
    turned = _turn(rng)
    x, y, z = (points @ turned.T).T
    grow = np.clip(1 + TAPER * rng.normal() * z, 0.4, 2.0)
    x, y = x * grow, y * grow
    angle = TWIST * rng.normal() * z
    x, y = x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle)
    curvature = BEND * rng.normal() + 1e-6  # the z axis becomes an arc in the plane of x and z
    x, z = (x - 1 / curvature) * np.cos(curvature * z) + 1 / curvature, (1 / curvature - x) * np.sin(curvature * z)
    result: np.ndarray = np.column_stack([x, y, z]) @ turned
    return result


def beside(
    first: tuple[np.ndarray, np.ndarray], second: tuple[np.ndarray, np.ndarray], rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of both, the second pushed against the first from a random side, on one floor."""
    angle = rng.uniform(0, 2 * np.pi)
    side = np.array([np.cos(angle), np.sin(angle), 0.0])
    moved = second[0] + side * ((first[0] @ side).max() - (second[0] @ side).min() - rng.uniform(0, 0.3))
    moved[:, 2] += first[0][:, 2].min() - moved[:, 2].min()
    return np.vstack([first[0], moved]), np.vstack([first[1], second[1] + len(first[0])])


def _turn(rng: np.random.Generator) -> np.ndarray:
    """A random rotation (3, 3), rows, evenly over all."""
    rows, upper = np.linalg.qr(rng.normal(size=(3, 3)))
    rows *= np.sign(np.diag(upper))
    rotation: np.ndarray = rows if np.linalg.det(rows) > 0 else -rows
    return rotation


if __name__ == "__main__":
    main()
