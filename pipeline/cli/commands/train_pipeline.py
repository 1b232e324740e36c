"""`z2p pipeline`: runs luigi in a process of its own, so that nothing here imports `workflows`."""

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
"""luigi's options for a worker without work: it waits for the others, and asks the scheduler every 1 to 2 seconds."""
STATUS_OTHERS_RUNNING = 10
"""luigi's exit status (workflows/luigi.cfg) while other workers run some of the tasks."""
STATUS_NOT_RUN = 25
"""luigi's exit status if the scheduler gave out no more tasks. Nothing need have failed, so it is run again to see."""
MAX_RECHECKS = 10
"""How often luigi is run again while no worker runs the tasks that are left."""


def pipeline_options(config_help: str, config_default: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Decorator that adds the options of `run_task`; their defaults are luigi's, and are only shown here."""
    folder = click.Path(exists=True, file_okay=False, path_type=Path)
    options = (
        click.option("--config", type=click.Path(exists=True, dir_okay=False, path_type=Path), metavar="TOML",
                     help=config_help, show_default=config_default),
        click.option("--meshes", type=folder, metavar="DIR",
                     help="Folder of meshes to train on.", show_default="built-in shapes"),
        click.option("--evaluate-meshes", type=folder, metavar="DIR",
                     help="Folder of meshes for the evaluation only."),
        click.option("--workspace", type=click.Path(file_okay=False, path_type=Path), metavar="DIR",
                     help="Folder for the results of all stages.", show_default="runs"),
        click.option("--workers", type=click.IntRange(min=1), metavar="N",
                     help="Number of tasks that run at the same time.", show_default="1"),
        click.option("--scheduler", metavar="URL", help="URL of a running luigid, as http://HOST:8082, which shares "
                     "the work among all pipelines that name it; see docs/cluster.md."),
        click.option("--explain", is_flag=True, help="Print first why each stage runs."),
        click.option("--dry-run", is_flag=True, help="Print what would run and why; write nothing."),
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
    """Runs a task of `workflows` in luigi with the values of `pipeline_options`, and exits with luigi's status.

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
    rechecks, status = 0, run_process(command, child_environment())
    while scheduler and (
        status == STATUS_OTHERS_RUNNING or (status == STATUS_NOT_RUN and rechecks < MAX_RECHECKS)
    ):
        rechecks += status == STATUS_NOT_RUN
        time.sleep(2)
        status = run_process(command, child_environment())
    click.get_current_context().exit(status)


def check_luigi() -> None:
    """Makes sure that luigi is installed.

    Raises:
        CommandError: it is not.
    """
    if importlib.util.find_spec("luigi") is None:
        raise CommandError(f"the pipeline needs luigi, which is not installed; {install_advice('pipeline')}")


def run_process(command: list[str], environment: dict[str, str]) -> int:
    """Runs a process and returns its exit status. It gets our SIGTERM, and is left to end by itself on Ctrl-C."""
    child = subprocess.Popen(command, env=environment)
    handler_before = signal.signal(signal.SIGTERM, lambda number, frame: child.terminate())
    try:
        while True:
            try:
                status = child.wait()
                return status if status >= 0 else 128 - status
            except KeyboardInterrupt:  # the terminal sends it to the child as well, which stops in its own way
                continue
    finally:
        signal.signal(signal.SIGTERM, handler_before)
