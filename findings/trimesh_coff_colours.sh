#!/usr/bin/env bash
# trimesh 5.2.0 reads a COFF file (OFF with a colour at each vertex), but drops the colours without a warning:
# the mesh has no visual kind, and asking for vertex colours gives its default grey.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check trimesh==5.2.0 numpy==2.3.5
venv/bin/python - <<'PY'
import io

import trimesh

text = "COFF\n3 1 0\n0 0 0 255 0 0 255\n1 0 0 0 255 0 255\n0 1 0 0 0 255 255\n3 0 1 2\n"
mesh = trimesh.load(io.BytesIO(text.encode()), file_type="off")
colors = mesh.visual.vertex_colors[:, :3].tolist()
print(trimesh.__version__, "kind of visual:", mesh.visual.kind, "colours:", colors)
assert len(mesh.vertices) == 3 and mesh.visual.kind is None and colors == [[102, 102, 102]] * 3
PY
