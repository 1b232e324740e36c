#!/usr/bin/env bash
# pye57 0.4.19: write_scan_raw takes float64 coordinates and stores them in single precision, so map coordinates of
# 500,000 metres come back in steps of 3 cm (5,000,000: of half a metre), though E57 itself has doubles and scaled integers.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check pye57==0.4.19 numpy==2.3.5
venv/bin/python - <<'PY'
import numpy as np
import pye57

places = np.arange(5) + 500000.123456
file = pye57.E57("map.e57", mode="w")
file.write_scan_raw({"cartesianX": places, "cartesianY": places * 10, "cartesianZ": np.zeros(5)})
file.close()
read = pye57.E57("map.e57").read_scan_raw(0)
off = [float(np.abs(read[name] - given).max()) for name, given in (("cartesianX", places), ("cartesianY", places * 10))]
print("dtype", read["cartesianX"].dtype, "off by", off)
assert (read["cartesianX"] == places.astype(np.float32)).all() and 0.001 < off[0] < 0.02 and off[1] > 0.1
PY
