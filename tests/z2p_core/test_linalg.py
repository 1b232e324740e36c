"""Points turned and measured along axes, and no thread that spins afterwards."""

import os
import subprocess
import sys

import numpy as np
import pytest

from z2p_core.linalg import bounding_box, dot_axis, rotate_points


@pytest.mark.parametrize("kind, close", [(np.float32, 1e-6), (np.float64, 1e-14)])
def test_they_are_the_products_of_matrices(kind, close):
    rng = np.random.default_rng(0)
    points, rotation = rng.normal(size=(1000, 3)).astype(kind), rng.normal(size=(3, 3)).astype(kind)
    assert rotate_points(points, rotation).dtype == dot_axis(points, rotation[0]).dtype == kind
    np.testing.assert_allclose(rotate_points(points, rotation), points @ rotation.T, atol=20 * close)
    np.testing.assert_allclose(rotate_points(points, rotation[:2]), points @ rotation[:2].T, atol=20 * close)
    np.testing.assert_allclose(dot_axis(points, rotation[1]), points @ rotation[1], atol=20 * close)


def test_the_extent_is_the_least_and_the_largest_of_each_axis():
    points = np.random.default_rng(0).normal(size=(100, 3))
    low, high = bounding_box(points)
    np.testing.assert_array_equal(low, points.min(0))
    np.testing.assert_array_equal(high, points.max(0))


SPINNING = """
import sys, time
from pathlib import Path
import numpy as np
from z2p_renderer.pipeline.inference.input_buffers import draw_buffers
from z2p_renderer.pipeline.placement.options import PlacementOptions
from z2p_renderer.pipeline.placement.place_scan import place_scan
from z2p_renderer.plugins.gbuffers.surfels import Surfels
from z2p_renderer.plugins.zbuffers.splats import SplatPyramid
from z2p_renderer.storage.scans.clouds import Scan
from z2p_core.camera import Camera
from z2p_core.scene import SceneDescription

def idle():  # milliseconds of processor time in a tenth of a second without work
    began = time.process_time()
    time.sleep(0.1)
    return 1000 * (time.process_time() - began)

points = np.random.default_rng(0).normal(size=(50_000, 3))
rest = idle()
placed = place_scan(Scan(points, 0, ""), ".ply", PlacementOptions())
draw_buffers(placed.cloud, Camera(64, 64, 20), SceneDescription(), SplatPyramid(), Surfels())
after = idle()
points @ points[0]
print(rest, after, idle())
"""


@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="one core has no second one to spin on")
def test_a_placed_and_drawn_cloud_leaves_no_thread_spinning():
    environment = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    done = subprocess.run([sys.executable, "-c", SPINNING], env=environment, capture_output=True, text=True, check=True)
    rest, after, blas = map(float, done.stdout.split())
    if blas < 50:
        pytest.skip(f"the BLAS of this numpy does not spin ({blas:.0f} ms of 100)")
    assert rest < 20 and after < 20


@pytest.mark.parametrize("entry", ["z2p_renderer.pipeline.cli", "workflows"])
@pytest.mark.parametrize("asked, expected", [(None, "1"), ("3", "3")])
def test_commands_limit_blas_to_one_thread_by_default(entry, asked, expected):
    environment = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    environment |= {"OPENBLAS_NUM_THREADS": asked} if asked else {}
    code = f"""
import os, sys
class Watch:  # numpy reads the variable once, when it is first imported
    def find_spec(self, name, path=None, target=None):
        if name == "numpy" and not told:
            told.append(os.environ.get("OPENBLAS_NUM_THREADS"))
told = []
sys.meta_path.insert(0, Watch())
import {entry}, numpy
print(told[0])
"""
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.split() == [expected]
