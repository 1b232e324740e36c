#!/usr/bin/env bash
# laspy 2.7.0 with lazrs 0.8.2: where a LAZ file is decoded in part (DecompressionSelection), the fields left out are
# neither missing nor zero: every point has the value of its chunk's first point (a chunk is 50,000 points).
# A plot of such a field looks plausible and is wrong.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check laspy==2.7.0 lazrs==0.8.2 numpy==2.3.5
venv/bin/python - <<'PY'
import io

import laspy
import numpy as np
from laspy import DecompressionSelection

header = laspy.LasHeader(point_format=7, version="1.4")
header.scales = [0.001] * 3
cloud = laspy.LasData(header)
count = np.arange(1000)
cloud.x, cloud.y, cloud.z = count * 0.1, count * 0.2, 5 + count * 0.01
cloud.red, cloud.classification = 7 + count, 3 + count % 4
written = io.BytesIO()
cloud.write(written, do_compress=True)
with laspy.open(io.BytesIO(written.getvalue()), decompression_selection=DecompressionSelection.xy_returns_channel()) as file:
    read = file.read()
print(laspy.__version__, "z", set(np.asarray(read.z)), "red", set(np.asarray(read.red)), "class", set(read.classification))
assert np.allclose(read.x, cloud.x)
assert set(np.asarray(read.z)) == {5.0} and set(np.asarray(read.red)) == {7} and set(read.classification) == {3}
PY
