#!/usr/bin/env bash
# pymeshlab 2025.7.post1 reads an .xyz of six columns as points with normals, but one of seven (x y z, intensity, r g b)
# or a .pts gives an empty mesh: load_new_mesh returns as though all were well.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check pymeshlab==2025.7.post1 numpy==2.3.5
venv/bin/python - <<'PY'
import pymeshlab


def count(name, rows):
    with open(name, "w") as file:
        file.write(rows)
    meshes = pymeshlab.MeshSet()
    meshes.load_new_mesh(name)
    return meshes.current_mesh().vertex_number()


six = count("six.xyz", "0 0 0 0 0 1\n1 0 0 0 0 1\n0 1 0 0 0 1\n")
seven = count("seven.xyz", "0 0 0 12 255 0 0\n1 0 0 12 0 255 0\n0 1 0 12 0 0 255\n")
pts = count("scan.pts", "3\n0 0 0 12 255 0 0\n1 0 0 12 0 255 0\n0 1 0 12 0 0 255\n")
print("vertices of six columns:", six, "of seven:", seven, "of a .pts:", pts)
assert (six, seven, pts) == (3, 0, 0)
PY
