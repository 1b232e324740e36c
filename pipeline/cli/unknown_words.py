"""Error messages for unknown options and commands, with a suggestion if it is clear what was meant."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Sequence
from glob import glob, has_magic
from pathlib import Path

import click

from z2p_core.errors.did_you_mean import closest_name, suggest_name

RENDER_COMMAND = "render"
_COMMAND_SYNONYMS = {
    "render": "draw infer inference predict run picture image shade plot show view visualize visualise convert",
    "animate": "animation gif webp mp4 video movie turntable spin rotate loop orbit",
    "rerender": "redraw again re-render change",
    "info": "inspect metadata record settings identify",
    "evaluate": "eval metrics benchmark score",
    "pipeline": "train fit full-pipeline learn",
    "ablate": "ablation ablations",
    "gc": "clean cleanup prune garbage-collect",
    "verify": "check validate fsck",
    "formats": "readers list-formats types",
    "plugins": "list-plugins extensions plugin",
    "report": "bug bug-report bugreport doctor versions env",
    "completion": "completions shell-completion autocomplete",
    "--help": "help usage man",
    "--version": "version",
}
"""Command -> the names that other programs give it."""
_NOTES_ON_ABSENT_OPTIONS = {
    "A line is printed for each file; set Z2P_DEBUG=1 in the environment for more": "verbose v debug",
    "Everything runs on the CPU; --engine chooses what runs the network": "gpu cuda",
    "The camera's field of view is 40 degrees always": "fov focal focal-length",
    "--margin leaves more or less free around the object": "zoom distance scale",
    "A surface is drawn, not points": "point-size pointsize point-radius radius",
    "None are needed, and none are read": "normals",
    "The shadow belongs to the picture": "shadow shadows no-shadow",
    "--frames and --fps make a loop's length": "duration length",
    "Moving pictures are made by z2p animate": "frames fps motion turntable loop video animation",
    "--resolution counts pixels": "dpi ppi",
    "The same input gives the same picture, without a seed": "seed",
}
"""Message -> the options of other programs, unknown to z2p, that it answers."""


def unknown_option_error(error: click.NoSuchOption) -> click.UsageError:
    """The error with the option that was meant, in place of click's suggestions of similar spelling."""
    if error.ctx is None:
        return error
    name = error.option_name.lstrip("-").partition("=")[0]
    flags = [flag for parameter in error.ctx.command.get_params(error.ctx) for flag in parameter.opts]
    known = {flag.removeprefix("--"): flag for flag in flags if flag.startswith("--")}
    plain = name.replace("_", "-").lower()
    suggestion = suggest_name(plain, known)
    note = None if suggestion is None else f"Did you mean --{suggestion}?"
    if note is None:
        note = next((message for message, names in _NOTES_ON_ABSENT_OPTIONS.items() if plain in names.split()), None)
    if "output" in known and plain in ("i", "input", "inputs", "in", "file", "scan"):
        note = "Inputs are named without an option"
    return click.UsageError(f"No such option: {error.option_name}" + (f". {note}" if note else ""), error.ctx)


def unknown_command_message(words: Sequence[str], commands: Iterable[str]) -> str:
    """Message about arguments that begin with no command: the first is a scan, or which command was meant."""
    word, known = words[0], list(commands)
    if Path(word).exists() or (has_magic(word) and glob(word)):  # noqa: PTH207 - takes absolute ones
        return f"{word!r} is no command but an input. Did you mean: z2p {RENDER_COMMAND} {shlex.join(words)}"
    name = word.lower().replace("_", "-")
    suggestion = next((command for command, words in _COMMAND_SYNONYMS.items() if name in words.split()), None)
    suggestion = suggestion or closest_name(name, known)
    if name in known or suggestion:
        return f"No such command: {word}. Did you mean: z2p {name if name in known else suggestion}"
    if Path(word).suffix or "/" in word:
        return f"{word!r} is neither a command nor a file that is there; z2p {RENDER_COMMAND} FILE draws a file"
    return f"No such command: {word}; z2p --help lists them"


def misplaced_option_error(error: click.NoSuchOption) -> click.UsageError:
    """The error for an option in front of the command."""
    name = closest_name(error.option_name, ("--help", "--version"))
    if name is not None:
        return click.UsageError(f"No such option: {error.option_name}. Did you mean {name}?", error.ctx)
    return click.UsageError(f"No such option: {error.option_name}. Options of a command follow its name, as in "
                            f"z2p {RENDER_COMMAND} INPUT {error.option_name} ...", error.ctx)  # fmt: skip
