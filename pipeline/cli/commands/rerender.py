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
from z2p_renderer.pipeline.cli.options.cameras import DEFAULT_DPI
from z2p_renderer.pipeline.cli.options.coloring import changed_color_options, color_options_of_record
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

if TYPE_CHECKING:  # slow to import: imported at run time only when the options have been read
    from z2p_core.pinhole import PinholeCamera
    from z2p_core.placement.viewpoint import Viewpoint
    from z2p_core.style import Style
    from z2p_renderer.pipeline.inference.look import Crop, Look
    from z2p_renderer.pipeline.inference.render_scan import RenderedScan
    from z2p_renderer.pipeline.inference.weight_selection import AnyRenderer


@click.command(cls=RerenderCommand, context_settings={"show_default": True})
@click.argument("figure", type=click.Path(path_type=Path), metavar="FIGURE")
@click.option("--input", "scan", type=click.Path(path_type=Path), metavar="SCAN",
              help="The scan, if it has been moved.")
@click.option("--weights", metavar="W", help="Other weights: a shipped name or a .safetensors file.")
@click.option("--azimuth", default=0.0, type=Degrees(), metavar="DEG",
              help="Turn the object by so many degrees more.")
@click.option("--load-camera", type=click.Path(path_type=Path), metavar="FILE",
              help="Another camera: JSON of --save-camera, or another picture.")
@click.option("--style", type=click.Choice(["surface", "balls", "discs"]), help="Another style.")
@click.option("--radius", metavar="R", help="Another radius of balls: in the data's units, in percent, or a field.")
@click.option("--smooth", type=SmoothRadius(), help="Smooth the surface over patches of this radius; 0: do not.")
@click.option("--resolution", "--size", type=Resolution(), help="Another size in pixels.")
@click.option("--background", type=BackgroundColor(),
              help="transparent, or a CSS colour name, #hex or r,g,b from 0 to 1.")
@click.option("--supersample", type=click.IntRange(1, 4), metavar="N", help="Draw N times as large and average down.")
@click.option("--fit", type=click.Choice(["frame", "tight"]), help="tight trims the picture to what is visible.")
@click.option("--margin", type=MarginShare(), metavar="SHARE",
              help="Free space around the object, as a share of the shorter side or in percent: 0.1 or 10%.")
@changed_color_options
@click.option("--output", "-o", type=OutputPath(file=True), metavar="OUT", show_default=False,
              help="The new picture.  [default: FIGURE with _2 before its suffix]")
@click.option("--engine", metavar="NAME", help="Another engine for the network; see z2p plugins.")
@click.option("--overwrite", is_flag=True, help="Replace OUT if it exists.")
@click.option("--quiet", "-q", is_flag=True, help="Print nothing.")
@click.pass_context
def rerender(ctx: click.Context, figure: Path, output: Path | None, scan: Path | None, **options: Any) -> None:
    """Draw a picture of z2p again with something changed; all else stays as its record has it.

    \b
    z2p rerender fig.png --color teal --light 3.5,-40,50
    z2p rerender fig.png --resolution 2048 --background white -o fig_print.tif

    The scan is looked for at its place beside the picture, and must not have changed since.
    """
    from z2p_renderer.pipeline.inference.documents import write_document
    from z2p_renderer.storage.images.image_files import (
        DOCUMENT_SUFFIXES,
        check_picture_suffix,
        read_record,
        write_picture,
    )

    record = read_record(figure, complete=True)
    _check_single_picture(record, figure)
    output = output or figure.with_stem(f"{figure.stem}_2")
    if output.exists() and not options["overwrite"]:
        raise click.UsageError(f"{output} is there already; name another --output or add --overwrite", ctx)
    if output.suffix.lower() not in DOCUMENT_SUFFIXES:
        check_picture_suffix(output.suffix.lower())
    check_writable(output.parent)
    if options["background"] is None and record["background"] == "transparent" and not options["quiet"]:
        note_if_opaque(output.suffix.lower())
    scan, controls = _find_scan(record, figure, scan), ctx.meta.get(CONTROL_SETTINGS_KEY, {})
    with warnings.catch_warnings():
        if not is_debugging():
            warnings.simplefilter("ignore")
        drawing, look, new_record = _draw_again(record, scan, output, controls, options)
    if look.is_document:
        write_document(drawing, look, new_record, output)
    else:
        write_picture(drawing.picture, output, look.background, new_record, look.dpi)
    if not options["quiet"]:
        click.echo(f"rendered: {figure} -> {output}", err=True)


def _check_single_picture(record: Mapping[str, Any], figure: Path) -> None:
    """Raises CommandError for loops and for sheets that Python wrote: their records describe one cloud only."""
    if "motion" in record:
        raise CommandError(f"{figure} is a loop; make it again with z2p animate SCAN --load-camera {figure}")
    if "batch" in record:
        raise CommandError(f"{figure} is a sheet of {record['batch']} clouds, and its record describes the first only; "
                           "draw it again in Python, or save and change its pictures one by one, as sheet[0].save(...)")


def _find_scan(record: Mapping[str, Any], figure: Path, given: Path | None) -> Path:
    """The file that the picture's cloud came from: the `given` one, or one beside the picture; its digest is compared.

    Raises:
        CommandError: no such file is found, or its content has changed.
    """
    from z2p_renderer.storage.results.fingerprints import file_digest

    source = record["input"]
    if source.get("name") is None:
        raise CommandError(f"{figure} was drawn from an array in Python, not from a file; draw it there again with "
                           "z2p_core.render(points, camera=...)")
    if given:
        candidates = [given]
    else:
        recorded = [figure.parent / source["path"]] if source["path"] else []
        candidates = [*recorded, figure.parent / source["name"], Path(source["name"])]
    files = [candidate for candidate in candidates if candidate.is_file()]
    if not files:
        if given is None and source["path"] is None:
            raise CommandError("the scan came through standard input, so no file is known; name one with --input")
        looked = ", ".join(dict.fromkeys(str(candidate) for candidate in candidates))
        raise CommandError(f"the scan {source['name']} is not to be found (looked for {looked}); name it with --input")
    for file in files:
        if file_digest(file) == source["sha256"]:
            return file
    if given:
        raise CommandError(f"{given} is not the scan that the picture was drawn from (other content); draw it anew "
                           f"with z2p run-inference {given} --load-camera {figure}")
    raise CommandError(f"{files[0]} has changed since; draw it anew with z2p run-inference {files[0]} "
                       f"--load-camera {figure}")


def _draw_again(
    record: Mapping[str, Any], scan: Path, output: Path, controls: dict[str, Value], options: dict[str, Any]
) -> tuple[RenderedScan, Look, dict[str, Any]]:
    """The new picture, the look that it has, and its record."""
    from z2p_core.interfaces import ScanError
    from z2p_renderer.pipeline.coloring.fields import read_scans
    from z2p_renderer.pipeline.inference.render_scan import build_record, render_scan
    from z2p_renderer.pipeline.inference.scan_source import describe_source
    from z2p_renderer.pipeline.inference.weight_selection import load_renderer
    from z2p_renderer.pipeline.legends.marks import Marks
    from z2p_renderer.storage.models.checkpoints import shipped_weights
    from z2p_renderer.storage.scans.clouds import format_suffix

    weights = options["weights"] or record["weights"]["name"]
    if options["weights"] is None and weights not in shipped_weights():
        raise CommandError(f"the picture was drawn with weights that z2p does not ship, {weights!r}; name their file "
                           "with --weights")
    renderer = load_renderer(weights, controls, engine=_select_engine(record, options["engine"]))
    look = _build_changed_look(record, renderer, weights, controls, options).written_as(output.suffix.lower())
    marks = Marks(record.get("scale_bar", False), record.get("axes", False), record.get("unit", ""))
    dpi = record.get("dpi", DEFAULT_DPI if look.is_document else None)
    look = replace(look, dpi=dpi, marks=marks)
    source = record["input"]
    columns = tuple(source["columns"]) if "columns" in source else None
    clouds = read_scans(scan, columns, look.color_options, look.max_rows)
    if source["cloud"] >= len(clouds):
        raise CommandError(f"{scan} holds {len(clouds)} clouds; the picture shows number {source['cloud'] + 1}")
    cloud = clouds[source["cloud"]]
    if isinstance(cloud, ScanError):
        raise cloud
    drawing = render_scan(renderer, cloud, format_suffix(scan), look)
    new_record = build_record(drawing, look, describe_source(scan, output, source["cloud"], columns))
    if options["weights"] is None:
        new_record["weights_chosen"] = record.get("weights_chosen", False)
    if options["load_camera"] is None:
        if not options["azimuth"]:  # keeps the reasons for the placement, which the first drawing found
            new_record["stance"] = {**record["stance"], "smooth": drawing.placement.smoothing_radius}
        if "azimuth" in record["placing"]:  # missing in older records
            new_record["placing"]["azimuth"] = record["placing"]["azimuth"] + options["azimuth"]
    return drawing, look, new_record


def _select_engine(record: Mapping[str, Any], given: str | None) -> str | None:
    """The given engine, else the one that drew the picture if it is installed; None for the automatic choice."""
    from z2p_core.registry import PluginError
    from z2p_renderer.pipeline.inference.engine_selection import check_engine

    recorded: str | None = record.get("engine")  # missing in older records
    if given is not None or recorded is None:
        return given
    try:
        check_engine(recorded)
    except PluginError:
        click.echo(f"note: the engine {recorded!r} that drew the picture is not installed; pixels may differ a little",
                   err=True)
        return None
    return recorded


def _build_changed_look(
    record: Mapping[str, Any], renderer: AnyRenderer, weights: str, controls: dict[str, Value], options: dict[str, Any]
) -> Look:
    """The look of the record with the changes that `controls` and `options` make."""
    from z2p_renderer.pipeline.inference.look import build_look
    from z2p_renderer.pipeline.inference.parse_settings import parse_controls
    from z2p_renderer.pipeline.inference.renderer import Renderer
    from z2p_renderer.pipeline.inference.styles import unused_controls

    if (
        options["weights"] is None
        and isinstance(renderer, Renderer)
        and renderer.weights["sha256"] != record["weights"]["sha256"]
    ):
        click.echo(f"note: the weights {weights!r} are others than those of the picture; its look may differ", err=True)
    recorded_controls = {key: value for key, value in record["controls"].items() if key in renderer.controls}
    dropped = sorted(set(record["controls"]) - set(recorded_controls))
    if dropped and not options["quiet"]:
        click.echo(f"note: the weights {weights!r} have no {' or '.join(dropped)}; the picture's is left out", err=True)
    style = _changed_style(record, options)
    for name in unused_controls(style, renderer, parse_controls(renderer, recorded_controls)):
        del recorded_controls[name]
    if options["load_camera"] is not None:
        recorded_controls.pop("elevation", None)  # the loaded camera has its own
    placing = record["placing"]
    own_camera = _own_camera(record, options)
    camera = _changed_camera(record, controls, options) if own_camera is None else None
    if own_camera is not None and "elevation" not in controls:
        recorded_controls.pop("elevation", None)  # it follows from the camera
    changed = {key: record[key] if options[key] is None else options[key]
               for key in ("resolution", "background", "supersample", "fit")}  # fmt: skip
    return build_look(
        renderer, {**recorded_controls, **controls}, up=placing["up"], view=placing["view"], azimuth=options["azimuth"],
        camera=camera, own_camera=own_camera, keep_outliers=placing["keep_outliers"],
        cut_top=placing["cut_top"],
        smooth=placing.get("smooth", 0.0) if options["smooth"] is None else options["smooth"],  # older records: none
        size=changed["resolution"], background=changed["background"], supersample=changed["supersample"],
        tight=changed["fit"] == "tight", margin=_changed_margin(record, options),
        crop=_kept_crop(record, controls, options),
        color_options=color_options_of_record(record, options, "color" in controls), style=style,
    )  # fmt: skip


def _changed_style(record: Mapping[str, Any], options: dict[str, Any]) -> Style:
    """The given style, else the picture's; with the given radius, else the picture's if the style stays."""
    from z2p_core.style import SURFACE, parse_style

    recorded = record.get("style", SURFACE)
    style = options["style"] or recorded
    radius = options["radius"] or (record.get("radius") if style == recorded else None)
    return parse_style(style, radius)


def _own_camera(record: Mapping[str, Any], options: dict[str, Any]) -> PinholeCamera | None:
    """The loaded camera, else the picture's, in the size that is asked for, if it is one in the data's units.

    Raises:
        SettingError: the file holds several cameras, or none.
    """
    from z2p_core.pinhole import PinholeCamera, camera_from_json
    from z2p_renderer.storage.cameras import read_any_camera

    camera: object = camera_from_json(record["pinhole"]) if "pinhole" in record else None
    if options["load_camera"] is not None:
        camera = read_any_camera(options["load_camera"])
    if not isinstance(camera, PinholeCamera):
        return None
    return camera if options["resolution"] is None else camera.fitted(*options["resolution"])


def _changed_camera(record: Mapping[str, Any], controls: dict[str, Value], options: dict[str, Any]) -> Viewpoint:
    """The loaded camera, else the picture's without its margin; with the elevation that is given."""
    from z2p_core.placement.margin import parse_margin, without_margin
    from z2p_core.placement.viewpoint import viewpoint_from_json
    from z2p_renderer.storage.cameras import read_camera

    camera = viewpoint_from_json(record["camera"])
    if options["load_camera"] is not None:
        camera = read_camera(options["load_camera"])
    elif record.get("fit") != "tight":
        camera = without_margin(camera, parse_margin(record.get("margin")))  # older records: the default margin
    return replace(camera, elevation=controls["elevation"][0]) if "elevation" in controls else camera


def _changed_margin(record: Mapping[str, Any], options: dict[str, Any]) -> float | None:
    """The given margin, else the picture's if the framing stays; None for the default margin.

    Raises:
        click.UsageError: a margin is given with a loaded camera, which determines the size of the object already.
    """
    from z2p_core.placement.margin import parse_margin

    recorded_fit, fit = record.get("fit"), options["fit"] or record.get("fit")
    if options["margin"] is not None:
        if options["load_camera"] is not None and fit == "frame":
            raise click.UsageError("--load-camera and --margin both choose how large the object is; leave one out")
        return float(options["margin"])
    keeps_framing = fit == recorded_fit and (fit == "tight" or options["load_camera"] is None)
    return parse_margin(record.get("margin")) if keeps_framing else None


def _kept_crop(record: Mapping[str, Any], controls: dict[str, Value], options: dict[str, Any]) -> Crop | None:
    """The crop of the picture's series, if it still applies: object, shadow, aspect ratio and fit are unchanged."""
    (width, height), (old_width, old_height) = options["resolution"] or record["resolution"], record["resolution"]
    has_other_camera = options["load_camera"] is not None or options["margin"] is not None
    has_moved = options["azimuth"] or has_other_camera or {"elevation", "light"} & set(controls)
    has_other_frame = width * old_height != height * old_width or options["fit"] is not None
    if has_moved or has_other_frame or record.get("window") is None:
        return None
    left, top, right, bottom = record["window"]
    return left, top, right, bottom
