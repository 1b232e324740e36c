"""The scans that a command's inputs stand for: files, folders, globs, and standard input."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any

import click

STDIN = "-"


def find_input_scans(ctx: click.Context, inputs: tuple[str, ...], options: dict[str, Any], named: bool) -> list[Path]:
    """The files that the inputs stand for; standard input is kept in a temporary file until the command ends.

    `named` is True if the user names the columns of text files.

    Raises:
        ScanError: an input is a URL or matches nothing, or standard input is empty.
        click.UsageError: standard input is named twice.
    """
    from z2p_renderer.storage.scans.clouds import find_scans
    from z2p_renderer.storage.scans.unpack import SPOOL_FOLDER_PREFIX, spool

    if inputs.count(STDIN) > 1:
        raise click.UsageError("- stands for standard input, which can be read only once", ctx)

    def report_passed_over(path: Path) -> None:
        if not options["quiet"]:
            click.echo(_passed_over_line(path), err=True)

    scans = find_scans([text for text in inputs if text != STDIN], options["recursive"], report_passed_over, named)
    if STDIN in inputs:
        folder = ctx.with_resource(tempfile.TemporaryDirectory(prefix=SPOOL_FOLDER_PREFIX))
        scans.append(spool(sys.stdin.buffer, Path(folder)))
    return scans


def _passed_over_line(path: Path) -> str:
    from z2p_renderer.storage.files.printable_names import printable
    from z2p_renderer.storage.scans.unsupported_formats import advice_of

    no_points = "no points in sight; name its columns (--columns) or the file itself to have it read"
    return f"passed over: {printable(path)}: {advice_of(path) or no_points}"
