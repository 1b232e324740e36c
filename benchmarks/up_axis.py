"""How often z2p chooses the right up axis: hit rates on labelled clouds, each turned to several axes.

    python benchmarks/up_axis.py [--meshes FOLDER] [--each 12] [--seed 1000]

Measured are synthetic objects (scripts/build_standing.py, with other seeds than those that the weights were fitted to)
and the meshes of a folder that have a label (scripts/upright_clouds.py). A quarter of the clouds is seen from one side
only, a third is noisy. Each is turned to +Z, +Y, -Y and -Z up, and its file is a .ply, .pcd or .xyz in turn.
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
from upright_clouds import LabelledCloud, mesh_clouds, synthetic_clouds

from z2p_core.up_axis.axis_names import UP_ROTATIONS
from z2p_core.up_axis.choose import guess_up_axis

UP_AXES = ("+Z", "+Y", "-Y", "-Z")
SUFFIXES = (".ply", ".pcd", ".xyz")
Rule = Callable[[np.ndarray, str], tuple[str, str]]
"""Points (N, 3) and a suffix -> the axis chosen, and the other one named, if any."""


def always_z(points: np.ndarray, suffix: str) -> tuple[str, str]:
    """The axis that most programs assume."""
    del points, suffix
    return "+Z", ""


def toppling(points: np.ndarray, suffix: str) -> tuple[str, str]:
    """z2p's rule until 2026: +Z, unless a .ply would topple over so and stand firmly with +Y up."""
    turned_over = suffix == ".ply" and would_topple(points, np.eye(3)[2], np.eye(3)[1])
    return ("+Y" if turned_over else "+Z"), ""


def by_shape(points: np.ndarray, suffix: str) -> tuple[str, str]:
    """z2p's rule: by shape, file header and format."""
    guess = guess_up_axis(points, suffix)
    return guess.axis, guess.other


RULES: dict[str, Rule] = {"always +Z": always_z, "the rule before": toppling, "by shape": by_shape}


def main() -> None:
    """Prints one table for each collection."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--meshes", type=Path, action="append", default=[], help="a folder of meshes; may come twice")
    parser.add_argument("--each", type=int, default=12, help="clouds of each kind of synthetic object and of each mesh")
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument("--kinds", action="store_true", help="also print the rate of each kind")
    options = parser.parse_args()
    collections = {"synthetic objects": synthetic_clouds(options.seed, options.each)}
    for folder in options.meshes:
        collections[f"meshes of {folder.name}"] = mesh_clouds(folder, options.each, options.seed)
    for name, clouds in collections.items():
        print(f"{name}: {len(clouds)} clouds, each in {len(UP_AXES)} poses")
        print_hit_rates(clouds, options.kinds)


def print_hit_rates(clouds: list[LabelledCloud], kinds: bool) -> None:
    """Prints the hit rates of each rule."""
    print(f"  {'rule':<16}" + "".join(f"{axis + ' up':>9}" for axis in UP_AXES) + f"{'whole':>9}{'partial':>9}"
          f"{'noisy':>9}{'first 3':>9}{'or named':>10}{'ms':>7}")  # fmt: skip
    for name, rule in RULES.items():
        started = time.perf_counter()
        hits, named = measure_hits(clouds, rule)
        spent = (time.perf_counter() - started) / hits.size * 1000
        partial, noisy = (np.array([getattr(cloud, mark) for cloud in clouds]) for mark in ("partial", "noisy"))
        usual = hits[:, :3]
        parts = (usual[~partial], usual[partial], usual[noisy], usual, (hits | named)[:, :3])
        shares = [*hits.mean(0), *(part.mean() if part.size else np.nan for part in parts)]
        print(f"  {name:<16}" + "".join(f"{100 * share:>8.1f}%" for share in shares) + f"{spent:>8.1f}")
    if kinds:
        rates_of_kind = defaultdict(list)
        for cloud, hit in zip(clouds, usual, strict=True):
            rates_of_kind[cloud.name].append(hit.mean())
        rates = sorted((float(np.mean(rates)), kind) for kind, rates in rates_of_kind.items())
        print("  " + ", ".join(f"{kind} {100 * rate:.0f} %" for rate, kind in rates))


def measure_hits(clouds: list[LabelledCloud], rule: Rule) -> tuple[np.ndarray, np.ndarray]:
    """Masks (N, poses): the right axis was chosen; it was named as the other one."""
    hits, named = np.zeros((2, len(clouds), len(UP_AXES)), dtype=bool)
    for row, cloud in enumerate(clouds):
        for column, axis in enumerate(UP_AXES):
            turned = cloud.points @ np.array(UP_ROTATIONS[axis], dtype=float)
            chosen, other = rule(turned, SUFFIXES[row % len(SUFFIXES)])
            hits[row, column], named[row, column] = chosen == axis, other == axis
    return hits, named


if __name__ == "__main__":
    main()
