#!/usr/bin/env bash
# meshio 5.3.5 cannot read a binary PLY with properties of type ushort, one of the eight types of the format's first
# description: it fails with a bare KeyError 'ushort', while uint16, the newer name of the same type, is read.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check meshio==5.3.5 numpy==2.3.5
venv/bin/python - <<'PY'
import struct

import meshio

header = "ply\nformat binary_little_endian 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n"
outcome = {}
for kind in ("ushort", "uint16"):
    with open(f"{kind}.ply", "wb") as file:
        file.write((header + f"property {kind} red\nend_header\n").encode())
        file.write(struct.pack("<fffHfffH", 0, 1, 2, 40000, 3, 4, 5, 7))
    try:
        outcome[kind] = meshio.read(f"{kind}.ply").point_data["red"].tolist()
    except Exception as error:
        outcome[kind] = repr(error)
print(meshio.__version__, outcome)
assert outcome == {"ushort": "KeyError('ushort')", "uint16": [40000, 7]}
PY
