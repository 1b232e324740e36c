"""Types of option values that click does not have: paths to write, axes, views, sizes, colors."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from z2p_core.scene import SIDE_LIMITS

MAX_ELEVATION_DEGREES = 80
"""Largest camera elevation above the horizon that weights are trained for, degrees."""
MAX_NAME_BYTES = 255
"""Longest name of a file or folder on nearly every file system, bytes."""
IS_FOLDER_KEY = "z2p.folder"
"""Key in click's context: True if the user's output ends in a slash, and thus names a folder."""


class OutputPath(click.ParamType):
    """Path to write to. One that ends in a slash names a folder, which is refused if `file` is True."""

    name = "OUT"

    def __init__(self, file: bool = False) -> None:
        self.file = file

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        if isinstance(value, Path):  # click converts defaults and converted values again
            return value
        if not value:
            self.fail("expected a path, got ''; is the variable empty that should hold it?", param, ctx)
        if value == "-":
            self.fail("nothing is written to standard output: expected a path, got '-' (./- is one)", param, ctx)
        if value.endswith((os.sep, os.altsep or os.sep)):
            if self.file:
                self.fail(f"expected a file's name, got a folder's, {value!r}; add a name", param, ctx)
            if ctx is not None:
                ctx.meta[IS_FOLDER_KEY] = True
        longest = max((len(os.fsencode(part)) for part in Path(value).parts), default=0)
        if longest > MAX_NAME_BYTES:
            self.fail(f"expected names of at most {MAX_NAME_BYTES} bytes, got one of {longest}", param, ctx)
        return Path(value)


def is_output_folder(ctx: click.Context, output: Path) -> bool:
    """Whether an output is a folder, or is written as one."""
    return bool(ctx.meta.get(IS_FOLDER_KEY)) or output.is_dir()


class FiniteRange(click.FloatRange):
    """A range without nan, which click's own lets through."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"expected a finite number, got {value!r}", param, ctx)
        return number


class UpAxis(click.Choice):
    """``auto``, or one of ``+Z``, ``-Z``, ``+Y``, ``-Y``, ``+X``, ``-X``; ``Y``, ``y`` and ``y-up`` mean ``+Y``.

    A direction ``X,Y,Z`` stays a text.
    """

    def __init__(self) -> None:
        super().__init__(["auto", "+Z", "-Z", "+Y", "-Y", "+X", "-X"])

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        from z2p_core.up_axis.axis_names import parse_up_axis

        axis = parse_up_axis(value)
        return axis if axis is not None and "," in axis else super().convert(axis or value, param, ctx)


class Position(click.ParamType):
    """A position in the data's coordinates, as ``X,Y,Z``."""

    name = "X,Y,Z"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, float, float]:
        if isinstance(value, tuple):  # click converts defaults and converted values again
            return value
        try:
            x, y, z = (float(part) for part in value.split(","))
        except ValueError:
            x = y = z = math.nan
        if not all(map(math.isfinite, (x, y, z))):
            self.fail(f"expected three numbers X,Y,Z, got {value!r}", param, ctx)
        return x, y, z


class Shift(click.ParamType):
    """A shift in the picture, as ``X,Y``."""

    name = "X,Y"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, float]:
        if isinstance(value, tuple):  # click converts defaults and converted values again
            return value
        try:
            x, y = (float(part) for part in value.split(","))
        except ValueError:
            x = y = math.nan
        if not all(map(math.isfinite, (x, y))):
            self.fail(f"expected two numbers X,Y, got {value!r}", param, ctx)
        return x, y


class PassNames(click.ParamType):
    """Names of passes with commas between them, or ``all``."""

    name = "NAMES"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[str, ...]:
        if isinstance(value, tuple):
            return value
        from z2p_core.interfaces import SettingError
        from z2p_core.pass_names import parse_passes

        try:
            return parse_passes(value)
        except SettingError as error:
            self.fail(str(error).removeprefix("passes: "), param, ctx)


class ViewDirection(click.ParamType):
    """``auto``, ``front``, ``sensor``, an azimuth in degrees, or with the elevation as ``AZ,EL``."""

    name = "auto|front|sensor|AZ[,EL]"

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str:
        """The name as it is, which click would write in capitals."""
        return self.name

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> str | float | tuple[float, float]:
        if isinstance(value, tuple | float):  # click converts defaults and converted values again
            return value
        if value.lower() in ("auto", "front", "sensor"):
            return str(value.lower())
        try:
            azimuth, *elevation = (float(part) for part in value.split(","))
        except ValueError:
            azimuth, elevation = math.nan, []
        in_range = len(elevation) < 2 and all(0 <= degrees <= MAX_ELEVATION_DEGREES for degrees in elevation)
        if not (math.isfinite(azimuth) and in_range):
            self.fail("expected auto, front, sensor, or AZ or AZ,EL in degrees with EL from 0 to "
                      f"{MAX_ELEVATION_DEGREES}, got {value!r}", param, ctx)  # fmt: skip
        return (azimuth, elevation[0]) if elevation else azimuth


class FileFormat(click.Choice):
    """A file format, given by its name or its suffix, in upper or lower case."""

    def __init__(self, formats: Sequence[str], aliases: Mapping[str, str]) -> None:
        super().__init__(list(formats), case_sensitive=False)
        self._aliases = aliases

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        name = value.lower().lstrip(".")
        return super().convert(self._aliases.get(name, name), param, ctx)


class MarginShare(click.ParamType):
    """Margin as a share of the picture's shorter side; see `z2p_core.placement.margin.parse_margin`."""

    name = "SHARE"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float | None:
        from z2p_core.interfaces import SettingError
        from z2p_core.placement.margin import parse_margin

        try:
            return parse_margin(value)
        except SettingError as error:
            self.fail(str(error).removeprefix("margin: "), param, ctx)


class SmoothRadius(click.ParamType):
    """Smoothing radius, or ``auto``; see `pipeline.inference.parse_settings.parse_smoothing`."""

    name = "auto|R"

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str:
        """The name as it is, which click would write in capitals."""
        return self.name

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str | float:
        from z2p_core.interfaces import SettingError
        from z2p_renderer.pipeline.inference.parse_settings import parse_smoothing

        try:
            return parse_smoothing(value)
        except SettingError as error:
            self.fail(str(error), param, ctx)


class Degrees(click.ParamType):
    """An angle in degrees: any finite number."""

    name = "DEG"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        try:
            degrees = float(value)
        except ValueError:
            degrees = math.nan
        if not math.isfinite(degrees):
            self.fail(f"expected degrees, got {value!r}", param, ctx)
        return degrees


class Elevation(click.ParamType):
    """Camera elevation in degrees, or ``random``: sampled for each view as in training."""

    name = "DEG|random"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float | str:
        if value == "random":
            return "random"
        try:
            degrees = float(value)
        except ValueError:
            degrees = math.nan
        if not 0 <= degrees <= MAX_ELEVATION_DEGREES:
            self.fail(f"expected 0 to {MAX_ELEVATION_DEGREES} degrees or 'random', got {value!r}", param, ctx)
        return degrees


class Resolution(click.ParamType):
    """Width and height in pixels from ``W``, ``W,H`` or ``WxH``."""

    name = "W[,H]"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[int, int]:
        if isinstance(value, tuple):  # click converts defaults and converted values again
            return value
        match = re.fullmatch(r"\s*(\d{1,6})\s*(?:[,xX]\s*(\d{1,6})\s*)?", value)
        width, height = (int(match[1]), int(match[2] or match[1])) if match else (0, 0)
        minimum, maximum = SIDE_LIMITS
        if not (minimum <= width <= maximum and minimum <= height <= maximum):
            self.fail(f"expected W or W,H with sides from {minimum} to {maximum} pixels, got {value!r}", param, ctx)
        return width, height


class BackgroundColor(click.ParamType):
    """sRGB triple in [0, 1] from a CSS name, ``#hex`` or ``r,g,b``; or the word ``transparent``."""

    name = "COLOR"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, float, float] | str:
        if isinstance(value, tuple):
            return value
        from z2p_core.interfaces import SettingError
        from z2p_renderer.pipeline.inference.parse_settings import parse_background

        try:
            return parse_background(value) or "transparent"
        except SettingError as error:
            self.fail(str(error), param, ctx)


class SheetGrid(click.ParamType):
    """Columns and rows of a contact sheet, as in ``4x3``."""

    name = "COLSxROWS"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[int, int]:
        if isinstance(value, tuple):
            return value
        match = re.fullmatch(r"([1-9]\d?)[xX,]([1-9]\d?)", value.strip())
        if match is None:
            self.fail(f"expected columns and rows from 1x1 to 99x99, got {value!r}", param, ctx)
        return int(match[1]), int(match[2])
