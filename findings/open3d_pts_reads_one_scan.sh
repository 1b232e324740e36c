#!/usr/bin/env bash
# open3d 0.20.0 reads the first block of a PTS file only: files of several scans, each with a count of its own before it
# (as scanners' software joins them), lose all others without an error or a warning about them.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check open3d-cpu==0.20.0 numpy==2.3.5
venv/bin/python - <<'PY'
import numpy as np
import open3d as o3d

with open("two.pts", "w") as file:
    file.write("2\n0 0 0 100 255 0 0\n1 0 0 100 0 255 0\n3\n0 0 5 100 0 0 255\n1 0 5 100 9 9 9\n2 0 5 100 9 9 9\n")
points = np.asarray(o3d.io.read_point_cloud("two.pts").points)
print(o3d.__version__, "points read of 5:", points.tolist())
assert points.tolist() == [[0, 0, 0], [1, 0, 0]]
PY
