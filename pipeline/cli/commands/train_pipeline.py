"""`z2p pipeline`: starts luigi as a process of its own, so that nothing here imports `workflows`."""

from __future__ import annotations

import importlib.util
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from z2p_core.errors.install_advice import install_advice
from z2p_renderer.pipeline.child_process import child_environment
from z2p_renderer.pipeline.cli.errors import CommandError

SHARED_SCHEDULER_OPTIONS = ("--worker-keep-alive", "--worker-wait-interval", "1", "--worker-wait-jitter", "1")
"""A worker with nothing to do waits for the others, and asks the scheduler no more than once in a second or two."""
WITH_OTHERS, NOT_RUN = 10, 25
"""luigi ends so, by workflows/luigi.cfg, while other workers have some of the tasks, or when the scheduler gave out no
more of them; also when all is well, so look again whether everything is there."""
MAX_RECHECKS = 10
"""How often to look again when nobody runs what is left."""


def pipeline_options(config_help: str, config_default: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """The options of a command that `run_task` ends; their defaults are luigi's, so here they are only shown."""
    folder = click.Path(exists=True, file_okay=False, path_type=Path)
    options = (
        click.option("--config", type=click.Path(exists=True, dir_okay=False, path_type=Path), metavar="TOML",
                     help=config_help, show_default=config_default),
        click.option("--meshes", type=folder, metavar="DIR",
                     help="Folder of meshes to train on; shapes of the project's own without it."),
        click.option("--evaluate-meshes", type=folder, metavar="DIR",
                     help="Folder of meshes kept aside for the evaluation."),
        click.option("--workspace", type=click.Path(file_okay=False, path_type=Path), metavar="DIR",
                     help="Folder for everything the stages make.", show_default="runs"),
        click.option("--workers", type=click.IntRange(min=1), metavar="N", help="Tasks that run at the same time.",
                     show_default="1"),
        click.option("--scheduler", metavar="URL", help="A running luigid, as http://HOST:8082, that shares the work "
                     "among all pipelines that name it; see docs/cluster.md."),
        click.option("--explain", is_flag=True, help="Say first why each stage runs."),
        click.option("--dry-run", is_flag=True, help="Say what would run and why; write nothing."),
    )  # fmt: skip

    def decorate(command: Callable[..., Any]) -> Callable[..., Any]:
        for option in reversed(options):
            command = option(command)
        return command

    return decorate


@click.command()
@pipeline_options("Settings of every stage.", "the quick ones")
def pipeline(**options: Any) -> None:
    """Make weights: sample meshes, render them in Blender, shard, train and evaluate.

    Runs `luigi --module workflows FullPipeline --local-scheduler` and ends with its exit status. Only stages whose
    inputs have changed run again.
    """
    run_task("FullPipeline", **options)


def run_task(task: str, scheduler: str | None, explain: bool, dry_run: bool, **options: Path | int | None) -> None:
    """Run a task of `workflows` in luigi, with the values of `pipeline_options`, and end with its exit status.

    Raises:
        CommandError: luigi is not installed.
    """
    check_luigi()
    command = [sys.executable, "-m", "luigi", "--module", "workflows", task]
    command += ["--scheduler-url", scheduler, *SHARED_SCHEDULER_OPTIONS] if scheduler else ["--local-scheduler"]
    command += ["--explain"] * explain + ["--dry-run"] * dry_run
    for name in ("config", "meshes", "evaluate_meshes", "workspace", "workers"):
        if options[name] is not None:
            command += [f"--{name.replace('_', '-')}", str(options[name])]
    looks, status = 0, run_process(command, child_environment())
    while scheduler and (status == WITH_OTHERS or (status == NOT_RUN and looks < MAX_RECHECKS)):
        looks += status == NOT_RUN
        time.sleep(2)
        status = run_process(command, child_environment())
    click.get_current_context().exit(status)


def check_luigi() -> None:
    """Nothing, where luigi is installed.

    Raises:
        CommandError: it is not.
    """
    if importlib.util.find_spec("luigi") is None:
        raise CommandError(f"the pipeline needs luigi, which is not installed; {install_advice('pipeline')}")


def run_process(command: list[str], environment: dict[str, str]) -> int:
    """Exit status of a process that is sent our SIGTERM and is left to end by itself on Ctrl-C."""
    child = subprocess.Popen(command, env=environment)
    before = signal.signal(signal.SIGTERM, lambda number, frame: child.terminate())
    try:
        while True:
            try:
                status = child.wait()
                return status if status >= 0 else 128 - status
            except KeyboardInterrupt:  # the terminal has told luigi as well: let it stop in its own way
                continue
    finally:
        signal.signal(signal.SIGTERM, before)
