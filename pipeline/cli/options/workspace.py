"""What `z2p status`, `verify`, `gc`, `adopt` and `scheduler` are called with: their options and their help.

`workflows.commands` does what they ask; stated here, both are shown where luigi is not installed as well.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

HELP = {
    "status": """List every step as fresh, stale or missing, with the reason. Writes nothing.

    \b
    z2p status --config my.toml --meshes meshes/
    z2p status --config configs/report.toml --meshes kept-aside/
    """,
    "verify": """Compare every result with its digests; a damaged one is put aside and made again by the next run.

    One that a running pipeline is at work on is left to it.

    Exit status 1 when a result was damaged.
    """,
    "gc": "List what no kept configuration and no running pipeline needs; with --yes, remove it.",
    "adopt": """Vouch for results that older code made: take them over where nothing but code or packages changed.

    STAGE is one or more of shapes, sample, render, shard, train, evaluate and reference (the ground truth of the
    evaluation), of ablations compare as well, or of a report measure, scans, trust, times and report; without one, all
    of them. Without --because it lists what could be taken over and changes nothing. Results whose parameters, meshes
    or plugin versions differ are never taken over.
    """,
    "scheduler": "Start luigi's central scheduler, which shares the work among pipelines on several machines.",
}
"""Command -> its help."""


def _workspace_option() -> list[click.Parameter]:
    folder = click.Path(file_okay=False, path_type=Path)
    return [click.Option(["--workspace"], default="runs", show_default=True, metavar="DIR",
                         help="Folder of all results.", type=folder)]  # fmt: skip


def _plan_options() -> list[click.Parameter]:
    """The options of `z2p pipeline`, `ablate` and `report-paper` that say which results are meant."""
    named = (
        ("--config", "TOML", "Settings of every stage; the quick ones without it."),
        ("--meshes", "DIR", "Folder of meshes to train on; shapes of the project's own without it."),
        ("--evaluate-meshes", "DIR", "Folder of meshes kept aside for the evaluation."),
        ("--scans", "DIR", "Of a report: folder of scans to show."),
        ("--weights", "NAMES", "Of a report: the weights that take part."),
        ("--sweeps", "NAMES", "Of a report: only these sweeps."),
    )
    report = click.Option(["--report"], is_flag=True, help="The results of z2p report-paper; so it is with a report's "
                          "config, and with its own options.")  # fmt: skip
    options = [click.Option([name], default="", metavar=metavar, help=text) for name, metavar, text in named]
    return [*_workspace_option(), *options, report]


def _json_option() -> click.Parameter:
    return click.Option(["--json", "in_json"], is_flag=True, help="A JSON list instead of a table.")


def command_parameters(name: str) -> list[click.Parameter]:
    """The arguments and options of a command."""
    match name:
        case "status":
            stale = click.Option(["--stale", "only_stale"], is_flag=True, help="Only what a run would make.")
            return [*_plan_options(), _json_option(), stale]
        case "verify":
            return _workspace_option()
        case "gc":
            drop = click.Option(["--drop"], multiple=True, metavar="NAME",
                                help="Let go of a configuration's results as well; repeatable.")  # fmt: skip
            return [*_workspace_option(), drop, click.Option(["--yes"], is_flag=True, help="Remove what is listed.")]
        case "adopt":
            stages = click.Argument(["stages"], nargs=-1, metavar="STAGE...")
            because = click.Option(["--because"], default="", metavar="REASON",
                                   help="Why the results would be the same; without it, a list.")  # fmt: skip
            return [stages, *_plan_options(), because, _json_option()]
        case _:
            address = click.Option(["--address"], default="127.0.0.1", show_default=True, metavar="IP", help="Where to "
                                   "listen; it has no authentication of its own, so never on a public address.")
            port = click.Option(["--port"], default=8082, show_default=True, type=click.IntRange(1, 65535),
                                metavar="N")  # fmt: skip
            return [address, port]


def build_command(name: str, work: Callable[..., Any], kind: type[click.Command] = click.Command) -> click.Command:
    """The command of that name, which does the work."""
    return kind(name, callback=work, params=command_parameters(name), help=HELP[name])
