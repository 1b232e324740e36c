#!/usr/bin/env bash
# laspy 2.7.0: laspy.create() makes a header with scales of 0.01, so coordinates assigned to it are rounded to a
# hundredth of a unit without a word: an object of some millimetres becomes a few lattice points.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check laspy==2.7.0 numpy==2.3.5
venv/bin/python - <<'PY'
import laspy
import numpy as np

cloud = laspy.create()
cloud.x = np.linspace(0, 0.02, 9)
read = np.asarray(cloud.x)
print(laspy.__version__, "scales", cloud.header.scales.tolist(), "places", sorted({round(float(x), 6) for x in read}))
assert cloud.header.scales.tolist() == [0.01] * 3 and len(np.unique(read)) == 3
PY
