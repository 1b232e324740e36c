"""How often z2p finds which way is up: hit rates on labelled clouds, each turned to several axes.

    python benchmarks/up_axis.py [--meshes FOLDER] [--each 12] [--seed 1000]

Beside made things (scripts/build_standing.py; other seeds than those the weights were fitted to) the meshes of a folder
count whose upright is known (scripts/upright_clouds.py). A quarter of the clouds is seen from one side only, a third
noisy; each is turned to +Z, +Y, -Y and -Z up and saved, in thought, as .ply, .pcd or .xyz in turn.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "scripts"))

from toppling import would_topple
from upright_clouds import Labelled, made, meshes

from z2p_core.up_axis.axis_names import UP_ROTATIONS
from z2p_core.up_axis.choose import guess_up_axis

TURNED = ("+Z", "+Y", "-Y", "-Z")
SUFFIXES = (".ply", ".pcd", ".xyz")
Rule = Callable[[np.ndarray, str], tuple[str, str]]
"""Points (N, 3) and a suffix -> the axis chosen, and the other one named, if any."""


def always_z(points: np.ndarray, suffix: str) -> tuple[str, str]:
    """What most programs do."""
    del points, suffix
    return "+Z", ""


def toppling(points: np.ndarray, suffix: str) -> tuple[str, str]:
    """z2p's rule until 2026: +Z, unless a .ply would topple over so and stand firmly with +Y up."""
    turned_over = suffix == ".ply" and would_topple(points, np.eye(3)[2], np.eye(3)[1])
    return ("+Y" if turned_over else "+Z"), ""


def by_shape(points: np.ndarray, suffix: str) -> tuple[str, str]:
    """What z2p does."""
    guess = guess_up_axis(points, suffix)
    return guess.axis, guess.other


RULES: dict[str, Rule] = {"always +Z": always_z, "the rule before": toppling, "by shape": by_shape}


def main() -> None:
    """Print one table for each collection."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--meshes", type=Path, action="append", default=[], help="a folder of meshes; may come twice")
    parser.add_argument("--each", type=int, default=12, help="clouds of each kind of made things and of each mesh")
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument("--kinds", action="store_true", help="tell the rate of each kind")
    asked = parser.parse_args()
    collections = {"made things": made(asked.seed, asked.each)}
    for folder in asked.meshes:
        collections[f"meshes of {folder.name}"] = meshes(folder, asked.each, asked.seed)
    for name, clouds in collections.items():
        print(f"{name}: {len(clouds)} clouds, each in {len(TURNED)} poses")
        table(clouds, asked.kinds)


def table(clouds: list[Labelled], kinds: bool) -> None:
    """Print the hit rates of each rule."""
    print(f"  {'rule':<16}" + "".join(f"{axis + ' up':>9}" for axis in TURNED) + f"{'whole':>9}{'partial':>9}"
          f"{'noisy':>9}{'first 3':>9}{'or named':>10}{'ms':>7}")  # fmt: skip
    for name, rule in RULES.items():
        started = time.perf_counter()
        hits, named = outcome(clouds, rule)
        spent = (time.perf_counter() - started) / hits.size * 1000
        partial, noisy = (np.array([getattr(cloud, mark) for cloud in clouds]) for mark in ("partial", "noisy"))
        usual = hits[:, :3]
        parts = (usual[~partial], usual[partial], usual[noisy], usual, (hits | named)[:, :3])
        shares = [*hits.mean(0), *(part.mean() if part.size else np.nan for part in parts)]
        print(f"  {name:<16}" + "".join(f"{100 * share:>8.1f}%" for share in shares) + f"{spent:>8.1f}")
    if kinds:
        found = defaultdict(list)
        for cloud, hit in zip(clouds, usual, strict=True):
            found[cloud.name].append(hit.mean())
        rates = sorted((float(np.mean(rates)), kind) for kind, rates in found.items())
        print("  " + ", ".join(f"{kind} {100 * rate:.0f} %" for rate, kind in rates))


def outcome(clouds: list[Labelled], rule: Rule) -> tuple[np.ndarray, np.ndarray]:
    """Masks (N, poses): the right axis was chosen; it was named as the other one."""
    hits, named = np.zeros((2, len(clouds), len(TURNED)), dtype=bool)
    for row, cloud in enumerate(clouds):
        for column, axis in enumerate(TURNED):
            chosen, other = rule(cloud.points @ np.array(UP_ROTATIONS[axis], dtype=float), SUFFIXES[row % len(SUFFIXES)])
            hits[row, column], named[row, column] = chosen == axis, other == axis
    return hits, named


if __name__ == "__main__":
    main()
