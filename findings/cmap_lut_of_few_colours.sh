#!/usr/bin/env bash
# cmap 0.8.0: Colormap.lut(N) is documented to return N colours, but for a map of fewer colours it returns only those,
# so an index computed for N levels is out of range, or takes the wrong colour. Its own __call__ spreads them.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check cmap==0.8.0
venv/bin/python - <<'PY'
import cmap
import numpy as np

qualitative, continuous = cmap.Colormap("tab10"), cmap.Colormap("viridis")
print(cmap.__version__, "lut(256):", qualitative.lut(256).shape, continuous.lut(256).shape)
spread = len(np.unique(qualitative(np.linspace(0, 1, 256)), axis=0))
print("colours of 256 values through the map itself:", spread)
assert qualitative.lut(256).shape == (10, 4) and continuous.lut(256).shape == (256, 4), "cmap now does otherwise"
assert spread == 10, "cmap now does otherwise"
PY
