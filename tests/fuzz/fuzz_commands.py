"""The command line with odd values of its options: it does what was asked, or says in a line what is wrong."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import click
import numpy as np
from made_texts import points, rows

import z2p_core
from z2p_renderer.pipeline.cli import LazyGroup, main

CASE, ERRORS = "case.json", "errors.txt"
COMMANDS = ("render", "render", "render", "animate", "info", "rerender")
ODD = (
    "", " ", "0", "-1", "1", "1.5", "nan", "inf", "-inf", "1e400", "1e-320", "9" * 400, "0x10", "1,2,3", "1,2", ",",
    ",,,", "none", "auto", "True", "é", "点", "a\nb", "\x1b[31m", "x" * 3000, "--", "-", "%s", "{}", "'", '"', "10%",
    "1/2", "٣", "+Y", "y", "#ggg", "#12345", "rgb(1,2,3)", "red,blue", "4x3", "4x", "x3", "0x0", "99999x99999",
    "1e5x2", "64", "48,32", "0.1,0.2,0.3"
)  # fmt: skip
"""Values that few mean."""
SOUND = {
    "--up": ("+Y", "-z", "auto", "y"), "--view": ("front", "30,20", "-400", "sensor"), "--azimuth": ("20", "-0.5"),
    "--color": ("teal", "#123456", "0.1,0.2,0.3"), "--elevation": ("0", "80"), "--light": ("3.6,30,45",),
    "--metallic": ("1",), "--roughness": ("0.2",), "--background": ("white", "transparent"), "--supersample": ("2",),
    "--fit": ("tight", "frame"),
    "--margin": ("0.2", "10%"), "--smooth": ("auto", "0.1"), "--cut-top": ("10",), "--columns": ("x,y,z", "y,z,x"),
    "--format": ("webp", "png"), "--sheet": ("2x1",), "--palette": ("greys",), "--frames": ("3",), "--fps": ("12",),
    "--motion": ("light",), "--jobs": ("1",), "--weights": ("regular", "auto"), "--engine": ("onnxruntime",),
}  # fmt: skip
PATHS = ("out", "out.png", "out.webp", "out.gif", "a.xyz", "folder", "camera.json", "nowhere/x.png", "", "out\n.png",
         "x" * 300, "b.xyz/out.png", "out.tiff", ".png", "é.png")  # fmt: skip
"""Names of files, none outside of the folder."""
WITH_PATHS = {"--output", "--load-camera", "--save-camera", "--input"}


def make(rng: np.random.Generator, folder: Path) -> None:
    """Two scans, a picture of one, and words of a command."""
    (folder / "a.xyz").write_text(rows(points(rng, int(rng.choice([40, 300])))))
    (folder / "b.xyz").write_text(rows(points(rng, int(rng.choice([2, 40])))))
    (folder / "folder").mkdir()
    z2p_core.render(folder / "a.xyz", size=48).save(folder / "picture.png")
    command = str(rng.choice(COMMANDS))
    words = [command, *_inputs(command, rng)]
    options = [option for option in _options(command) if option.opts[0] not in ("--json", "--help", "-h", "--quiet")]
    for _ in range(int(rng.integers(5)) if options else 0):
        words += _option(options[rng.integers(len(options))], rng)
    if rng.random() < 0.1:
        words.insert(int(rng.integers(1, len(words) + 1)), ODD[rng.integers(len(ODD))])
    words += {"animate": ["--size", "48", "--frames", "3"], "info": []}.get(command, ["--size", "48"])
    (folder / CASE).write_text(json.dumps([word for word in words if "\0" not in word]))


def check(folder: Path) -> str:
    """What came of it."""
    words = json.loads((folder / CASE).read_text())
    home = Path.cwd()
    os.chdir(folder)
    try:
        status, said = _run(words, folder / ERRORS)
    finally:
        os.chdir(home)
    assert status in (0, 1, 2, 75), f"exit status {status}: {said}"
    assert "Traceback" not in said and "Error: unexpected " not in said, said[-1500:]
    errors = [line for line in said.splitlines() if line.startswith(("Error:", "Warning:"))]
    assert status == 0 or said.strip(), f"exit status {status} without a word"
    longest = 2000 + sum(map(len, words))  # click repeats what it does not take
    assert all(len(line) < longest for line in errors), f"a message of {max(map(len, errors))} characters"
    return f"{words[0]} {status}"


def _run(words: list[str], errors: Path) -> tuple[int, str]:
    """The exit status of a command, and all that it says."""
    kept = os.dup(1), os.dup(2)
    with errors.open("w") as file:
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
        try:
            main.main(words, prog_name="z2p")
            status = 0
        except SystemExit as error:
            status = error.code if isinstance(error.code, int) else 1
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os.dup2(kept[0], 1)
            os.dup2(kept[1], 2)
            for number in kept:
                os.close(number)
    return status, errors.read_text(errors="replace")


def _inputs(command: str, rng: np.random.Generator) -> list[str]:
    if command in ("info", "rerender"):
        return [str(rng.choice(["picture.png", "picture.png", "picture.png", "a.xyz", "nowhere.png", ""]))]
    ways = (["a.xyz"], ["a.xyz", "b.xyz"], ["*.xyz"], ["."], ["nowhere.ply"], ["picture.png"])
    return ways[rng.integers(len(ways)) if rng.random() < 0.5 else 0]


def _options(command: str) -> list[click.Option]:
    assert isinstance(main, LazyGroup)
    found = main.get_command(click.Context(main), command)
    assert found is not None
    return [option for option in found.params if isinstance(option, click.Option)]


def _option(option: click.Option, rng: np.random.Generator) -> list[str]:
    """An option's name, now and then misspelt, and a value."""
    long = [name for name in option.opts if name.startswith("--")]
    name = str(rng.choice(long or option.opts))
    if rng.random() < 0.05:
        name = name[:-1] + str(rng.choice(["", "x", "s"]))
    if option.is_flag:
        return [name]
    if name in WITH_PATHS:
        return [name, PATHS[rng.integers(len(PATHS))]]
    sound = SOUND.get(name, ())
    value = sound[rng.integers(len(sound))] if sound and rng.random() < 0.6 else ODD[rng.integers(len(ODD))]
    return [f"{name}={value}"] if rng.random() < 0.3 else [name, value]
