#!/usr/bin/env bash
# trimesh 5.2.0 reads a 4OFF file, whose vertices are homogeneous (x y z w, Geomview's format), as x y z: it drops w
# instead of dividing by it, so the vertex 2 0 0 2 comes out at 2 0 0 rather than at 1 0 0.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check trimesh==5.2.0 numpy==2.3.5
venv/bin/python - <<'PY'
import io

import trimesh

text = "4OFF\n3 1 0\n2 0 0 2\n0 3 0 3\n0 0 4 4\n3 0 1 2\n"
vertices = trimesh.load(io.BytesIO(text.encode()), file_type="off", process=False).vertices.tolist()
print(trimesh.__version__, vertices)
assert vertices == [[2, 0, 0], [0, 3, 0], [0, 0, 4]]
PY
