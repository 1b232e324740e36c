"""`z2p report-paper`: starts luigi as a process of its own, as `z2p pipeline` does."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from z2p_renderer.pipeline.child_process import child_environment
from z2p_renderer.pipeline.cli.commands.train_pipeline import check_luigi, run_process


@click.command()
@click.option("--config", type=click.Path(exists=True, dir_okay=False, path_type=Path), metavar="TOML",
              help="What the report holds.", show_default="all of it")
@click.option("--meshes", type=click.Path(exists=True, file_okay=False, path_type=Path), metavar="DIR",
              help="Folder of meshes never trained on; shapes of the project's own without it.")
@click.option("--scans", type=click.Path(exists=True, file_okay=False, path_type=Path), metavar="DIR",
              help="Folder of scans to show beside the baselines.")
@click.option("--weights", metavar="NAMES", help="Comma-separated shipped names or .safetensors files; all that are "
              "shipped without it.")
@click.option("--sweeps", metavar="NAMES", help="Comma-separated sweeps: noise, density, sampling, inner, scale, "
              "single, lift, light, color, turning, material, sheet, scene, bumps, gap.",
              show_default="all of the config's")
@click.option("--workspace", type=click.Path(file_okay=False, path_type=Path), metavar="DIR",
              help="Folder for everything that is made.", show_default="runs")
@click.option("--workers", type=click.IntRange(min=1), metavar="N", help="Tasks that run at the same time.",
              show_default="1")
@click.option("--explain", is_flag=True, help="Say first why each stage runs.")
@click.option("--dry-run", is_flag=True, help="Say what would run and why; write nothing.")
@click.pass_context
def report_paper(ctx: click.Context, explain: bool, dry_run: bool, **options: Path | str | int | None) -> None:
    """Make the paper's evaluation: sweeps, tables, limits and baselines, in one page with JSON and CSV.

    Runs `luigi --module workflows PaperReport --local-scheduler` and ends with its exit status. Each method on each
    sweep of each mesh is kept, so other weights or a further sweep only make what is new.
    """
    check_luigi()
    command = [sys.executable, "-m", "luigi", "--module", "workflows", "PaperReport", "--local-scheduler"]
    command += ["--explain"] * explain + ["--dry-run"] * dry_run
    for name in ("config", "meshes", "scans", "weights", "sweeps", "workspace", "workers"):
        if options[name] is not None:
            command += [f"--{name}", str(options[name])]
    ctx.exit(run_process(command, child_environment()))
