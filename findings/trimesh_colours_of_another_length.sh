#!/usr/bin/env bash
# trimesh 5.2.0 takes colours of another number than the points of a PointCloud without a word, and gives them back so:
# code that pairs points with colours gets them shifted or fails far from the cause.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check trimesh==5.2.0 numpy==2.3.5
venv/bin/python -W error - <<'PY'
import numpy as np
import trimesh

points = np.random.default_rng(0).random((50, 3))
cloud = trimesh.PointCloud(points, colors=np.zeros((49, 3), np.uint8))
print(trimesh.__version__, "points", cloud.vertices.shape, "colours", cloud.colors.shape)
assert cloud.vertices.shape == (50, 3) and cloud.colors.shape == (49, 4), "trimesh now does otherwise"
PY
