#!/usr/bin/env bash
# h5py 3.16.0 (HDF5 2.0) with libver="latest" writes data sets that h5py 3.11.0 (HDF5 1.14.2), two years older, cannot
# open: "bad version number for layout message". The bounds ("v110", "v110") make files that both read.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
for version in 3.16.0 3.11.0; do
    "${PYTHON:-python3}" -m venv "$version"
    "$version/bin/pip" install --quiet --disable-pip-version-check "h5py==$version" "numpy==1.26.4"
done
3.16.0/bin/python - <<'PY'
import h5py
import numpy as np

for name, bounds in (("latest", "latest"), ("v110", ("v110", "v110"))):
    with h5py.File(f"{name}.h5", "w", libver=bounds) as file:
        file.create_dataset("d", data=np.arange(100.0), chunks=(10,), compression="gzip")
print("written by h5py", h5py.__version__, "HDF5", h5py.version.hdf5_version)
PY
3.11.0/bin/python - <<'PY'
import h5py

outcome = {}
for name in ("latest", "v110"):
    try:
        outcome[name] = float(h5py.File(f"{name}.h5")["d"][()].sum())
    except Exception as error:
        outcome[name] = str(error)
print("read by h5py", h5py.__version__, "HDF5", h5py.version.hdf5_version, outcome)
assert "layout message" in str(outcome["latest"]) and outcome["v110"] == 4950.0
PY
