"""The options by which points are colored, shared by `z2p render`, `z2p animate` and `z2p rerender`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import click

from z2p_core.coloring.options import AUTO, NONE, RGB, ColorOptions, parse_classes, parse_limits
from z2p_core.interfaces import SettingError, Value
from z2p_renderer.pipeline.cli.options.param_types import FiniteRange

if TYPE_CHECKING:  # slow to import
    from z2p_renderer.pipeline.coloring.color_points import Scale

Command = Callable[..., Any]


class ClassNumbers(click.ParamType):
    """Whole numbers, joined by commas: ``2,5,6``."""

    name = "2,5,6"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[int, ...]:
        if isinstance(value, tuple):
            return value
        try:
            return parse_classes([int(word) for word in str(value).split(",")])
        except (ValueError, SettingError):
            self.fail(f"expected whole numbers joined by commas, such as 2,5,6, got {value!r}", param, ctx)


class ColorLimits(click.ParamType):
    """Two numbers, the lower one first: ``0,2.5``."""

    name = "LOW,HIGH"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, float]:
        if isinstance(value, tuple):
            return value
        try:
            limits = parse_limits([float(word) for word in str(value).split(",")])
        except (ValueError, SettingError):
            limits = None
        if limits is None:
            self.fail(f"expected LOW,HIGH as two finite numbers, the lower one first, such as 0,2.5; got {value!r}",
                      param, ctx)  # fmt: skip
        return limits


class ColormapName(click.ParamType):
    """The name of a colormap, checked when it is given."""

    name = "NAME"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        from z2p_core.coloring.colormaps import colormap_lut

        try:
            colormap_lut(value)
        except SettingError as error:
            self.fail(str(error), param, ctx)
        return str(value)


COLOR_OPTIONS = (
    click.option("--color-by", default=AUTO, metavar="auto|rgb|none|FIELD",
                 help="What colours the points. auto: the file's colours where it has some and no --color is given; "
                 "rgb: these; none: one colour for all; else a field of the file, such as intensity or classification, "
                 "or x, y, z or height. z2p info SCAN lists the fields."),
    click.option("--colormap", type=ColormapName(), show_default=False,
                 help="Colormap of a field: viridis, turbo, batlow, coolwarm_r and hundreds more.  [default: viridis, "
                 "and a palette for labels]"),
    click.option("--clim", type=ColorLimits(), show_default=False,
                 help="Values at both ends of the colormap.  [default: the 2nd and 98th percentile, of all clouds]"),
    click.option("--classes", type=ClassNumbers(), help="Keep only the points of these classes."),
    click.option("--relight", type=FiniteRange(0, 1), metavar="SHARE",
                 help="How much of the studio's light falls on the points' colours: 1 all of it; 0 shows them as they "
                 "are, with the shadow.  [default: 1]"),
    click.option("--color-bar", is_flag=True,
                 help="Draw the colormap's bar, or the classes' legend, beside the picture."),
)  # fmt: skip
"""In the order of the help."""


def color_options(command: Command) -> Command:
    """Decorator that adds `COLOR_OPTIONS` to a command."""
    for option in reversed(COLOR_OPTIONS):
        command = option(command)
    return command


def changed_color_options(command: Command) -> Command:
    """Decorator that adds `COLOR_OPTIONS` to a command whose defaults are those of a record: None where not given."""
    command = color_options(command)
    params: list[click.Option] = command.__dict__["__click_params__"]
    for param in params:
        if param.name in ("color_by", "color_bar"):
            param.default, param.show_default = None, False
    return command


def color_options_from(ctx: click.Context, controls: dict[str, Value], options: dict[str, Any]) -> ColorOptions:
    """The color options that a command's options stand for.

    Raises:
        click.UsageError: one of them would have no effect.
    """
    by = options["color_by"].strip()
    by = by.lower() if by.lower() in (AUTO, RGB, NONE) else by
    if not by:
        raise click.UsageError("--color-by: expected auto, rgb, none or the name of a field, got ''", ctx)
    palette = options.get("palette_name")
    if by not in (AUTO, NONE):
        for given, name in (("color" in controls, "--color"), (palette, "--palette")):
            if given:
                raise click.UsageError(f"--color-by and {name} both choose the colour; leave one out", ctx)
    chosen = ColorOptions(NONE if palette else by, options["colormap"], options["clim"], options["classes"] or (),
                          options["relight"], options["color_bar"])  # fmt: skip
    if chosen.field is None:
        needless = {"--colormap": options["colormap"], "--clim": options["clim"], "--color-bar": options["color_bar"],
                    "--legend": options.get("legend")}  # fmt: skip
        for name, value in needless.items():
            if value:
                raise click.UsageError(f"{name} is for a field's values; name the field with --color-by", ctx)
    return chosen


def color_options_of_record(record: Mapping[str, Any], options: dict[str, Any], is_recolored: bool) -> ColorOptions:
    """The color options of a picture's record, with the changes that a command's options make.

    Args:
        options: those of `COLOR_OPTIONS`; None where the record's stays.
        is_recolored: whether one color for the whole object is chosen now, in place of the recorded ones. It takes the
            place of points' own colors where these are not insisted on.
    """
    by = options["color_by"] or record.get("color_by", AUTO)
    if is_recolored and options["color_by"] is None:
        by = AUTO
    has_same_field = by == record.get("color_by")
    recorded = record if has_same_field else {}
    limits = options["clim"] or recorded.get("clim")
    if limits and limits[0] == limits[1]:  # one value at every point
        limits = None
    return ColorOptions(
        by, options["colormap"] or recorded.get("colormap"), parse_limits(limits),
        options["classes"] or tuple(record.get("classes", ())),
        recorded.get("relight") if options["relight"] is None else options["relight"],
        bool(recorded.get("color_bar")) if options["color_bar"] is None else options["color_bar"],
    )  # fmt: skip


def describe_scale(scale: Scale) -> str:
    """A scale of colors in words: its field, and the limits or the number of classes."""
    from z2p_core.coloring.scales import ColorScale

    if isinstance(scale, ColorScale):
        unit = f" {scale.unit}" if scale.unit else ""
        return f"{scale.field}, {scale.low:.6g} to {scale.high:.6g}{unit}"
    return f"{scale.field}, {len(scale.entries)} classes"
