"""`z2p report-paper`: runs luigi in a process of its own, as `z2p pipeline` does."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from z2p_renderer.pipeline.child_process import child_environment
from z2p_renderer.pipeline.cli.commands.train_pipeline import check_luigi, run_process


@click.command()
@click.option("--config", type=click.Path(exists=True, dir_okay=False, path_type=Path), metavar="TOML",
              help="The contents of the report.", show_default="all of it")
@click.option("--meshes", type=click.Path(exists=True, file_okay=False, path_type=Path), metavar="DIR",
              help="Folder of meshes that were never trained on.", show_default="built-in shapes")
@click.option("--scans", type=click.Path(exists=True, file_okay=False, path_type=Path), metavar="DIR",
              help="Folder of scans that are shown beside the baselines.")
@click.option("--weights", metavar="NAMES", help="Comma-separated shipped names or .safetensors files.",
              show_default="all shipped ones")
@click.option("--sweeps", metavar="NAMES", help="Comma-separated sweeps: noise, density, sampling, inner, scale, "
              "single, lift, light, color, turning, material, texture, sheet, scene, bumps, gap.",
              show_default="all of the config's")
@click.option("--workspace", type=click.Path(file_okay=False, path_type=Path), metavar="DIR",
              help="Folder for all results.", show_default="runs")
@click.option("--workers", type=click.IntRange(min=1), metavar="N", help="Number of tasks that run at the same time.",
              show_default="1")
@click.option("--explain", is_flag=True, help="Print first why each stage runs.")
@click.option("--dry-run", is_flag=True, help="Print what would run and why; write nothing.")
@click.pass_context
def report_paper(ctx: click.Context, explain: bool, dry_run: bool, **options: Path | str | int | None) -> None:
    """Make the paper's evaluation: sweeps, tables, limits and baselines, in one page with JSON and CSV.

    Runs `luigi --module workflows PaperReport --local-scheduler` and ends with its exit status. The results of each
    method on each sweep of each mesh are kept, so that other weights or another sweep compute only what is new.
    """
    check_luigi()
    command = [sys.executable, "-m", "luigi", "--module", "workflows", "PaperReport", "--local-scheduler"]
    command += ["--explain"] * explain + ["--dry-run"] * dry_run
    for name in ("config", "meshes", "scans", "weights", "sweeps", "workspace", "workers"):
        if options[name] is not None:
            command += [f"--{name}", str(options[name])]
    ctx.exit(run_process(command, child_environment()))
