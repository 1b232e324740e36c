#!/usr/bin/env bash
# pye57 0.4.19: write_scan_raw stores colours in 8 bits and takes 16-bit ones modulo 256 without an error: 300 is written
# as 44, and 65280 (bright, of 16 bits) as 0.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check pye57==0.4.19 numpy==2.3.5
venv/bin/python - <<'PY'
import numpy as np
import pye57

colors = np.array([0, 255, 300, 65280, 65535], np.uint16)
file = pye57.E57("colours.e57", mode="w")
data = {f"cartesian{axis}": np.arange(5) * 1.0 for axis in "XYZ"}
file.write_scan_raw(data | {f"color{name}": colors for name in ("Red", "Green", "Blue")})
file.close()
read = pye57.E57("colours.e57").read_scan_raw(0)["colorRed"].tolist()
print("written", colors.tolist(), "read", read)
assert read == [0, 255, 44, 0, 255]
PY
