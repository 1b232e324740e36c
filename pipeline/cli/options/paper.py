"""The options for pictures on paper: their width and dots per inch, a scale bar, and axes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click

from z2p_core.scene import SIDE_LIMITS
from z2p_renderer.pipeline.cli.options.param_types import FiniteRange

if TYPE_CHECKING:  # slow to import: imported at run time only when the options have been read
    from z2p_renderer.pipeline.inference.look import Look

Command = Callable[..., Any]
DEFAULT_DPI = 300.0
"""Dots per inch of a picture whose width on paper is given."""
MM_PER_INCH = 25.4
DEFAULT_AXES_MARGIN = 0.2
"""Free border that leaves room for the texts of axes, as a share of the shorter side."""
TIGHT_AXES_MARGIN = 0.12
"""The same in a picture that is trimmed."""

PAPER_OPTIONS = (
    click.option("--width-mm", type=FiniteRange(5, 2000), metavar="MM",
                 help="Width on paper, in millimetres: with --dpi it sets the pixels, with --resolution the dots per "
                 "inch. It is the frame's: --fit tight makes the picture narrower, a colour bar wider."),
    click.option("--dpi", type=FiniteRange(1, 10_000), show_default=False, metavar="N",
                 help="Dots per inch, noted in PNG, TIFF, JPEG, PDF and SVG; WebP cannot hold it.  [default: 300 with "
                 "--width-mm and in PDF and SVG, else not noted]"),
)  # fmt: skip
MARK_OPTIONS = (
    click.option("--scale-bar", is_flag=True,
                 help="Draw a bar of a round length in the data's units. It holds at the depth of the object's middle; "
                 "what is nearer looks larger."),
    click.option("--axes", is_flag=True,
                 help="Draw the data's axes with ticks, along three edges of the cloud's box. The margin is 0.2 then, "
                 "tight 0.12, unless given."),
    click.option("--unit", metavar="NAME", default="",
                 help="Unit of the data's coordinates, such as m, for --scale-bar and --axes; files do not tell it."),
)  # fmt: skip


def paper_options(command: Command) -> Command:
    """Decorator that adds `PAPER_OPTIONS` and `MARK_OPTIONS` to a command."""
    for option in reversed((*PAPER_OPTIONS, *MARK_OPTIONS)):
        command = option(command)
    return command


def settle_resolution(ctx: click.Context, options: dict[str, Any]) -> None:
    """Computes ``resolution`` and ``dpi`` in the options from the width on paper, in place.

    Raises:
        click.UsageError: all three of --width-mm, --dpi and --resolution are given, or a picture would be too large.
    """
    width_mm = options["width_mm"]
    if width_mm is None:
        return
    width, _ = options["resolution"]
    if ctx.get_parameter_source("resolution") is click.core.ParameterSource.DEFAULT:
        dpi = options["dpi"] or DEFAULT_DPI
        pixels = round(width_mm / MM_PER_INCH * dpi)
        least, most = SIDE_LIMITS
        if not least <= pixels <= most:
            raise click.UsageError(f"--width-mm {width_mm:g} at {dpi:g} dpi is {pixels} pixels; expected {least} to "
                                   f"{most}: choose another --dpi", ctx)
        options["resolution"], options["dpi"] = (pixels, pixels), dpi
        return
    if options["dpi"] is not None:
        raise click.UsageError("--resolution, --width-mm and --dpi: two of them set the third; leave one out", ctx)
    options["dpi"] = width / width_mm * MM_PER_INCH


def with_paper(look: Look, options: dict[str, Any]) -> Look:
    """The look with the dots per inch, scale bar and axes of the options.

    Raises:
        click.UsageError: a unit is given that nothing would show.
    """
    from z2p_renderer.pipeline.legends.marks import Marks

    marks = Marks(options["scale_bar"], options["axes"], " ".join(options["unit"].split()))
    if marks.unit and not marks:
        raise click.UsageError("--unit is for --scale-bar and --axes; add one of them, or leave it out")
    has_room = look.margin is not None or (options["load_camera"] is not None and not look.tight)
    usual = TIGHT_AXES_MARGIN if look.tight else DEFAULT_AXES_MARGIN
    margin = usual if marks.axes and not has_room else look.margin
    return replace(look, marks=marks, dpi=options["dpi"], margin=margin)
