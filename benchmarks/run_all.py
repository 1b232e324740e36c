"""Runs all benchmarks of speed and memory: ``python benchmarks/run_all.py [--shards DIR]``.

Runs picture.py (clouds up to 100 million points), memory.py, rendering.py and, with shards, training.py one after
the other; prints their tables, and writes their JSON and plots to --output. Use a quiet machine.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent


def main() -> None:
    """Runs them all; the exit status is not 0 if one failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--weights", default="regular", help="name or file")
    parser.add_argument("--shards", type=Path, help="folder of shards to train on, as runs/shard")
    parser.add_argument("--points", default="1e8", help="largest cloud")
    parser.add_argument("--output", type=Path, default=Path("previews/benchmarks"))
    options = parser.parse_args()
    shared, weights = ["--output", str(options.output)], ["--weights", options.weights, "--points", options.points]
    runs = {"picture.py": weights, "memory.py": weights, "rendering.py": []}
    if options.shards is not None:
        runs["training.py"] = [str(options.shards)]
    failed = []
    for script, words in runs.items():
        print(f"\n## {script}\n", flush=True)
        if subprocess.run([sys.executable, str(HERE / script), *words, *shared]).returncode:
            failed.append(script)
    if failed:
        sys.exit(f"Error: {', '.join(failed)} failed; see above")


if __name__ == "__main__":
    main()
