"""An option for each installed control, made from its slider alone."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import click

from z2p_core import registry
from z2p_core.interfaces import Control, SettingError, Value

CONTROL_SETTINGS_KEY = "z2p.settings"
"""Key of the control settings in click's context: {control: value}, only those that the user gave."""


HELP_SECTIONS = {
    "Input": ("recursive", "columns", "scan", "weights"),
    "View": ("up", "view", "azimuth", "load_camera", "save_camera", "same_frame", "keep_outliers", "cut_top"),
    "Picture": ("smooth", "resolution", "background", "supersample", "fit", "margin", "format_", "palette_name"),
    "Motion": ("motion", "frames", "fps", "steady"),
}
"""Headings of the help and the options below them; controls come next, and the rest stands below Output."""


class InferenceCommand(click.Command):
    """Command that gets its control options from the installed plugins when it is called or asked for help."""

    defaults_shown = True
    """Whether the help tells the controls' own defaults."""

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        key = "z2p.control_options"
        if key not in ctx.meta:
            taken = {option for param in self.params for option in param.opts}
            ctx.meta[key] = build_control_options(taken, self.defaults_shown)
        fixed = super().get_params(ctx)
        return [*fixed[:-1], *ctx.meta[key], fixed[-1]]  # --help stays last

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The options below headings, in the order in which they are met."""
        headings = {name: heading for heading, names in HELP_SECTIONS.items() for name in names}
        rows: dict[str, list[tuple[str, str]]] = {heading: [] for heading in (*HELP_SECTIONS, "Look", "Output")}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx)
            if record is not None and isinstance(parameter, click.Option):
                control = (parameter.name or "").startswith("control_")
                rows["Look" if control else headings.get(parameter.name or "", "Output")].append(record)
        for heading, told in rows.items():
            if told:
                with formatter.section(heading):
                    formatter.write_dl(told)


class RerenderCommand(InferenceCommand):
    """The same for a picture that has settings already, which are the defaults."""

    defaults_shown = False


def build_control_options(taken: set[str], defaults_shown: bool = True) -> list[click.Option]:
    """An option for each installed control, from its slider alone; a broken one gets an option that says so.

    A control whose name is in `taken` (options of the command itself) becomes ``--control-<name>``.
    """
    options = []
    for index, name in enumerate(registry.names("controls")):
        flag = f"--{name.replace('_', '-')}"
        if flag in taken:
            flag = f"--control-{name.replace('_', '-')}"
        read, metavar, text = _parser_and_help(name)
        text = text if defaults_shown else text.partition("  [default")[0]
        options.append(
            click.Option(
                [flag, f"control_{index}"], metavar=metavar, help=text, expose_value=False, callback=_store_parsed(name, read)
            )
        )
    if not any("--elevation" in option.opts for option in options):  # it exists always: weights have one at least
        read, metavar, text = _parse_elevation, "DEG", "camera elevation; must be the weights' own"
        options.append(
            click.Option(["--elevation"], metavar=metavar, help=text, expose_value=False,
                         callback=_store_parsed("elevation", read))
        )
    return options


def _parser_and_help(name: str) -> tuple[Callable[[str], Value], str, str]:
    """How the option of control `name` is read, its metavar and its help."""
    try:
        control: Control = registry.load("controls", name)()
        slider = control.slider
    except Exception as error:  # kept for whoever asks for this control: it must not break the others
        broken = error

        def refuse(text: str) -> Value:
            if isinstance(broken, registry.PluginError):
                raise broken
            raise registry.PluginError(f"control {name!r} fails to load: {type(broken).__name__}: {broken}") from broken

        return refuse, "VALUE", "not usable, it fails to load; see `z2p plugins`"
    default = ",".join(f"{number:g}" for number in slider.default)
    return control.parse, slider.metavar or ",".join(slider.components).upper(), f"{slider.help}  [default: {default}]"


def _store_parsed(name: str, read: Callable[[str], Value]) -> Callable[[click.Context, click.Parameter, Any], None]:
    """Callback that reads the option's text and keeps the value in the context."""

    def keep(ctx: click.Context, param: click.Parameter, text: str | None) -> None:
        if text is None:
            return
        try:
            ctx.meta.setdefault(CONTROL_SETTINGS_KEY, {})[name] = read(text)
        except SettingError as error:
            raise click.UsageError(str(error), ctx) from None

    return keep


def _parse_elevation(text: str) -> Value:
    try:
        return (float(text),)
    except ValueError:
        raise SettingError(f"--elevation: expected degrees, got {text!r}") from None
