"""An option for each installed control, made from its slider alone."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import click

from z2p_core import registry
from z2p_core.interfaces import Control, SettingError, Value

SETTINGS = "z2p.settings"
"""Key of the control settings in click's context: {control: value}, only those that the user gave."""


class InferenceCommand(click.Command):
    """Command that gets its control options from the installed plugins when it is called or asked for help."""

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        key = "z2p.control_options"
        if key not in ctx.meta:
            ctx.meta[key] = control_options({option for param in self.params for option in param.opts})
        fixed = super().get_params(ctx)
        return [*fixed[:-1], *ctx.meta[key], fixed[-1]]  # --help stays last


def control_options(taken: set[str]) -> list[click.Option]:
    """An option for each installed control, from its slider alone; a broken one gets an option that says so.

    A control whose name is in `taken` (options of the command itself) becomes ``--control-<name>``.
    """
    options = []
    for index, name in enumerate(registry.names("controls")):
        flag = f"--{name.replace('_', '-')}"
        if flag in taken:
            flag = f"--control-{name.replace('_', '-')}"
        read, metavar, text = _control_reader(name)
        options.append(
            click.Option(
                [flag, f"control_{index}"], metavar=metavar, help=text, expose_value=False, callback=_keeper(name, read)
            )
        )
    if not any("--elevation" in option.opts for option in options):  # it exists always: weights have one at least
        read, metavar, text = _plain_elevation, "DEG", "camera elevation; must be the weights' own"
        options.append(
            click.Option(["--elevation"], metavar=metavar, help=text, expose_value=False,
                         callback=_keeper("elevation", read))
        )
    return options


def _control_reader(name: str) -> tuple[Callable[[str], Value], str, str]:
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


def _keeper(name: str, read: Callable[[str], Value]) -> Callable[[click.Context, click.Parameter, Any], None]:
    """Callback that reads the option's text and keeps the value in the context."""

    def keep(ctx: click.Context, param: click.Parameter, text: str | None) -> None:
        if text is None:
            return
        try:
            ctx.meta.setdefault(SETTINGS, {})[name] = read(text)
        except SettingError as error:
            raise click.UsageError(str(error), ctx) from None

    return keep


def _plain_elevation(text: str) -> Value:
    try:
        return (float(text),)
    except ValueError:
        raise SettingError(f"--elevation: expected degrees, got {text!r}") from None
