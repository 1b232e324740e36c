"""Commands that luigi carries out: their help and wrong usage are answered where luigi is not installed."""

import subprocess
import sys

from z2p_renderer.pipeline.cli.options.workspace import COMMAND_HELP

SCRIPT = """
import sys
sys.modules["luigi"] = None  # as though it were not installed
from z2p_renderer.pipeline.cli import main
for words in WORDS:
    try:
        main(words, prog_name="z2p")
    except SystemExit as error:
        print("status", error.code, flush=True)
"""


def run(*words: list[str]) -> str:
    command = [sys.executable, "-c", SCRIPT.replace("WORDS", repr(words))]
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout


def test_help_needs_no_luigi():
    helps = run(*([name, "--help"] for name in COMMAND_HELP))
    parts = helps.split("status 0\n")
    assert len(parts) == len(COMMAND_HELP) + 1
    for name, part in zip(COMMAND_HELP, parts[:-1], strict=True):
        assert f"Usage: z2p {name}" in part and COMMAND_HELP[name].split("\n")[0].split(";")[0][:40] in part
        assert ("--port" if name == "scheduler" else "--workspace") in part


def test_a_wrong_option_is_reported_without_luigi():
    assert "status 2" in run(["gc", "--yess"])
