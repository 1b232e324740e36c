#!/usr/bin/env bash
# pye57 0.4.19 on Linux: an int64 buffer of numpy (its type letter is "l") is written as 32-bit integers, so that zeros
# come between the values and half of them are lost. The same buffer of dtype "q", which is int64 too, is right.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check pye57==0.4.19 numpy==1.26.4
venv/bin/python - <<'PY'
from importlib.metadata import version

import numpy as np
import pye57

lib = pye57.libe57


def buffers(image, values):
    made = lib.VectorSourceDestBuffer()
    made.append(lib.SourceDestBuffer(image, "x", values, len(values), True, True))
    return made


def write(name, values):
    file = pye57.E57(name, mode="w")
    image = file.image_file
    scan, prototype = lib.StructureNode(image), lib.StructureNode(image)
    scan.set("guid", lib.StringNode(image, "{0}"))
    prototype.set("x", lib.IntegerNode(image, 0, 0, 1000))
    points = lib.CompressedVectorNode(image, prototype, lib.VectorNode(image, True))
    scan.set("points", points)
    file.data3d.append(scan)
    writer = points.writer(buffers(image, values))
    writer.write(len(values))
    writer.close()
    file.close()


def read(name):
    file = pye57.E57(name)
    values = np.zeros(6, "q")
    file.get_header(0).points.reader(buffers(file.image_file, values)).read()
    return values.tolist()


wrong, right = np.arange(6, dtype=np.int64) * 10, (np.arange(6) * 10).astype("q")
write("l.e57", wrong)
write("q.e57", right)
print(version("pye57"), "wrote", wrong.tolist(), "as int64:", read("l.e57"), "as q:", read("q.e57"))
assert read("l.e57") == [0, 0, 10, 0, 20, 0] and read("q.e57") == right.tolist(), "pye57 now does otherwise"
PY
