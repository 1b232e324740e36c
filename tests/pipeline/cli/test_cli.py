"""The command line as a whole: help, errors, suggestions, listings, and commands that start processes."""

from __future__ import annotations

import json
import os
import shlex
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result

from z2p_core import registry
from z2p_core.up_axis.axis_names import parse_up_axis
from z2p_renderer.pipeline.cli import COMMANDS


def test_help_and_version_import_nothing_heavy() -> None:
    code = (
        "import sys; from z2p_renderer.pipeline.cli import main\n"
        "for words in (['--help'], ['--version']):\n"
        "    try: main(words)\n"
        "    except SystemExit as end: assert end.code == 0, end\n"
        "heavy = {'torch', 'numpy', 'PIL', 'tqdm', 'luigi', 'safetensors', 'importlib.metadata'} & set(sys.modules)\n"
        "assert not heavy, heavy"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert all(name in done.stdout for name in COMMANDS)
    assert "z2p 0." in done.stdout


@pytest.mark.parametrize("name", COMMANDS)
def test_every_subcommand_has_help(z2p: Callable[..., Result], name: str) -> None:
    result = z2p(name, "--help")
    assert result.exit_code == 0, result.output
    assert f"z2p {name}" in result.output or f"main {name}" in result.output


def test_an_unknown_command_is_wrong_usage(z2p: Callable[..., Result]) -> None:
    assert z2p("rnder").exit_code == 2


def test_render_is_run_inference(z2p: Callable[..., Result]) -> None:
    assert COMMANDS["render"][0] == COMMANDS["run-inference"][0] and next(iter(COMMANDS)) == "render"
    lines = [z2p(name, "--help").output.partition("\n")[2] for name in ("render", "run-inference")]
    assert lines[0] == lines[1] and "z2p render scans/" in lines[0]


def test_a_scan_in_place_of_a_command_suggests_render(z2p: Callable[..., Result], tmp_path: Path) -> None:
    scan = tmp_path / "my scan.ply"
    scan.touch()
    for words in ((scan, "-o", "a.png"), (tmp_path,), (tmp_path / "*.ply",)):
        result = z2p(*words)
        assert result.exit_code == 2 and f"z2p render {shlex.join(map(str, words))}" in result.stderr
    assert "neither a command nor a file that is there" in z2p(tmp_path / "none.ply").stderr


@pytest.mark.parametrize(
    ("word", "meant"),
    [("draw", "render"), ("Render", "render"), ("run_inference", "run-inference"), ("rendr", "render"),
     ("gif", "animate"), ("train", "pipeline"), ("help", "--help"), ("version", "--version"), ("statsu", "status")],
)  # fmt: skip
def test_an_unknown_command_gets_a_suggestion(z2p: Callable[..., Result], word: str, meant: str) -> None:
    result = z2p(word)
    assert result.exit_code == 2 and result.stderr.endswith(f"Did you mean: z2p {meant}\n")


@pytest.mark.parametrize(
    ("words", "message"),
    [(("render", "--out", "x"), "--output?"), (("render", "--output-dir=x"), "--output?"),
     (("render", "--colour", "red"), "--color?"), (("render", "--width", 9), "--resolution?"),
     (("render", "--transparent"), "--background transparent?"), (("render", "-j", 4), "--jobs?"),
     (("render", "--frames", 9), "z2p animate"), (("render", "--input", "x"), "Inputs are named without an option"),
     (("animate", "--turntable"), "--motion turn?"), (("rerender", "--input_file", "x"), "No such option"),
     (("evaluate", "--size", 9), "--resolution?"), (("-o", "x.png", "a.ply"), "z2p render INPUT -o"),
     (("--versoin",), "--version?")],
    ids=str,
)  # fmt: skip
def test_an_unknown_option_gets_a_suggestion(
    z2p: Callable[..., Result], words: tuple[object, ...], message: str
) -> None:
    result = z2p(*words[:1], "a.ply", *words[1:]) if words[0] in COMMANDS else z2p(*words)
    assert result.exit_code == 2 and message in result.stderr and result.stderr.count("No such option") == 1


def test_a_format_may_be_given_by_its_suffix(
    z2p: Callable[..., Result], tiny_weights: Path, cloud: np.ndarray, tmp_path: Path
) -> None:
    np.save(tmp_path / "a.npy", cloud)
    for name, suffix in (("JPG", ".jpg"), (".tif", ".tif"), ("webp", ".webp")):
        words = ("--format", name, "--background", "None", "--size", 32, "--weights", tiny_weights)
        assert z2p("render", tmp_path / "a.npy", "-o", tmp_path, *words).exit_code == 0
        assert (tmp_path / f"a{suffix}").is_file()
    assert z2p("render", tmp_path / "a.npy", "--format", "bmp").exit_code == 2


@pytest.mark.parametrize(
    ("words", "axis"), [("y", "+Y"), ("Y", "+Y"), ("-z", "-Z"), ("z-up", "+Z"), ("+Xup", "+X"), ("minus y", "-Y"),
                        ("AUTO", "auto"), ("yz", None), ("W", None), ("--y", None), ("", None)],
)  # fmt: skip
def test_up_takes_the_usual_spellings_of_axes(words: str, axis: str | None) -> None:
    assert parse_up_axis(words) == axis


def test_an_option_of_another_meaning_is_not_suggested(z2p: Callable[..., Result]) -> None:
    for words in (("evaluate", "--view", 1), ("render", "a.ply", "--seeds", 1), ("render", "a.ply", "--points", 1)):
        assert "Did you mean" not in z2p(*words).stderr


def test_plugins_and_formats_are_listed(z2p: Callable[..., Result]) -> None:
    rows = json.loads(z2p("plugins", "--json").stdout)
    assert {row["group"] for row in rows} == set(registry.GROUPS)
    [color] = [row for row in rows if row["name"] == "color"]
    assert (color["distribution"], color["version"], color["status"]) == ("z2p-renderer", "1", "ok")
    formats = {row["suffix"]: row["reader"] for row in json.loads(z2p("formats", "--json").stdout)}
    assert {".ply", ".pcd", ".xyz", ".pts", ".obj", ".off", ".npy", ".npz", ".las", ".laz"} <= set(formats)
    assert formats[".ply"] == "ply"
    for name in ("plugins", "formats"):
        result = z2p(name)
        assert result.exit_code == 0
        assert "z2p" in result.output


def test_an_unexpected_error_is_one_line_unless_debugging(
    z2p: Callable[..., Result], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(group: str) -> list[object]:
        raise RuntimeError("a fault\nof two lines")

    monkeypatch.setattr(registry, "installed", fail)
    result = z2p("formats")
    assert result.exit_code == 2
    assert result.stderr == (
        "Error: unexpected RuntimeError: a fault of two lines; run again with Z2P_DEBUG=1 for the traceback\n"
    )
    monkeypatch.setenv("Z2P_DEBUG", "1")
    assert isinstance(z2p("formats").exception, RuntimeError)


def test_a_bug_report_has_versions_and_no_user_name(z2p: Callable[..., Result]) -> None:
    facts = json.loads(z2p("report", "--json").stdout)
    assert facts["packages"]["numpy"].count(".") == 2 and facts["packages"]["torch"] != "-"
    assert facts["weights"]["regular"].startswith("sha256 ")
    assert "color" in facts["plugins"]["controls"] and "BROKEN" not in str(facts["plugins"])
    text = z2p("report").output
    assert str(Path.home()) not in text and str(Path.cwd()) not in text
    assert "z2p\n  version            0." in text


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_scripts_complete_options(z2p: Callable[..., Result], shell: str) -> None:
    result = z2p("completion", shell)
    assert result.exit_code == 0 and "_Z2P_COMPLETE" in result.output
    words = {"bash": {"COMP_WORDS": "z2p run-inference --met", "COMP_CWORD": "2"},
             "zsh": {"COMP_WORDS": "z2p run-inference --met", "COMP_CWORD": "2"},
             "fish": {"COMP_WORDS": "z2p run-inference --met", "COMP_CWORD": "--met"}}[shell]  # fmt: skip
    done = subprocess.run(
        [sys.executable, "-c", "from z2p_renderer.pipeline.cli import main; main(prog_name='z2p')"],
        env={**os.environ, **words, "_Z2P_COMPLETE": f"{shell}_complete"}, capture_output=True, text=True,
    )  # fmt: skip
    assert "--metallic" in done.stdout, done.stderr


def test_help_has_sections_and_rerender_shows_no_defaults(z2p: Callable[..., Result]) -> None:
    text = z2p("run-inference", "--help").output
    places = [text.index(f"\n{heading}:\n") for heading in ("Input", "View", "Picture", "Look", "Output")]
    assert places == sorted(places)
    assert places[3] < text.rindex("--color") < text.rindex("--light") < places[4]
    assert "[default: 3.6,-40,50]" in " ".join(text.split())
    assert "3.6,-40,50]" not in " ".join(z2p("rerender", "--help").output.split())


PATIENT = """
import signal, sys, threading, time
from z2p_renderer.pipeline import cli
import click

signal.signal(signal.SIGINT, signal.default_int_handler)  # where the tests are a background job it would be ignored

@click.command()
def slow():
    threading.Thread(target=time.sleep, args=(30,)).start()
    print("begun", flush=True)
    time.sleep(30)

sys.modules["z2p_renderer.pipeline.cli.commands.slow"] = sys.modules["__main__"]
cli.COMMANDS["slow"] = ("slow:slow", "")
cli.main(["slow"])
"""


def test_a_second_interrupt_ends_the_process_at_once() -> None:
    process = subprocess.Popen([sys.executable, "-c", PATIENT], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                               text=True)  # fmt: skip
    assert process.stdout is not None and process.stdout.readline() == "begun\n"
    process.send_signal(signal.SIGINT)
    assert process.stderr is not None and process.stderr.readline() == "Interrupted.\n"  # two at once count as one
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(1)  # a thread is still at work
    process.send_signal(signal.SIGINT)
    stderr = process.communicate(timeout=20)[1]
    assert process.returncode == 130 and not stderr


@pytest.mark.slow
def test_closed_standard_streams_do_not_spoil_pictures(tiny_weights: Path, scans: Path, tmp_path: Path) -> None:
    words = f"run-inference --weights {tiny_weights} --resolution 64 {scans / 'one.npy'}"
    for number, closed in enumerate(("", "2>&-", "<&- >&- 2>&-")):
        line = f"{sys.executable} -m z2p_renderer.pipeline.cli {words} -o {tmp_path / str(number)} {closed}"
        assert subprocess.run(line, shell=True, capture_output=True).returncode == 0
    pictures = [(tmp_path / str(number) / "one.png").read_bytes() for number in range(3)]
    assert pictures[0] == pictures[1] == pictures[2]
