"""What the page shows, as the options of `z2p run-inference` and as a call of `z2p_core.render`."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import click

from z2p_core.coloring.options import AUTO, NONE, RGB
from z2p_core.interfaces import SettingError, Value
from z2p_renderer.pipeline.cli.commands.render import render
from z2p_renderer.pipeline.cli.options.coloring import color_options_from
from z2p_renderer.pipeline.cli.options.controls import CONTROL_SETTINGS_KEY, InferenceCommand
from z2p_renderer.pipeline.cli.options.pictures import check_view_options

MAX_TEXT = 200
"""Characters that a text setting of the page may have."""
BALLS, SURFACE = "balls", "surface"
"""The style with radii, and the one that needs no option."""
DEFAULT_SIZE = 512
"""Width and height of a picture in pixels."""


@dataclass(frozen=True)
class ViewState:
    """The settings of one page. None and empty stand for the option's default, which is not written."""

    azimuth: float | None = None
    """Degrees from the data's front, absolute; None for the automatic view."""
    up: str = "auto"
    controls: Mapping[str, Value] = field(default_factory=dict)
    """Only those that the user moved."""
    color_by: str = AUTO
    colormap: str = ""
    color_bar: bool = False
    background: str = "transparent"
    size: tuple[int, int] = (DEFAULT_SIZE, DEFAULT_SIZE)
    margin: float | None = None
    """Free border as a share of the shorter side, by which the wheel zooms."""
    zoom: float = 1.0
    """How many times a part of the frame is enlarged."""
    pan: tuple[float, float] = (0.0, 0.0)
    """Shift of what is shown, right and up, in shorter sides of the picture."""
    weights: str = AUTO
    style: str = SURFACE
    radius: str = ""
    """Radius of balls, as the option has it."""
    keep_outliers: bool = False
    same_frame: bool = False
    """Whether all clouds share one frame, in which they keep their sizes and places."""

    def options(self) -> list[str]:
        """The words of `z2p run-inference` that stand for it, without inputs and outputs."""
        texts = {
            "--weights": _unless(self.weights, AUTO), "--up": _unless(self.up, "auto"),
            "--style": _unless(self.style, SURFACE),
            "--radius": self.radius if self.style == BALLS else "",
            "--view": "" if self.azimuth is None else number_text(self.azimuth),
            **{control_flags()[name]: _values_text(value) for name, value in self.controls.items()},
            "--color-by": _unless(self.color_by, AUTO),
            "--colormap": self.colormap if self.has_field else "",
            "--resolution": _unless(",".join(map(str, self.size)), f"{DEFAULT_SIZE},{DEFAULT_SIZE}"),
            "--background": _unless(self.background, "transparent"),
            "--margin": "" if self.margin is None else number_text(self.margin),
            "--zoom": "" if self.zoom == 1 else number_text(self.zoom),
            "--pan": "" if not any(self.pan) else _values_text(self.pan),
        }  # fmt: skip
        switches = {"--color-bar": self.color_bar and self.has_field, "--keep-outliers": self.keep_outliers,
                    "--same-frame": self.same_frame}  # fmt: skip
        words = [word for flag, text in texts.items() if text for word in (flag, text)]
        return [*words, *(flag for flag, is_on in switches.items() if is_on)]

    def keywords(self, default_up: str = "auto") -> dict[str, Any]:
        """The keywords of `z2p_core.render` that stand for it; `default_up` is the one that needs no word."""
        given = {
            "weights": _unless(self.weights, AUTO), "up": _unless(self.up, default_up),
            "style": _unless(self.style, SURFACE), "view": self.azimuth,
            "radius": self.radius if self.style == BALLS else "",
            **{name: value[0] if len(value) == 1 else value for name, value in self.controls.items()},
            "colors": _unless(self.color_by, AUTO), "cmap": self.colormap if self.has_field else "",
            "size": None if self.size == (DEFAULT_SIZE, DEFAULT_SIZE) else self.size,
            "background": _unless(self.background, "transparent"), "margin": self.margin,
            "zoom": None if self.zoom == 1 else self.zoom, "pan": self.pan if any(self.pan) else None,
            "color_bar": (self.color_bar and self.has_field) or None, "keep_outliers": self.keep_outliers or None,
        }  # fmt: skip
        return {name: value for name, value in given.items() if value is not None and value != ""}

    @property
    def has_field(self) -> bool:
        """Whether points are colored by a field, which a colormap and its bar are for."""
        return self.color_by not in (AUTO, RGB, NONE)


def state_from_json(data: Any) -> ViewState:
    """The state that a page sent.

    Raises:
        SettingError: something in it is not of the right kind. Ranges are checked by the options themselves.
    """
    if not isinstance(data, Mapping):
        raise SettingError(f"expected the page's settings as an object, got {type(data).__name__}")
    controls = data.get("controls", {})
    if not isinstance(controls, Mapping) or not set(controls) <= set(control_flags()):
        raise SettingError(f"expected the values of installed controls, got {str(controls)[:MAX_TEXT]}")
    size = data.get("size", [DEFAULT_SIZE, DEFAULT_SIZE])
    if not (isinstance(size, list) and len(size) == 2 and all(type(side) is int for side in size)):
        raise SettingError(f"expected a size of two whole numbers, got {str(size)[:MAX_TEXT]}")
    azimuth = data.get("azimuth")
    margin, pan = data.get("margin"), data.get("pan", [0.0, 0.0])
    if not (isinstance(pan, list) and len(pan) == 2):
        raise SettingError(f"expected a shift of two numbers, got {str(pan)[:MAX_TEXT]}")
    return ViewState(
        azimuth=None if azimuth is None else round(_number(azimuth, "azimuth") % 360.0, 1) % 360.0,
        controls={str(name): _value(value, str(name)) for name, value in controls.items()},
        size=(size[0], size[1]), margin=None if margin is None else round(_number(margin, "margin"), 4),
        zoom=round(_number(data.get("zoom", 1.0), "zoom"), 3),
        pan=(round(_number(pan[0], "pan"), 4), round(_number(pan[1], "pan"), 4)),
        **{name: _text(data[name], name) for name in TEXTS if data.get(name)},  # type: ignore[arg-type]
        **{name: data.get(name) is True for name in SWITCHES},  # type: ignore[arg-type]
    )  # fmt: skip


TEXTS = ("up", "color_by", "colormap", "background", "weights", "style", "radius")
SWITCHES = ("color_bar", "keep_outliers", "same_frame")


def draft_state(state: ViewState, side: int) -> ViewState:
    """The same with a longer side of at most so many pixels."""
    share = min(1.0, side / max(state.size))
    width, height = (max(32, round(pixels * share)) for pixels in state.size)
    return replace(state, size=(width, height))


@dataclass(frozen=True)
class ParsedOptions:
    """Options as `z2p run-inference` reads them."""

    options: dict[str, Any]
    controls: dict[str, Value]
    color_options: Any
    """`z2p_core.coloring.options.ColorOptions`."""


def parse_options(words: list[str]) -> ParsedOptions:
    """`parse_words`, the newest of which are kept: one picture asks for them several times."""
    return parse_words(tuple(words))


@lru_cache(maxsize=8)
def parse_words(words: tuple[str, ...]) -> ParsedOptions:
    """What `z2p run-inference` makes of its options, so that a page can set nothing that the command cannot.

    Raises:
        SettingError: the command refuses them; the message is the command's.
    """
    try:
        context = render.make_context("run-inference", ["scan", *words], resilient_parsing=False)
        with context:
            options, controls = {**context.params, "own_cameras": None}, context.meta.get(CONTROL_SETTINGS_KEY, {})
            check_view_options(context, controls, options)
            return ParsedOptions(options, dict(controls), color_options_from(context, controls, options))
    except click.ClickException as error:
        raise SettingError(" ".join(error.format_message().split())) from error


@lru_cache(maxsize=1)
def control_flags() -> dict[str, str]:
    """Installed control -> the option by which `z2p run-inference` takes it."""
    from z2p_core import registry

    assert isinstance(render, InferenceCommand)
    options = {one.name: one.opts[0] for one in render.get_params(click.Context(render, info_name="run-inference"))}
    return {name: options[f"control_{index}"] for index, name in enumerate(registry.names("controls"))}


def command_text(inputs: list[str], output: str, words: list[str]) -> str:
    """The command as one line for a shell. `words` are `ViewState.options` and others."""
    return shlex.join(["z2p", *command_words(inputs, output, words)])


def command_words(inputs: list[str], output: str, words: list[str]) -> list[str]:
    """The command without its first word, `z2p`."""
    files = [f"./{name}" if name.startswith("-") else name for name in inputs]
    return ["run-inference", *files, "--output", output, *words]


def call_text(sources: list[str], output: str, keywords: Mapping[str, Any], has_batches: bool = False) -> str:
    """The call in Python, for one file or a loop over several.

    Args:
        sources: Python expressions of the points, such as a quoted path.
        output: a picture's name, or that of a folder.
        keywords: of `z2p_core.render`.
        has_batches: whether a file may hold several clouds.
    """
    words = "".join(f", {name}={value!r}" for name, value in keywords.items())
    if len(sources) == 1 and Path(output).suffix == ".png":
        return f"import z2p_core\nz2p_core.render({sources[0]}{words}).save({output!r})"
    lines = ["from pathlib import Path", "import z2p_core", f"for scan in map(Path, [{', '.join(sources)}]):"]
    if not has_batches:
        lines.append(f'    z2p_core.render(scan{words}).save(Path({output!r}) / f"{{scan.stem}}.png")')
    else:
        lines += [f"    for index, picture in enumerate(z2p_core.render(scan{words})):",
                  f"        picture.save(Path({output!r}) / f\"{{scan.stem}}_{{index:03d}}.png\")"]  # fmt: skip
    return "\n".join(lines)


def number_text(number: float) -> str:
    """A number with up to six significant digits, as options and calls show it."""
    return f"{number:.6g}"


def _values_text(value: Value) -> str:
    return ",".join(map(number_text, value))


def _unless(text: str, default: str) -> str:
    return "" if text == default else text


def _value(given: Any, name: str) -> Value:
    if not isinstance(given, list) or not 1 <= len(given) <= 64:
        raise SettingError(f"{name}: expected a list of numbers, got {str(given)[:MAX_TEXT]}")
    return tuple(float(number_text(_number(number, name))) for number in given)


def _number(given: Any, name: str) -> float:
    if isinstance(given, bool) or not isinstance(given, int | float) or not math.isfinite(given):
        raise SettingError(f"{name}: expected a number, got {str(given)[:MAX_TEXT]}")
    return float(given)


def _text(given: Any, name: str) -> str:
    if not isinstance(given, str) or len(given) > MAX_TEXT or not given.isprintable() or (given.startswith("-") and (
        name != "up"
    )):  # fmt: skip
        raise SettingError(f"{name}: expected a short text, got {str(given)[:MAX_TEXT]!r}")
    return given
