#!/usr/bin/env bash
# h5py 3.16.0: of chunks whose stored bytes have one bit flipped, those compressed by lzf (and uncompressed ones) are read
# without an error, with wrong numbers; gzip and the fletcher32 filter refuse each. lzf keeps no checksum.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check h5py==3.16.0 numpy==2.3.5
venv/bin/python - <<'PY'
import h5py
import numpy as np

numbers = np.random.default_rng(0).normal(size=(64, 64)).astype("f4")


def silently_wrong(**filters):
    with h5py.File("a.h5", "w") as file:
        data = file.create_dataset("d", data=numbers, chunks=(16, 64), **filters)
        chunk = data.id.get_chunk_info(1)
    whole, silent, tried = open("a.h5", "rb").read(), 0, 0
    for place in range(0, chunk.size, chunk.size // 40):
        damaged = bytearray(whole)
        damaged[chunk.byte_offset + place] ^= 1 << place % 8
        with open("b.h5", "wb") as file:
            file.write(damaged)
        tried += 1
        try:
            with h5py.File("b.h5") as file:
                silent += not np.array_equal(file["d"][()], numbers)
        except OSError:
            pass
    return silent, tried


outcome = {name: silently_wrong(**filters) for name, filters in {
    "lzf": {"compression": "lzf"}, "gzip": {"compression": "gzip"}, "lzf and fletcher32": {"compression": "lzf", "fletcher32": True},
}.items()}
print(h5py.__version__, "read wrongly without an error, of those tried:", outcome)
assert outcome["lzf"][0] == outcome["lzf"][1] > 30 and outcome["gzip"][0] == outcome["lzf and fletcher32"][0] == 0
PY
