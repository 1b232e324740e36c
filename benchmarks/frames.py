"""Times frames of loops beside pictures of the same turned cloud: ``python benchmarks/frames.py``.

Three ways in turns, in one process: a picture of the turned cloud by itself; a frame of a turntable, whose light stays
with the camera; and a frame of an orbit, whose light stays with the object. Prints medians and ratios. Only ratios mean
anything on a busy machine.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable

import numpy as np
from inputs import SHIPPED_WEIGHTS, make_cloud

from z2p_core.camera import turn
from z2p_renderer.pipeline.inference.prepared_render import PreparedRender, fixed_to_object
from z2p_renderer.pipeline.inference.renderer import Renderer

STEP_DEGREES = 7.5
"""How far the cloud turns between frames."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--points", type=float, default=5_000)
    parser.add_argument("--frames", type=int, default=24)
    parser.add_argument("--weights", default=SHIPPED_WEIGHTS)
    parser.add_argument("--busy", action="store_true", help="Measure processor time of all cores: for busy machines.")
    options = parser.parse_args()
    renderer, cloud = Renderer(options.weights), make_cloud(int(options.points))
    print("| side | alone, ms | turntable, ms | orbit, ms | turntable, times as many a second | orbit |")
    print("|---|--:|--:|--:|--:|--:|")
    for side in (256, 512):
        clock = time.process_time if options.busy else time.perf_counter
        alone, turntable, orbit = measure(renderer, cloud, side, options.frames, clock)
        print(f"| {side} | {alone:.1f} | {turntable:.1f} | {orbit:.1f} | {alone / turntable:.2f} "
              f"| {alone / orbit:.2f} |")  # fmt: skip


def measure(
    renderer: Renderer, cloud: np.ndarray, side: int, frames: int, clock: Callable[[], float]
) -> list[float]:  # fmt: skip
    """Median milliseconds of a picture alone, of a turntable's frame and of an orbit's."""
    light = renderer.settings()["light"]
    with_camera, with_object = PreparedRender(renderer, cloud), PreparedRender(renderer, cloud)
    ways: list[Callable[[float], object]] = [
        lambda azimuth: renderer.render(cloud @ turn(azimuth).astype("float32").T, None, side, side),
        lambda azimuth: with_camera.render(None, side, side, azimuth),
        lambda azimuth: with_object.render({"light": fixed_to_object(light, azimuth)}, side, side, azimuth),
    ]
    times: list[list[float]] = [[] for _ in ways]
    for number in range(-1, frames):  # one round to warm up
        for way, taken in zip(ways, times, strict=True):
            began = clock()
            way(STEP_DEGREES * number)
            if number >= 0:
                taken.append(1e3 * (clock() - began))
    return [statistics.median(taken) for taken in times]


if __name__ == "__main__":
    main()
