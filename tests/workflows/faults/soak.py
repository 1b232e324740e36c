"""Kills the whole process tree of a pipeline at random moments, again and again: ``make soak``.

In the end every result has the bytes that an undisturbed run gives it. `make soak` does it fifty times.
"""

from __future__ import annotations

import os
import random
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from world import World, made


def soak(folder: Path, kills: int, seed: int, say: Callable[[str], object] = print) -> None:
    """A line a kill; the last one counts them.

    Raises:
        AssertionError: a run failed by itself, or a result has other bytes than an undisturbed run's.
    """
    rng = random.Random(seed)
    undisturbed = World(folder / "undisturbed")
    began = time.monotonic()
    undisturbed.make()
    longest = time.monotonic() - began
    expected = undisturbed.digests()
    say(f"undisturbed: {len(expected)} files in {longest:.1f} s")
    world = World(folder / "disturbed")
    killed = rounds = 0
    while killed < kills:
        pipeline = world.start()
        moment = rng.uniform(0.3, longest)
        time.sleep(moment)
        if pipeline.poll() is None:
            os.killpg(pipeline.pid, signal.SIGKILL)
            killed += 1
            done = made(pipeline.communicate()[1])
            say(f"kill {killed} after {moment:.2f} s; made: {', '.join(done) or 'nothing'}")
            continue
        said = pipeline.communicate()[1]
        assert pipeline.returncode == 0, said
        rounds += 1
        check(world, expected)
        say(f"round {rounds} finished between kills, same digests; the workspace is emptied")
        shutil.rmtree(world.workspace)
    status, said = world.run()
    assert status == 0, said
    check(world, expected)
    result = world.workflows("verify", "--workspace", "runs")
    assert result.returncode == 0, result.stdout
    say(f"{kills} kills, {rounds + 1} rounds finished, same digests each time, weights among them")


def check(world: World, expected: dict[str, str]) -> None:
    found = world.digests()
    different = sorted(name for name in {**found, **expected} if found.get(name) != expected.get(name))
    assert not different, f"other bytes than an undisturbed run's: {different}"


if __name__ == "__main__":
    with tempfile.TemporaryDirectory(prefix="z2p-soak-") as place:
        soak(Path(place), int(sys.argv[1]), seed=int(sys.argv[2]) if len(sys.argv) > 2 else 0)
