#!/usr/bin/env bash
# bpy 5.1.0, whose wheels are for Python 3.13 alone, asks for numpy < 2: no such numpy has a wheel for 3.13, so pip takes
# its source and compiles it for minutes, or fails. Only the metadata is read here.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check pip==26.0.1
venv/bin/python - <<'PY'
import json
import subprocess

def report(*words):
    base = ["venv/bin/python", "-m", "pip", "install", "--quiet", "--dry-run", "--ignore-installed", "--report", "report.json", "--target", "t",
            "--only-binary", ":all:", "--python-version", "3.13", "--implementation", "cp", "--disable-pip-version-check"]
    for platform in ("manylinux_2_28_x86_64", "manylinux_2_17_x86_64", "manylinux2014_x86_64"):
        base += ["--platform", platform]
    done = subprocess.run([*base, *words], capture_output=True, text=True)
    return done.returncode, done.stderr

status, told = report("--no-deps", "bpy==5.1.0")
assert status == 0, told
needs = json.load(open("report.json"))["install"][0]["metadata"]["requires_dist"]
print("bpy 5.1.0 needs", needs)
assert any(line.replace(" ", "").startswith("numpy") and "<2" in line for line in needs)
status, told = report("--no-deps", "numpy<2")
print("a wheel of numpy < 2 for 3.13:", status == 0, told.strip().splitlines()[-1:])
assert status != 0
PY
