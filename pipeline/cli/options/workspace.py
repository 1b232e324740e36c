"""Options and help of `z2p status`, `verify`, `gc`, `adopt` and `scheduler`, which `workflows.commands` carries out.

They are defined here, so that --help works without luigi.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

COMMAND_HELP = {
    "status": """List every step as fresh, stale or missing, with the reason. Writes nothing.

    \b
    z2p status --config my.toml --meshes meshes/
    z2p status --config configs/report.toml --meshes kept-aside/
    """,
    "verify": """Compare every result with its digests; damaged ones are put aside, and the next run makes them again.

    Results that a running pipeline is working on are left alone.

    Exit status 1 if a result was damaged.
    """,
    "gc": "List the results that no kept configuration and no running pipeline needs; with --yes, remove them.",
    "adopt": """Vouch for results that older code made: take them over if nothing but code or packages has changed.

    STAGE is one or more of shapes, sample, render, shard, train, evaluate and reference (the ground truth of the
    evaluation); for ablations also compare; for a report measure, scans, trust, times and report. Without STAGE all
    are meant. Without --because the results that could be taken over are listed, and nothing changes. Results whose
    parameters, meshes or plugin versions differ are never taken over.
    """,
    "scheduler": "Start luigi's central scheduler, which shares the work among pipelines on several machines.",
}
"""Command -> its help."""


def _workspace_option() -> click.Parameter:
    folder = click.Path(file_okay=False, path_type=Path)
    return click.Option(["--workspace"], default="runs", show_default=True, metavar="DIR",
                        help="Folder of all results.", type=folder)  # fmt: skip


def _plan_options() -> list[click.Parameter]:
    """The options of `z2p pipeline`, `ablate` and `report-paper` that determine their results."""
    texts = (
        ("--config", "TOML", "Settings of every stage; without it the quick ones."),
        ("--meshes", "DIR", "Folder of meshes to train on; without it built-in shapes."),
        ("--evaluate-meshes", "DIR", "Folder of meshes for the evaluation only."),
        ("--scans", "DIR", "For a report: folder of scans to show."),
        ("--weights", "NAMES", "For a report: the weights to compare."),
        ("--sweeps", "NAMES", "For a report: only these sweeps."),
    )
    report = click.Option(["--report"], is_flag=True, help="The results of z2p report-paper; implied by the config "
                          "of a report, and by options of its own.")  # fmt: skip
    options = [click.Option([name], default="", metavar=metavar, help=text) for name, metavar, text in texts]
    return [_workspace_option(), *options, report]


def _json_option() -> click.Parameter:
    return click.Option(["--json", "in_json"], is_flag=True, help="Print a JSON list instead of a table.")


def command_parameters(name: str) -> list[click.Parameter]:
    """The arguments and options of the command of that name."""
    match name:
        case "status":
            stale = click.Option(["--stale", "only_stale"], is_flag=True, help="List only what a run would make.")
            return [*_plan_options(), _json_option(), stale]
        case "verify":
            return [_workspace_option()]
        case "gc":
            drop = click.Option(["--drop"], multiple=True, metavar="NAME",
                                help="No longer keep the results of this configuration; repeatable.")  # fmt: skip
            yes = click.Option(["--yes"], is_flag=True, help="Remove the listed results.")
            return [_workspace_option(), drop, yes]
        case "adopt":
            stages = click.Argument(["stages"], nargs=-1, metavar="STAGE...")
            because = click.Option(["--because"], default="", metavar="REASON",
                                   help="Why the results would be the same; without it they are listed.")  # fmt: skip
            return [stages, *_plan_options(), because, _json_option()]
        case _:
            address = click.Option(["--address"], default="127.0.0.1", show_default=True, metavar="IP",
                                   help="Address to listen on; never a public one, for the scheduler has no "
                                   "authentication.")
            port = click.Option(["--port"], default=8082, show_default=True, type=click.IntRange(1, 65535),
                                metavar="N", help="Port to listen on.")  # fmt: skip
            return [address, port]


def build_command(name: str, work: Callable[..., Any], kind: type[click.Command] = click.Command) -> click.Command:
    """The command of that name, of class `kind`, which calls `work`."""
    return kind(name, callback=work, params=command_parameters(name), help=COMMAND_HELP[name])
