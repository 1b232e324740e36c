"""`z2p evaluate`: weights against Blender renders of meshes."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from typing import Any

import click

from z2p_core.config import EvaluateConfig
from z2p_core.errors.install_advice import install_advice
from z2p_core.errors.missing_system_libraries import SystemLibraryError
from z2p_core.scene import SIDE_LIMITS
from z2p_renderer.pipeline.cli.errors import CommandError
from z2p_renderer.pipeline.cli.options.param_types import Elevation, FiniteRange

REQUIRED_PACKAGES = ("bpy", "kornia", "flip_evaluator", "matplotlib")
INSTALL = install_advice("pipeline")


def _split_names(context: click.Context, parameter: click.Parameter, text: str) -> tuple[str, ...]:
    names = (name.strip() for name in text.split(","))
    return tuple(dict.fromkeys(name for name in names if name))


@click.command(context_settings={"show_default": True})
@click.option("--meshes", required=True, type=click.Path(path_type=Path), metavar="DIR",
              help="Folder of meshes to render and to sample clouds from, or `detailed` for built-in ones of two "
              "million triangles with fine relief.")
@click.option("--weights", default="regular", metavar="W", help="Shipped name or a .safetensors file.")
@click.option("--engine", default="torch", metavar="NAME", help="Engine that runs the network; see `z2p plugins`.")
@click.option("--output", "-o", required=True, type=click.Path(file_okay=False, path_type=Path), metavar="DIR",
              help="Folder for metrics.json and the contact sheet.")
@click.option("--truth", type=click.Path(file_okay=False, path_type=Path), metavar="DIR",
              help="Folder that keeps the Blender renders for later evaluations.  [default: OUTPUT/truth]")
@click.option("--views", default=4, type=click.IntRange(min=1), metavar="V", help="Views of each mesh.")
@click.option("--points", default=5000, type=click.IntRange(min=1), metavar="N", help="Points in each cloud.")
@click.option("--noise", default=0.0, type=FiniteRange(min=0), metavar="S",
              help="Standard deviation of Gaussian noise, in units of the mesh's radius.")
@click.option("--sampler", default="uniform", metavar="NAME", help="How points are sampled; see `z2p plugins`.")
@click.option("--seed", default=0, type=click.IntRange(min=0), metavar="K", help="Seed of views, clouds and noise.")
@click.option("--seeds", default=1, type=click.IntRange(min=1), metavar="N",
              help="Number of seeds, starting at --seed: prints means over all, and their spread.")
@click.option("--resolution", default=256, type=click.IntRange(*SIDE_LIMITS), metavar="R",
              help="Side of the pictures, in pixels.")
@click.option("--samples", default=64, type=click.IntRange(min=1), metavar="N", help="Cycles samples per pixel.")
@click.option("--bounces", default=3, type=click.IntRange(min=0), metavar="N",
              help="Number of light bounces in Cycles; use 6 for glossy surfaces.")
@click.option("--supersample", default=1, type=click.IntRange(1, 4), metavar="K",
              help="Draw K times as large and average down, as z2p run-inference does.")
@click.option("--elevation", default="20", type=Elevation(), help="Camera elevation in degrees, or random.")
@click.option("--baseline", metavar="NAMES", default="", show_default=False, callback=_split_names,
              help="Comma-separated baselines to compare with, as bpa,poisson,balls; see `z2p plugins`.")
@click.option("--baseline-seconds", default=120.0, type=FiniteRange(min=0, min_open=True), metavar="S",
              help="Seconds that a baseline may take for a cloud; then it is stopped, and the table says so.")
@click.option("--textures", metavar="KINDS", default="", show_default=False, callback=_split_names,
              help="Comma-separated textures that meshes and clouds get, each in turn, as smooth,stripes,spots; see "
              "`z2p plugins`.  [default: one colour]")
def evaluate(
    meshes: Path, weights: str, engine: str, output: Path, truth: Path | None, baseline: tuple[str, ...],
    baseline_seconds: float, **options: Any,
) -> None:
    """Measure weights against Blender renders of meshes.

    Writes metrics.json (a row for each mesh and view, and the means) and a contact sheet, and prints the means.
    """
    from z2p_core import registry
    from z2p_renderer.pipeline.evaluation.baselines import load_baselines
    from z2p_renderer.pipeline.evaluation.comparison_sheet import count_sheets
    from z2p_renderer.pipeline.outputs.contact_sheet import check_sheet_places
    from z2p_renderer.storage.models.checkpoints import find_weights

    if options["elevation"] == "random":
        options["elevation"] = None
    config = EvaluateConfig(**options)
    load_baselines(baseline)
    registry.load("engines", engine)
    truth = truth or output / "truth"
    mesh_files, weights_file = _find_meshes(meshes, truth), find_weights(weights)
    for texture in config.textures:
        registry.load("textures", texture)
    pictures = len(mesh_files) * config.views * config.seeds * max(1, len(config.textures))
    check_sheet_places(output, count_sheets(pictures))  # before hours of rendering
    missing = [package for package in REQUIRED_PACKAGES if importlib.util.find_spec(package) is None]
    if missing:
        raise CommandError(f"evaluation needs {', '.join(missing)}; {INSTALL}")
    try:
        from z2p_renderer.pipeline.evaluation.evaluate import evaluate as measure

        measure(mesh_files, weights_file, output, config, truth, _print_progress, baseline, engine, baseline_seconds)
    except SystemLibraryError as error:
        raise CommandError(str(error)) from error
    except ImportError as error:
        raise CommandError(f"evaluation needs packages that cannot be imported here ({error}); {INSTALL}") from error
    _print_means(json.loads((output / "metrics.json").read_text()))
    click.echo(f"written to {output}", err=True)


def _find_meshes(meshes: Path, truth: Path) -> dict[str, Path]:
    """Mesh files by name: those of a folder, or the built-in detailed ones, which are made below the truth's folder."""
    from z2p_renderer.pipeline.detailed_meshes.objects import DETAILED, make_detailed_meshes
    from z2p_renderer.storage.meshes import find_meshes

    if meshes != Path(DETAILED) or meshes.is_dir():
        return find_meshes(meshes)
    return make_detailed_meshes(truth / "meshes")


def _print_means(metrics: dict[str, Any]) -> None:
    """Prints a line for each metric with its mean; with baselines, theirs follow in columns below a line of names.

    With several seeds, each mean is followed by the standard deviation of the seeds' means. With textures, there is a
    table for each before that for all of them.
    """
    methods = {"z2p": metrics, **metrics["baselines"]}
    for kind in metrics.get("textures", {}):
        _print_table({name: one["textures"][kind] for name, one in methods.items()}, kind)
    _print_table(methods, "all textures" if "textures" in metrics else "")


def _print_table(methods: dict[str, dict[str, Any]], title: str) -> None:
    """Prints a line for each metric with the mean of each method in a column."""
    columns = list(methods.values())
    has_spread = len(columns[0]["seeds"]) > 1
    if len(methods) > 1:
        width = 19 if has_spread else 9
        click.echo(" ".join([f"{title:<16}", *(f"{name:>{width}}" for name in methods)]))
    elif title:
        click.echo(title)
    for name in dict.fromkeys(name for column in columns for name in column["means"]):
        numbers = []
        for column in columns:
            mean, spread = column["means"].get(name), column["spread_over_seeds"].get(name)
            numbers.append(f"{'-':>9}" if mean is None else f"{mean:9.4f}")
            if has_spread:
                numbers.append(f"{'':>9}" if spread is None else f"+-{spread:7.4f}")
        click.echo(" ".join([f"{name:<16}", *numbers]))
    for name, column in methods.items():
        if "stopped" in column:
            click.echo("{}: stopped after {after_seconds:g} s on {rows} of {of} clouds; its means are of the others"
                       .format(name, **column["stopped"]))


def _print_progress(line: str) -> None:
    click.echo(line, err=True)
