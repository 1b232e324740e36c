"""An option for each installed control, made from its slider."""

from __future__ import annotations

from collections.abc import Callable

import click

from z2p_core import registry
from z2p_core.interfaces import Control, SettingError, Value

CONTROL_SETTINGS_KEY = "z2p.settings"
"""Key in click's context of the control settings {control: value}; only those that the user gave are in it."""
HELP_SECTIONS = {
    "Input": ("recursive", "columns", "scan", "weights"),
    "View": ("up", "view", "azimuth", "load_camera", "save_camera", "same_frame", "keep_outliers", "cut_top"),
    "Camera in the data's units": ("look_from", "look_at", "fov", "orthographic"),
    "Picture": ("style", "radius", "smooth", "resolution", "background", "supersample", "fit", "margin", "zoom", "pan",
                "format_", "palette_name"),
    "On paper": ("width_mm", "dpi", "scale_bar", "axes", "unit", "font_pt"),
    "Colours of points": ("color_by", "colormap", "clim", "classes", "relight", "color_bar", "legend"),
    "Motion": ("motion", "frames", "fps", "steady", "hold", "blend", "blend_by", "turns", "closes", "reference",
               "frame_of", "grid"),
}
"""Heading of the help -> its options. Controls follow below Look, and all other options below Output."""


class InferenceCommand(click.Command):
    """Command that gets its control options from the installed plugins when it is called or asked for help."""

    shows_control_defaults = True
    """Whether the help shows the defaults of the controls."""

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        key = "z2p.control_options"
        if key not in ctx.meta:
            taken = {option for param in self.params for option in param.opts}
            ctx.meta[key] = build_control_options(taken, self.shows_control_defaults)
        fixed = super().get_params(ctx)
        return [*fixed[:-1], *ctx.meta[key], fixed[-1]]  # --help stays last

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Writes the options below the headings of `HELP_SECTIONS`, in the order of their declaration."""
        heading_of = {name: heading for heading, names in HELP_SECTIONS.items() for name in names}
        rows: dict[str, list[tuple[str, str]]] = {heading: [] for heading in (*HELP_SECTIONS, "Look", "Output")}
        for parameter in self.get_params(ctx):
            help_row = parameter.get_help_record(ctx)
            if help_row is not None and isinstance(parameter, click.Option):
                name = parameter.name or ""
                is_control = name.startswith("control_")
                rows["Look" if is_control else heading_of.get(name, "Output")].append(help_row)
        for heading, help_rows in rows.items():
            if help_rows:
                with formatter.section(heading):
                    formatter.write_dl(help_rows)


class RerenderCommand(InferenceCommand):
    """Inference command whose controls default to the settings in a picture's record."""

    shows_control_defaults = False


def build_control_options(taken: set[str], shows_defaults: bool = True) -> list[click.Option]:
    """An option for each installed control, made from its slider; one that fails to load gets an option that says so.

    A control whose name is in `taken` (the command's own options) becomes ``--control-<name>``.
    """
    options = []
    for index, name in enumerate(registry.names("controls")):
        flag = f"--{name.replace('_', '-')}"
        if flag in taken:
            flag = f"--control-{name.replace('_', '-')}"
        parse, metavar, help_text = _parser_and_help(name)
        if not shows_defaults:
            help_text = help_text.partition("  [default")[0]
        options.append(_control_option([flag, f"control_{index}"], name, parse, metavar, help_text))
    if not any("--elevation" in option.opts for option in options):  # the option exists without the plugin as well
        help_text = "camera elevation; must be the weights' own"
        options.append(_control_option(["--elevation"], "elevation", _parse_elevation, "DEG", help_text))
    return options


def _control_option(
    names: list[str], control: str, parse: Callable[[str], Value], metavar: str, help_text: str
) -> click.Option:
    """Option whose parsed value is kept in click's context below `CONTROL_SETTINGS_KEY`."""

    def store_parsed(ctx: click.Context, param: click.Parameter, text: str | None) -> None:
        if text is None:
            return
        try:
            ctx.meta.setdefault(CONTROL_SETTINGS_KEY, {})[control] = parse(text)
        except SettingError as error:
            raise click.UsageError(str(error), ctx) from None

    return click.Option(names, metavar=metavar, help=help_text, expose_value=False, callback=store_parsed)


def _parser_and_help(name: str) -> tuple[Callable[[str], Value], str, str]:
    """A control's function that parses text, the metavar of its option, and its help."""
    try:
        control: Control = registry.load("controls", name)()
        slider = control.slider
    except Exception as error:  # raised only if this control is used: the others must stay usable
        load_error = error

        def raise_load_error(text: str) -> Value:
            if isinstance(load_error, registry.PluginError):
                raise load_error
            message = f"control {name!r} fails to load: {type(load_error).__name__}: {load_error}"
            raise registry.PluginError(message) from load_error

        return raise_load_error, "VALUE", "not usable, it fails to load; see `z2p plugins`"
    default = ",".join(f"{number:g}" for number in slider.default)
    metavar = slider.metavar or ",".join(slider.components).upper()
    return control.parse, metavar, f"{slider.help}  [default: {default}]"


def _parse_elevation(text: str) -> Value:
    try:
        return (float(text),)
    except ValueError:
        raise SettingError(f"--elevation: expected degrees, got {text!r}") from None
