"""Attack z2p with odd inputs for a while: ``python tests/fuzz/run.py readers configs --seconds 60 --seed 0``.

Every input is made of a seed and a number, and what finds a fault is kept in ``runs/fuzz/<target>-<seed>-<number>``;
``--number`` makes one of them again, ``--again FOLDER`` tries one that was kept.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from pathlib import Path

from workers import TARGETS, Worker

KEPT = Path(__file__).parents[2] / "runs" / "fuzz"
TURN = 10.0
"""Seconds for which a target has its turn."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=f"what is attacked: {', '.join(TARGETS)} (all)")
    parser.add_argument("--seconds", type=float, default=60, help="how long, all targets together (60)")
    parser.add_argument("--seed", type=int, default=0, help="other inputs for every seed (0)")
    parser.add_argument("--number", type=int, help="only that one of the inputs")
    parser.add_argument("--again", type=Path, help="the folder of an input that was kept")
    options = parser.parse_args()
    for target in options.targets:
        if target not in TARGETS:
            parser.error(f"unknown target {target!r}; expected {', '.join(TARGETS)}")
    worker = Worker()
    try:
        if options.again or options.number is not None:
            return _one(worker, options.targets, options.again or (options.seed, options.number), parser)
        return _all(worker, options.targets or TARGETS, options.seconds, options.seed)
    finally:
        worker.close()


def _one(worker: Worker, targets: list[str], what: Path | tuple[int, int], parser: argparse.ArgumentParser) -> int:
    if len(targets) != 1:
        parser.error("--number and --again need the one target that the input is for")
    keep = None if isinstance(what, Path) else KEPT / f"{targets[0]}-{what[0]}-{what[1]}"
    outcome = worker.attempt(targets[0], what, keep)
    print(outcome.fault or outcome.label)
    return int(bool(outcome.fault))


def _all(worker: Worker, targets: tuple[str, ...], seconds: float, seed: int) -> int:
    """Attack all targets in turn; 1 where faults were found."""
    end, tried, labels = time.monotonic() + seconds, Counter[str](), Counter[str]()
    faults: dict[tuple[str, str], list[str]] = {}
    while time.monotonic() < end:
        for target in targets:
            stop = min(end, time.monotonic() + min(TURN, seconds / len(targets)))
            while time.monotonic() < stop:
                name = f"{target}-{seed}-{tried[target]}"
                outcome = worker.attempt(target, (seed, tried[target]), KEPT / name)
                tried[target] += 1
                labels[f"{target}: {outcome.label}"] += bool(outcome.label)
                if outcome.fault:
                    found = faults.setdefault((target, outcome.kind), [])
                    found.append(name)
                    if len(found) == 1:
                        print(f"{name}: {outcome.kind}", flush=True)
    for label, count in sorted(labels.items()):
        print(f"{count:7} {label}")
    for (_, kind), names in sorted(faults.items()):
        print(f"{len(names):7} times: {kind}\n        {', '.join(names[:4])}")
    print(
        ", ".join(f"{tried[target]} {target}" for target in targets),
        "tried,",
        f"{len(faults)} kinds of faults" + (f"; kept in {KEPT}" if faults else ""),
    )
    return int(bool(faults))


if __name__ == "__main__":
    sys.exit(main())
