#!/usr/bin/env bash
# onnxruntime 1.31.1 (Linux wheel): running one model on the CPU leaves an identity and a data base for reports of use in
# ~/.cache/Microsoft, though nothing of it was asked for; ORT_DISABLE_TELEMETRY=1 before the import keeps it from that.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check onnxruntime==1.31.1 onnx==1.23.2 numpy==2.3.5
venv/bin/python - <<'PY'
import os
import subprocess

program = '''
import numpy, onnxruntime
from onnx import TensorProto, helper
value = [helper.make_tensor_value_info(name, TensorProto.FLOAT, [3]) for name in "xy"]
graph = helper.make_graph([helper.make_node("Relu", ["x"], ["y"])], "g", value[:1], value[1:])
model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
onnxruntime.InferenceSession(model.SerializeToString()).run(None, {"x": numpy.zeros(3, "f4")})
'''
left = {}
for setting in ("", "1"):
    home = os.path.abspath(f"home{setting}")
    os.mkdir(home)
    environment = {"PATH": os.environ["PATH"], "HOME": home} | ({"ORT_DISABLE_TELEMETRY": setting} if setting else {})
    subprocess.run(["venv/bin/python", "-c", program], env=environment, check=True)
    left[setting] = sorted(name for _, _, names in os.walk(home) for name in names)
print("left in the home folder:", left)
assert "deviceid" in left[""] and not left["1"]
PY
