"""Times training, its data alone and its steps alone: ``python benchmarks/training.py SHARD... [--config C]``.

A SHARD is a shard.h5, or a folder that holds some at any depth. Prints samples per second of making batches, of
training steps on ready batches, and of both together as a training runs them, with the share of time that the steps
wait for batches; and a profile of making batches. Writes ``training.json`` to --output.
"""

from __future__ import annotations

import argparse
import cProfile
import json
import os
import pstats
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch

from z2p_core.config import parse_config
from z2p_renderer.pipeline.training.state import TrainingState, start_training
from z2p_renderer.pipeline.training.train import _train_step

PROFILED_FUNCTIONS = 12


def main() -> None:
    """Measure, print and write everything."""
    options = _options()
    options.output.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(options.threads)
    config = parse_config(options.config.read_text(encoding="utf-8"), str(options.config)).train
    files = [file for path in options.shards for file in ([path] if path.is_file() else sorted(path.rglob("shard.h5")))]
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    run = start_training(files, config, device, options.precision)
    setup = {"shards": len(files), "renders": len(run.data.training), "steps": options.steps, "device": device.type,
            "threads": options.threads, "cores": os.cpu_count(), "load before": os.getloadavg()[0]}  # fmt: skip
    read_all(run)
    rows, functions = [*alone(run, options.steps), together(run, options.steps)], profiled(run, options.steps)
    print(", ".join(f"{name} {value}" for name, value in setup.items()) + "\n")
    print("| what | samples/s | ms a step | of processors | waiting |\n|---|--:|--:|--:|--:|")
    for row in rows:
        waiting = f"{row['waiting']:.0%}" if "waiting" in row else ""
        print(
            f"| {row['what']} | {row['samples a second']:.1f} | {row['ms a step']:.0f} "
            f"| {row['processor ms a step']:.0f} | {waiting} |"
        )
    shares = ", ".join(f"{name} {share:.0%}" for name, share in functions.items())
    print(f"\nof the processor's time of making batches: {shares}")
    content = {**setup, "rows": rows, "share of making a batch": functions}
    (options.output / "training.json").write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def read_all(run: TrainingState) -> None:
    """Reads every render once, as the first epoch does; later epochs use the cache."""
    for place in run.data.training:
        for side in set(run.data.sides):
            run.data._record(place, side)


def alone(run: TrainingState, steps: int) -> list[dict[str, Any]]:
    """Times making batches in one thread, and training steps on ready batches."""
    batches = [run.data.batch(step) for step in range(2)]
    _train_step(run, batches[0].to(run.device))  # warm-up: the first step also allocates
    data = _timed("making batches, one thread", steps, lambda number: len(run.data.batch(2 + number).settings))
    steps_alone = _timed("learning from batches", steps, lambda number: _learn(run, batches[number % 2]))
    return [data, steps_alone]


def together(run: TrainingState, steps: int) -> dict[str, Any]:
    """Times training as it runs: threads prefetch batches during the steps."""
    waited, samples, first = 0.0, 0, 1000
    began, used = time.perf_counter(), time.process_time()
    with run.data.batches(first, first + steps) as batches:
        for _ in range(steps):
            requested = time.perf_counter()
            batch = next(batches)
            waited += time.perf_counter() - requested
            samples += _learn(run, batch)
    seconds = time.perf_counter() - began
    return {"what": "both, as a training runs", "samples a second": samples / seconds,
            "ms a step": 1e3 * seconds / steps, "processor ms a step": 1e3 * (time.process_time() - used) / steps,
            "waiting": waited / seconds}  # fmt: skip


def profiled(run: TrainingState, steps: int) -> dict[str, float]:
    """Share of the time of making batches that each function takes itself."""
    profile = cProfile.Profile(time.process_time)  # processor time, so that other processes do not count
    profile.enable()
    for step in range(2000, 2000 + steps):
        run.data.batch(step)
    profile.disable()
    times: dict[str, float] = {}
    for (file, _, name), (_, _, own, _, callers) in pstats.Stats(profile).stats.items():  # type: ignore[attr-defined]
        if name == "call" and Path(file).stem == "library":  # a kernel: named after its caller
            for (_, _, kernel), (_, _, within, _) in callers.items():
                times[f"kernel {kernel}"] = times.get(f"kernel {kernel}", 0.0) + within
            continue
        key = f"{Path(file).stem}.{name}" if file != "~" else name
        times[key] = times.get(key, 0.0) + own
    total = sum(times.values())
    most = sorted(times.items(), key=lambda entry: -entry[1])[:PROFILED_FUNCTIONS]
    return {name: own / total for name, own in most}


def _learn(run: TrainingState, batch: Any) -> int:
    _train_step(run, batch.to(run.device))
    run.step += 1
    return len(batch.settings)


def _timed(what: str, steps: int, work: Callable[[int], int]) -> dict[str, Any]:
    began, used = time.perf_counter(), time.process_time()
    samples = sum(work(number) for number in range(steps))
    seconds = time.perf_counter() - began
    return {"what": what, "samples a second": samples / seconds, "ms a step": 1e3 * seconds / steps,
            "processor ms a step": 1e3 * (time.process_time() - used) / steps}  # fmt: skip


def _options() -> Any:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("shards", nargs="+", type=Path, metavar="SHARD")
    parser.add_argument("--config", type=Path, default=Path("configs/regular.toml"))
    parser.add_argument("--steps", type=int, default=40, help="of each figure")
    parser.add_argument("--threads", type=int, default=os.cpu_count() or 1, help="that torch uses")
    parser.add_argument("--precision", default="auto", choices=("auto", "float32", "bfloat16"))
    parser.add_argument("--output", type=Path, default=Path("previews/benchmarks"))
    return parser.parse_args()


if __name__ == "__main__":
    main()
