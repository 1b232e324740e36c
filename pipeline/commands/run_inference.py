"""`z2p run-inference`: point clouds to pictures, with an option for each installed control."""

from __future__ import annotations

import json
import os
import sys
import warnings
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pipeline.cli import debugging
from pipeline.commands.control_options import SETTINGS, InferenceCommand
from pipeline.commands.values import Background, Degrees, Resolution, UpAxis, View
from z2p_core.interfaces import Value

if TYPE_CHECKING:  # at run time these wait until the options have been read: they import torch
    from pipeline.batch import Look, Outcome, Task
    from pipeline.infer import Renderer
    from pipeline.placing import Placing


@click.command(cls=InferenceCommand, context_settings={"show_default": True})
@click.argument("inputs", nargs=-1, required=True, metavar="INPUT...")
@click.option("--output", "-o", required=True, type=click.Path(path_type=Path), metavar="OUT",
              help="Folder for the pictures; or, for one cloud, the picture itself (.png).")
@click.option("--recursive", "-r", is_flag=True, help="Look into sub folders, and mirror them in OUT.")
@click.option("--weights", default="regular", metavar="W", help="Shipped name or a .safetensors file.")
@click.option("--up", default="auto", type=UpAxis(),
              help="Axis that points up in the data; auto: a depth camera's own up, else what the format holds usual.")
@click.option("--view", default="auto", type=View(),
              help="Side to look from. auto: a depth camera's own, else a three-quarter view that shows most; "
              "front: the data's own; sensor; or degrees as azimuth,elevation.")
@click.option("--azimuth", default=0.0, type=Degrees(), metavar="DEG",
              help="Turn the object on from there about its up axis, counter-clockwise from above.")
@click.option("--keep-outliers", is_flag=True, help="Keep stray points that make the object small.")
@click.option("--resolution", default="512", type=Resolution(), help="Size in pixels.")
@click.option("--background", default="transparent", type=Background(),
              help="transparent, or a CSS colour name or #hex.")
@click.option("--overwrite", is_flag=True, help="Render again what is there; it is skipped otherwise.")
@click.option("--json", "as_json", is_flag=True, help="One JSON line a file on stdout.")
@click.option("--jobs", default=1, type=click.IntRange(min=1), metavar="N", help="Files rendered at the same time.")
@click.option("--quiet", "-q", is_flag=True, help="Tell of failures only.")
@click.pass_context
def run_inference(ctx: click.Context, inputs: tuple[str, ...], output: Path, **options: Any) -> None:
    """Render point clouds to pictures: each INPUT is a file, a folder or a quoted glob.

    Exit status: 0 all rendered or there before, 1 some files failed (the others are done), 2 wrong usage.
    """
    with warnings.catch_warnings():
        if not debugging():
            warnings.simplefilter("ignore")  # libraries' remarks would bury the one line a file gets
        failed = _run(ctx, inputs, output, ctx.meta.get(SETTINGS, {}), options)
    ctx.exit(1 if failed else 0)


def _run(
    ctx: click.Context, inputs: tuple[str, ...], output: Path, values: dict[str, Value], options: dict[str, Any]
) -> int:
    """How many files failed."""
    from storage.clouds import find_scans

    scans = find_scans(inputs, options["recursive"])
    if not scans:
        raise click.UsageError(f"no readable scans in {', '.join(inputs)}; see `z2p formats`", ctx)
    from pipeline.batch import Look, render_files
    from pipeline.infer import Renderer

    jobs = min(options["jobs"], len(scans))
    renderer = Renderer(options["weights"], None if jobs == 1 else max(1, (os.cpu_count() or 1) // jobs))
    if isinstance(options["view"], tuple):
        values = {"elevation": (options["view"][1],), **values}  # --elevation wins
    values = _values_for(ctx, renderer, values)
    if "elevation" in values:
        renderer.controls["elevation"].check(values["elevation"])  # what --view set has not been through its option
    background = None if options["background"] == "transparent" else options["background"]
    width, height = options["resolution"]
    look = Look(values, _placing(options), width, height, background)
    tasks = _plan(ctx, scans, inputs, output, options["recursive"])
    outcomes = render_files(tasks, renderer, look, options["overwrite"], jobs)
    settings = _settings(renderer, look, options)
    counts = {"ok": 0, "skipped": 0, "failed": 0}
    for outcome in _reported(outcomes, len(tasks), options["quiet"]):
        counts[outcome.status] += 1
        if options["as_json"]:
            click.echo(json.dumps(_line(outcome, settings)))
    if not options["quiet"]:
        click.echo(f"{counts['ok']} rendered, {counts['skipped']} skipped, {counts['failed']} failed", err=True)
    return counts["failed"]


def _values_for(ctx: click.Context, renderer: Renderer, values: dict[str, Value]) -> dict[str, Value]:
    """The user's values, when the weights carry every control that they set."""
    fixed = renderer.fixed_elevation
    if fixed is not None and values.get("elevation", (fixed,)) != (fixed,):
        raise click.UsageError(
            f"--elevation: these weights know only {fixed:g} degrees, got {values['elevation'][0]:g}; leave it out, or "
            "take weights that carry the elevation control", ctx
        )
    for name in values:
        if name not in renderer.controls and name != "elevation":
            carried = ", ".join(renderer.controls) or "none"
            raise click.UsageError(f"these weights do not carry the control {name!r}; they carry: {carried}", ctx)
    return {name: value for name, value in values.items() if name in renderer.controls}


def _placing(options: dict[str, Any]) -> Placing:
    from pipeline.placing import Placing

    view = options["view"]
    return Placing(options["up"], view[0] if isinstance(view, tuple) else view, options["azimuth"],
                   options["keep_outliers"])


def _plan(ctx: click.Context, scans: list[Path], inputs: tuple[str, ...], output: Path, recursive: bool) -> list[Task]:
    """The tasks, once it is sure that their pictures can be written."""
    from pipeline.batch import Task, plan_outputs

    alone = output.suffix.lower() == ".png" and not output.is_dir()
    if alone and len(scans) > 1:
        raise click.UsageError(f"--output {output} names one picture, but {len(scans)} scans match; give a folder", ctx)
    folder = output.parent if alone else output
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / f".z2p-{os.getpid()}.probe"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise click.UsageError(f"cannot write to {folder}: {error.strerror}; choose another --output", ctx) from None
    if alone:
        return [Task(scans[0], output, single=True)]
    return plan_outputs(scans, [Path(text) for text in inputs if Path(text).is_dir()], output, recursive)


def _settings(renderer: Renderer, look: Look, options: dict[str, Any]) -> dict[str, Any]:
    """All that shaped the pictures, JSON-able."""
    controls = {name: list(value) for name, value in renderer.settings(look.values).items()}
    elevation = controls.get("elevation", [renderer.fixed_elevation])
    return {
        "weights": options["weights"],
        "controls": controls,
        "elevation": elevation[0],
        "up": look.placing.up,
        "view": options["view"],
        "azimuth": look.placing.azimuth,
        "keep_outliers": look.placing.keep_outliers,
        "resolution": [look.width, look.height],
        "background": "transparent" if look.background is None else list(look.background),
    }


def _reported(outcomes: Iterator[Outcome], count: int, quiet: bool) -> Iterator[Outcome]:
    """The outcomes, each told on stderr as it passes: a bar on a terminal, else a line a file."""
    from tqdm import tqdm

    terminal = sys.stderr.isatty()
    for outcome in tqdm(outcomes, total=count, unit="file", disable=quiet or not terminal, file=sys.stderr):
        if outcome.status == "failed" or not quiet:
            if not terminal:
                click.echo(_told(outcome), err=True)
            elif outcome.status != "ok":
                tqdm.write(_told(outcome), file=sys.stderr)
        yield outcome


def _told(outcome: Outcome) -> str:
    from storage.clouds import shown

    name, pictures = shown(outcome.scan), shown(outcome.outputs[0])
    if len(outcome.outputs) > 1:
        pictures += f" to {shown(Path(outcome.outputs[-1].name))}"
    if outcome.status == "failed":
        return f"failed: {name}: {outcome.error}"
    if outcome.status == "skipped":
        return f"skipped: {name}: {pictures} is there already; --overwrite renders it again"
    dropped = f", {outcome.dropped} not finite dropped" if outcome.dropped else ""
    stances = list(dict.fromkeys(stance.told for stance in outcome.stances))
    others = "; its other clouds otherwise" if len(stances) > 1 else ""
    return (f"rendered: {name} -> {pictures} ({outcome.points} points{dropped}, {outcome.seconds:.2f} s; "
            f"{stances[0]}{others})")


def _line(outcome: Outcome, settings: dict[str, Any]) -> dict[str, Any]:
    """One file's JSON line; `output` is the first of `outputs`, the only one for most files.

    `settings` is what was asked of every picture, `stances` what became of up, view and elevation in each one drawn.
    """
    stances = [asdict(stance) for stance in outcome.stances]
    for stance in stances:
        stance["elevation"] = settings["elevation"] if stance["elevation"] is None else stance["elevation"]
    return {
        "input": str(outcome.scan),
        "output": str(outcome.outputs[0]),
        "outputs": [str(path) for path in outcome.outputs],
        "status": outcome.status,
        "points": outcome.points,
        "dropped": outcome.dropped,
        "seconds": round(outcome.seconds, 4),
        "error": outcome.error,
        "stances": stances,
        "settings": settings,
    }
