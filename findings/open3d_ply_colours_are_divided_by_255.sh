#!/usr/bin/env bash
# open3d 0.20.0: the legacy PLY reader divides colours by 255 whatever their type. Float colours of 0 to 1 come out as
# 0 to 0.0039 (black), 16-bit ones as 0 to 257; the tensor reader skips 16-bit ones, with a warning on the console.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check open3d-cpu==0.20.0 numpy==2.3.5
venv/bin/python - <<'PY'
import numpy as np
import open3d as o3d


def write(name, kind, colors):
    header = "ply\nformat binary_little_endian 1.0\nelement vertex 2\n"
    header += "".join(f"property float {axis}\n" for axis in "xyz")
    header += "".join(f"property {kind} {color}\n" for color in ("red", "green", "blue")) + "end_header\n"
    rows = np.zeros(2, [("place", "<f4", 3), ("color", {"float": "<f4", "ushort": "<u2"}[kind], 3)])
    rows["place"], rows["color"] = [[0, 0, 0], [1, 0, 0]], colors
    with open(name, "wb") as file:
        file.write(header.encode() + rows.tobytes())


write("float.ply", "float", [[1, 0.5, 0], [0, 0, 1]])
write("ushort.ply", "ushort", [[65535, 0, 255], [0, 0, 65535]])
floats = np.asarray(o3d.io.read_point_cloud("float.ply").colors)
shorts = np.asarray(o3d.io.read_point_cloud("ushort.ply").colors)
tensor = o3d.t.io.read_point_cloud("ushort.ply")
print(o3d.__version__, "float", floats.tolist(), "ushort", shorts.tolist(), "tensor has colours:", "colors" in tensor.point)
assert np.allclose(floats[0], [1 / 255, 0.5 / 255, 0]) and np.allclose(shorts[0], [257, 0, 1])
assert "colors" not in tensor.point
PY
