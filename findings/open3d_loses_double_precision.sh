#!/usr/bin/env bash
# open3d 0.20.0: a point cloud is float64 in memory, but write_point_cloud rounds it to float32 in a PCD file (the PLY and
# XYZ writers do not), and t.geometry.PointCloud.from_legacy rounds it to float32 too. Map coordinates move by half a metre.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check open3d-cpu==0.20.0 numpy==2.3.5
venv/bin/python - <<'PY'
import numpy as np
import open3d as o3d

places = np.array([[500000.123456, 5000000.654321, 10.5], [500001.2, 5000001.3, 11.0]])
cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(places))
off = {}
for kind in ("pcd", "ply"):
    o3d.io.write_point_cloud(f"map.{kind}", cloud)
    off[kind] = float(np.abs(np.asarray(o3d.io.read_point_cloud(f"map.{kind}").points) - places).max())
tensor = o3d.t.geometry.PointCloud.from_legacy(cloud).point.positions
off["tensor"] = float(np.abs(tensor.numpy() - places).max())
print(o3d.__version__, "largest error:", off, "tensor:", tensor.dtype)
assert off["ply"] == 0 and off["pcd"] > 0.1 and off["tensor"] > 0.1 and tensor.dtype == o3d.core.float32
PY
