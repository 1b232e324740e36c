"""`z2p figure`: a table of clouds and methods to one figure, still or as a film."""

from __future__ import annotations

import sys
import time
import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from z2p_core.interfaces import Value
from z2p_renderer.pipeline.cli.errors import ExitStatus, is_debugging
from z2p_renderer.pipeline.cli.options.coloring import color_options, color_options_from
from z2p_renderer.pipeline.cli.options.controls import CONTROL_SETTINGS_KEY, InferenceCommand
from z2p_renderer.pipeline.cli.options.palettes import PALETTES, palette_colors
from z2p_renderer.pipeline.cli.options.paper import DEFAULT_DPI, paper_options, with_paper
from z2p_renderer.pipeline.cli.options.param_types import FiniteRange, OutputPath, is_output_folder
from z2p_renderer.pipeline.cli.options.pictures import (
    check_view_options,
    check_writable,
    look_from_options,
    picture_options,
)
from z2p_renderer.pipeline.cli.progress import note_if_opaque

if TYPE_CHECKING:  # slow to import: imported at run time only when the options have been read
    from z2p_renderer.pipeline.outputs.figure import FigurePage
    from z2p_renderer.pipeline.outputs.figure_cells import CellDrawer

IGNORED = ("recursive", "columns")
"""Options of pictures that a table has no use for."""


@click.command(cls=InferenceCommand, context_settings={"show_default": True})
@click.argument("table", type=click.Path(path_type=Path), metavar="TABLE")
@click.option("--output", "-o", default="figure.pdf", type=OutputPath(file=True), metavar="FILE",
              help="The figure: .pdf, .svg, .png, .webp, .tif, .jpg; or a film: .mp4, .gif, .apng, or .webp with "
              "--frames.")
@click.option("--frames", type=click.IntRange(2, 720), metavar="N",
              help="Make a film of so many frames, in which all objects turn together.  [default for films: 48]")
@click.option("--motion", default="turn", type=click.Choice(["turn", "light"]),
              help="What moves in a film: the objects, or the light.")
@click.option("--fps", default=24.0, type=FiniteRange(1, 60), metavar="N", help="Frames per second of a film.")
@click.option("--palette", "palette_name", type=click.Choice(list(PALETTES)),
              help="A colour for each shape in turn, the same for all methods.")
@click.option("--camera", default="shape", type=click.Choice(["shape", "table"]),
              help="shape: one camera for the clouds of a shape, so that methods compare; table: one for all cells, so "
              "that sizes of shapes compare too.")
@click.option("--font-pt", default=8.0, type=FiniteRange(3, 40), metavar="PT", help="Size of the titles, in points.")
@picture_options
@paper_options
@color_options
@click.option("--overwrite", is_flag=True, help="Replace a figure of that name.")
@click.option("--quiet", "-q", is_flag=True, help="Report failures only.")
@click.pass_context
def figure(ctx: click.Context, table: Path, output: Path, **options: Any) -> None:
    """Draw a table of clouds, shapes by methods, as one figure with titles on its rows and columns.

    \b
    z2p figure table.csv -o figure.pdf --width-mm 174 --palette okabe-ito
    z2p figure table.toml -o figure.png --resolution 320 --background white
    z2p figure table.toml -o figure.mp4 --resolution 240 --frames 48

    The table is a CSV (titles of columns in its first line, a title and paths in each further line) or a TOML
    (columns = [...], then [[rows]] with title and cells). A cell names a scan, scan.npz#3 for the third cloud of a
    file, or a picture, which is shown as it is. Paths are relative to the table.

    Cells have one size, --resolution, or what --width-mm, then the whole figure's, leaves for them. What it cannot do:
    titles are one line each, and scale bars and axes in cells are pixels, in PDF and SVG too.

    Exit status: 0 made, 1 some cells are empty because their files failed, 2 wrong usage or no figure.
    """
    with warnings.catch_warnings():
        if not is_debugging():
            warnings.simplefilter("ignore")  # warnings of libraries would bury the lines of progress
        failed = _run(ctx, table, output, ctx.meta.get(CONTROL_SETTINGS_KEY, {}), options)
    ctx.exit(ExitStatus.SOME_FAILED if failed else ExitStatus.DONE)


def _run(
    ctx: click.Context, file: Path, output: Path, controls: dict[str, Value], options: dict[str, Any]
) -> bool:  # fmt: skip
    """Makes the figure; returns True if cells failed."""
    _check_options(ctx, controls, options)
    colors = color_options_from(ctx, controls, options)
    is_film = _is_film(ctx, output, options)
    _check_output(ctx, file, output, is_film, options)
    from z2p_renderer.pipeline.inference.weight_selection import load_renderer
    from z2p_renderer.pipeline.outputs.figure import FigurePage, lay_out
    from z2p_renderer.pipeline.outputs.figure_cells import CellDrawer
    from z2p_renderer.storage.figure_tables import read_figure_table

    started, failures, table = time.perf_counter(), [], read_figure_table(file)

    def report(line: str) -> None:
        failures.append(line)
        click.echo(f"failed: {line}; its cell stays empty", err=True)

    renderer = load_renderer(options["weights"], {*controls, *(["color"] if options["palette_name"] else [])},
                             engine=options["engine"])  # fmt: skip
    look = with_paper(look_from_options(renderer, controls, options, colors), options)
    dpi = options["dpi"] or DEFAULT_DPI
    drawer = CellDrawer(table, renderer, look, _palette(options), options["camera"] == "table", report)
    scale = None
    if options["color_bar"]:  # it takes some of the width, so its values are needed before the cells have a size
        drawer.prepare()
        scale = drawer.scale
    layout = lay_out(table, (look.width, look.height), dpi, options["font_pt"], options["width_mm"], scale)
    drawer = replace(drawer, look=replace(look, width=layout.cell[0], height=layout.cell[1]))
    drawer.prepare()
    background = look.written_as(output.suffix.lower()).background
    page = FigurePage(table, layout, drawer.scale if options["color_bar"] else None, background)
    _write(page, drawer, output, is_film, background, dpi, options)
    if not options["quiet"]:
        seconds = time.perf_counter() - started
        click.echo(f"rendered: {file} -> {output} ({layout.cell[0]}x{layout.cell[1]} pixels a cell, {seconds:.1f} s)",
                   err=True)
    return bool(failures)


def _palette(options: dict[str, Any]) -> tuple[Value, ...]:
    return palette_colors(options["palette_name"]) if options["palette_name"] else ()


def _check_options(ctx: click.Context, controls: dict[str, Value], options: dict[str, Any]) -> None:
    """
    Raises:
        click.UsageError: an option would have no effect, or two contradict each other.
    """
    check_view_options(ctx, controls, options)
    if options["palette_name"] and "color" in controls:
        raise click.UsageError("--palette and --color both choose the colour; leave one out", ctx)
    if options["fit"] == "tight":
        raise click.UsageError("--fit tight would give cells different sizes; choose a small --margin instead", ctx)
    for name in IGNORED:
        if options[name]:
            raise click.UsageError(f"--{name} is of no use here: the table names each file", ctx)


def _is_film(ctx: click.Context, output: Path, options: dict[str, Any]) -> bool:
    """Whether the output is a film; sets the number of its frames.

    Raises:
        click.UsageError: --frames is given for a format that does not move.
    """
    from z2p_renderer.storage.images.animations import ANIMATION_SUFFIXES

    suffix = output.suffix.lower()
    is_film = suffix in ANIMATION_SUFFIXES and (suffix != ".webp" or options["frames"] is not None)
    if options["frames"] is not None and not is_film:
        raise click.UsageError(f"--frames: a {suffix or 'nameless format'} does not move; name a film: "
                               f"{', '.join(ANIMATION_SUFFIXES)}", ctx)  # fmt: skip
    options["frames"] = options["frames"] or 48
    return is_film


def _check_output(ctx: click.Context, file: Path, output: Path, is_film: bool, options: dict[str, Any]) -> None:
    """Makes sure beforehand that the figure can be written.

    Raises:
        click.UsageError: it is a folder, of no known format, or there already.
        PictureError: a film's extra is missing.
    """
    from z2p_renderer.storage.files.printable_names import path_exists, printable
    from z2p_renderer.storage.images.animations import check_animation_suffix
    from z2p_renderer.storage.images.image_files import DOCUMENT_SUFFIXES, FORMATS

    suffix = output.suffix.lower()
    if is_output_folder(ctx, output):
        raise click.UsageError(f"--output {output}: expected the figure's name, got a folder's", ctx)
    if is_film:
        check_animation_suffix(suffix)
    elif suffix not in (*FORMATS, *DOCUMENT_SUFFIXES):
        known = ", ".join((*DOCUMENT_SUFFIXES, *FORMATS, ".mp4", ".gif", ".apng"))
        raise click.UsageError(f"--output {printable(output)}: expected a figure named {known}", ctx)
    check_writable(output.parent)
    if path_exists(output) and not options["overwrite"]:
        raise click.UsageError(f"--output {printable(output)} is there already; --overwrite replaces it", ctx)
    if options["background"] == "transparent" and not options["quiet"]:
        note_if_opaque(suffix)


def _write(
    page: FigurePage, drawer: CellDrawer, output: Path, is_film: bool, background: Any, dpi: float,
    options: dict[str, Any],
) -> None:  # fmt: skip
    """Draws all cells and writes the figure."""
    from z2p_renderer.pipeline.outputs.animation import Motion
    from z2p_renderer.storage.files.atomic_write import atomic_write
    from z2p_renderer.storage.images.animations import write_animation
    from z2p_renderer.storage.images.image_files import DOCUMENT_SUFFIXES, write_picture

    suffix = output.suffix.lower()
    if is_film:
        moving = drawer.turning(Motion(options["motion"], options["frames"]))
        frames: Iterator[Any] = (page.pixels(pictures) for pictures in moving)
        if not options["quiet"] and sys.stderr.isatty():
            from tqdm import tqdm

            frames = tqdm(frames, total=options["frames"], unit="frame", file=sys.stderr, leave=False)
        write_animation(frames, output, options["fps"], background)
    elif suffix in DOCUMENT_SUFFIXES:
        atomic_write(page.document(drawer.pictures(), suffix[1:]), output)
    else:
        write_picture(page.pixels(drawer.pictures()), output, background, dpi=dpi)
