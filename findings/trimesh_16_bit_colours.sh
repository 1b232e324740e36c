#!/usr/bin/env bash
# trimesh 5.2.0 keeps only the low byte of 16-bit vertex colours of a PLY file: 65535 becomes 255, but 256 becomes 0.
# One would expect the high byte, or colours scaled to 8 bits. No warning is given.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check trimesh==5.2.0 numpy==2.3.5
venv/bin/python - <<'PY'
import io

import numpy as np
import trimesh

header = "ply\nformat binary_little_endian 1.0\nelement vertex 3\n"
header += "".join(f"property float {name}\n" for name in "xyz")
header += "".join(f"property ushort {name}\n" for name in ("red", "green", "blue")) + "end_header\n"
rows = np.zeros(3, [("place", "<f4", 3), ("color", "<u2", 3)])
rows["place"] = np.eye(3)
rows["color"] = [[65535, 256, 512], [4660, 255, 0], [32768, 32769, 1]]
cloud = trimesh.load(io.BytesIO(header.encode() + rows.tobytes()), file_type="ply")
read = np.asarray(cloud.colors)[:, :3]
print(trimesh.__version__, "wrote", rows["color"].tolist(), "read", read.tolist())
assert (read == (rows["color"] & 255)).all(), "trimesh now does otherwise"
PY
