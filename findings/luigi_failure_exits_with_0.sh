#!/usr/bin/env bash
# luigi 3.8.1: the luigi command exits with 0 when a task raised, and with 0 and a smiling summary when a task ended
# without making its output. [retcode] and check_complete_on_run in the configuration change it.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check luigi==3.8.1 'setuptools<81'
venv/bin/python - <<'PY'
import subprocess

with open("tasks.py", "w") as file:
    file.write('''
import luigi

class Raises(luigi.Task):
    def run(self):
        raise RuntimeError("no")

class MakesNothing(luigi.Task):
    def output(self):
        return luigi.LocalTarget("never_written")

    def run(self):
        pass
''')
outcome = {}
for task in ("Raises", "MakesNothing"):
    words = ["venv/bin/python", "-m", "luigi", "--module", "tasks", task, "--local-scheduler"]
    done = subprocess.run(words, capture_output=True, text=True)
    outcome[task] = (done.returncode, ":)" in done.stderr)
print("task: (exit status, smiles)", outcome)
assert outcome == {"Raises": (0, False), "MakesNothing": (0, True)}
PY
