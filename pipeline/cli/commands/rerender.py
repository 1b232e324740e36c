"""`z2p rerender`: a picture that z2p wrote, drawn again with something changed."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from z2p_core.interfaces import Value
from z2p_renderer.pipeline.cli.errors import CommandError, is_debugging
from z2p_renderer.pipeline.cli.options.controls import CONTROL_SETTINGS_KEY, RerenderCommand
from z2p_renderer.pipeline.cli.options.param_types import (
    BackgroundColor,
    Degrees,
    MarginShare,
    OutputPath,
    Resolution,
    SmoothRadius,
)
from z2p_renderer.pipeline.cli.options.pictures import check_writable
from z2p_renderer.pipeline.cli.progress import note_if_opaque

if TYPE_CHECKING:  # at run time these wait until the options have been read: they are slow to import
    from z2p_renderer.pipeline.inference.look import Crop, Look
    from z2p_renderer.pipeline.inference.weight_selection import AnyRenderer


@click.command(cls=RerenderCommand, context_settings={"show_default": True})
@click.argument("figure", type=click.Path(path_type=Path), metavar="FIGURE")
@click.option("--output", "-o", type=OutputPath(file=True), metavar="OUT", show_default=False,
              help="The new picture.  [default: FIGURE with _2 before its suffix]")
@click.option("--input", "scan", type=click.Path(path_type=Path), metavar="SCAN",
              help="The scan, if it has moved since.")
@click.option("--weights", metavar="W", help="Other weights: a shipped name or a .safetensors file.")
@click.option("--engine", metavar="NAME", help="Another engine for the network; see z2p plugins.")
@click.option("--azimuth", default=0.0, type=Degrees(), metavar="DEG",
              help="Turn the object by so much more than it is.")
@click.option("--load-camera", type=click.Path(path_type=Path), metavar="FILE",
              help="Another camera: JSON of --save-camera, or another picture.")
@click.option("--smooth", type=SmoothRadius(), help="Make the surface smooth over patches of that radius; 0: leave it.")
@click.option("--resolution", "--size", type=Resolution(), help="Another size in pixels.")
@click.option("--background", type=BackgroundColor(), help="transparent, or a CSS colour name, #hex or r,g,b from 0 to 1.")
@click.option("--supersample", type=click.IntRange(1, 4), metavar="N", help="Draw N times as large and average down.")
@click.option("--fit", type=click.Choice(["frame", "tight"]), help="tight trims the picture to what is to be seen.")
@click.option("--margin", type=MarginShare(), metavar="SHARE",
              help="Left free around the object, as a share of the shorter side or in percent: 0.1 or 10%.")
@click.option("--overwrite", is_flag=True, help="Replace OUT where it is there already.")
@click.option("--quiet", "-q", is_flag=True, help="Say nothing.")
@click.pass_context
def rerender(ctx: click.Context, figure: Path, output: Path | None, scan: Path | None, **options: Any) -> None:
    """Draw a picture of z2p again with something changed; all else stays as its record has it.

    \b
    z2p rerender fig.png --color teal --light 3.5,-40,50
    z2p rerender fig.png --resolution 2048 --background white -o fig_print.tif

    The scan is looked for beside the picture, where it was, and must not have changed since.
    """
    from z2p_renderer.storage.images.image_files import check_picture_suffix, read_record, write_picture

    record = read_record(figure, complete=True)
    if "motion" in record:
        raise CommandError(f"{figure} is a loop; make it again with z2p animate SCAN --load-camera {figure}")
    if "batch" in record:
        raise CommandError(f"{figure} is a sheet of {record['batch']} clouds, of which its record tells the first; draw it "
                      "again in Python, or save and change its pictures one by one, as sheet[0].save(...)")
    output = output or figure.with_stem(f"{figure.stem}_2")
    if output.exists() and not options["overwrite"]:
        raise click.UsageError(f"{output} is there already; name another --output or add --overwrite", ctx)
    check_picture_suffix(output.suffix.lower())
    check_writable(output.parent)
    if options["background"] is None and record["background"] == "transparent" and not options["quiet"]:
        note_if_opaque(output.suffix.lower())
    with warnings.catch_warnings():
        if not is_debugging():
            warnings.simplefilter("ignore")
        picture, look, made_by = _drawn_again(record, _scan(record, figure, scan), output, ctx.meta.get(CONTROL_SETTINGS_KEY, {}),
                                              options)  # fmt: skip
    write_picture(picture, output, look.background, made_by)
    if not options["quiet"]:
        click.echo(f"rendered: {figure} -> {output}", err=True)


def _drawn_again(
    record: Mapping[str, Any], scan: Path, output: Path, values: dict[str, Value], options: dict[str, Any]
) -> tuple[Any, Look, dict[str, Any]]:
    """The new picture, the look it has and the record of it."""
    from z2p_core.interfaces import ScanError
    from z2p_renderer.pipeline.inference.batch import describe_source
    from z2p_renderer.pipeline.inference.render_scan import build_record as record_of
    from z2p_renderer.pipeline.inference.render_scan import render_scan
    from z2p_renderer.pipeline.inference.weight_selection import load_renderer
    from z2p_renderer.storage.models.checkpoints import shipped_weights
    from z2p_renderer.storage.scans.clouds import format_suffix, read_each

    name = options["weights"] or record["weights"]["name"]
    if options["weights"] is None and name not in shipped_weights():
        raise CommandError(f"the picture was drawn with weights that z2p does not ship, {name!r}; name their file with "
                      "--weights")
    renderer = load_renderer(name, values, engine=_engine(record, options["engine"]))
    look = _look(record, renderer, name, values, options).written_as(output.suffix.lower())
    source = record["input"]
    columns = tuple(source["columns"]) if "columns" in source else None
    clouds = read_each(scan, columns)
    if source["cloud"] >= len(clouds):
        raise CommandError(f"{scan} holds {len(clouds)} clouds; the picture shows number {source['cloud'] + 1}")
    cloud = clouds[source["cloud"]]
    if isinstance(cloud, ScanError):
        raise cloud
    drawing = render_scan(renderer, cloud, format_suffix(scan), look)
    made_by = record_of(drawing, look, describe_source(scan, output, source["cloud"], columns))
    if options["weights"] is None:
        made_by["weights_chosen"] = record.get("weights_chosen", False)
    if options["load_camera"] is None:
        if not options["azimuth"]:  # why it stands as it stands is known from the first time
            made_by["stance"] = {**record["stance"], "smooth": drawing.placement.smoothing_radius}
        if "azimuth" in record["placing"]:  # once it was not told
            made_by["placing"]["azimuth"] = record["placing"]["azimuth"] + options["azimuth"]
    return drawing.picture, look, made_by


def _engine(record: Mapping[str, Any], asked: str | None) -> str | None:
    """Name of the engine that is asked for, or that drew the picture, if it is here; None for the usual one."""
    from z2p_core.registry import PluginError
    from z2p_renderer.pipeline.inference.engine_selection import check_engine

    name: str | None = record.get("engine")  # once it was not told
    if asked is not None or name is None:
        return asked
    try:
        check_engine(name)
    except PluginError:
        click.echo(f"note: the engine {name!r} that drew the picture is not installed; pixels may differ a little",
                   err=True)
        return None
    return name


def _look(
    record: Mapping[str, Any], renderer: AnyRenderer, name: str, given: dict[str, Value], options: dict[str, Any]
) -> Look:
    """The look of the record with the changes."""
    from z2p_core.placement.margin import parse_margin, without_margin
    from z2p_core.placement.viewpoint import viewpoint_from_json
    from z2p_renderer.pipeline.inference.look import build_look
    from z2p_renderer.pipeline.inference.renderer import Renderer
    from z2p_renderer.storage.cameras import read_camera

    named = options["weights"] is None and isinstance(renderer, Renderer)
    if named and renderer.weights["sha256"] != record["weights"]["sha256"]:
        click.echo(f"note: the weights {name!r} are others than those of the picture; its look may differ", err=True)
    margin, camera = _margin(record, options), viewpoint_from_json(record["camera"])
    if options["load_camera"] is not None:
        camera = read_camera(options["load_camera"])
    elif record.get("fit") != "tight":
        camera = without_margin(camera, parse_margin(record.get("margin")))  # once it was not told: the usual one
    if "elevation" in given:
        camera = replace(camera, elevation=given["elevation"][0])
    before = {key: value for key, value in record["controls"].items() if key in renderer.controls}
    dropped = sorted(set(record["controls"]) - set(before))
    if dropped and not options["quiet"]:
        click.echo(f"note: the weights {name!r} have no {' or '.join(dropped)}; the picture's is left out", err=True)
    if options["load_camera"] is not None:
        before.pop("elevation", None)  # the loaded camera has its own
    placing = record["placing"]
    changed = {key: record[key] if options[key] is None else options[key]
               for key in ("resolution", "background", "supersample", "fit")}  # fmt: skip
    return build_look(
        renderer, {**before, **given}, up=placing["up"], view=placing["view"], azimuth=options["azimuth"],
        camera=camera, keep_outliers=placing["keep_outliers"], cut_top=placing["cut_top"],
        smooth=placing.get("smooth", 0.0) if options["smooth"] is None else options["smooth"],  # older records: none
        size=changed["resolution"], background=changed["background"], supersample=changed["supersample"],
        tight=changed["fit"] == "tight", margin=margin, crop=_crop(record, given, options),
    )  # fmt: skip


def _margin(record: Mapping[str, Any], options: dict[str, Any]) -> float | None:
    """The margin that is asked for, else the picture's where it is framed as before.

    Raises:
        click.UsageError: a loaded camera chooses how large the object is.
    """
    from z2p_core.placement.margin import parse_margin

    before, fit = record.get("fit"), options["fit"] or record.get("fit")
    if options["margin"] is not None:
        if options["load_camera"] is not None and fit == "frame":
            raise click.UsageError("--load-camera and --margin both choose how large the object is; leave one out")
        return float(options["margin"])
    kept = fit == before and (fit == "tight" or options["load_camera"] is None)
    return parse_margin(record.get("margin")) if kept else None


def _crop(record: Mapping[str, Any], given: dict[str, Value], options: dict[str, Any]) -> Crop | None:
    """The crop of the picture's series, which lasts while nothing moves in it: neither object nor shadow nor frame."""
    (width, height), (old_width, old_height) = options["resolution"] or record["resolution"], record["resolution"]
    changed = options["load_camera"] is not None or options["margin"] is not None
    moved = options["azimuth"] or changed or {"elevation", "light"} & set(given)
    if moved or width * old_height != height * old_width or options["fit"] is not None or record.get("window") is None:
        return None
    left, top, right, bottom = record["window"]
    return left, top, right, bottom


def _scan(record: Mapping[str, Any], figure: Path, given: Path | None) -> Path:
    """The file that the picture's cloud came from, checked against the digest.

    Raises:
        CommandError: it is nowhere to be found, or has changed.
    """
    from z2p_renderer.storage.results.fingerprints import file_digest

    source = record["input"]
    if source.get("name") is None:
        raise CommandError(f"{figure} was drawn from an array in Python, not from a file; draw it there again with "
                      "z2p_core.render(points, camera=...)")
    places = [given] if given else [figure.parent / source["path"]] if source["path"] else []
    places += [] if given else [figure.parent / source["name"], Path(source["name"])]
    found = [place for place in places if place.is_file()]
    if not found:
        if given is None and source["path"] is None:
            raise CommandError("the scan came through standard input, so no file is known; name one with --input")
        looked = ", ".join(dict.fromkeys(str(place) for place in places))
        raise CommandError(f"the scan {source['name']} is not to be found (looked for {looked}); name it with --input")
    for place in found:
        if file_digest(place) == source["sha256"]:
            return place
    if given:
        raise CommandError(f"{given} is not the scan that the picture was drawn from (other content); draw it anew with "
                      f"z2p run-inference {given} --load-camera {figure}")
    raise CommandError(f"{found[0]} has changed since; draw it anew with z2p run-inference {found[0]} "
                  f"--load-camera {figure}")
