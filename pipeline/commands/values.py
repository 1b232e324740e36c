"""What options of several words of meaning are read from."""

from __future__ import annotations

import math
import re
from typing import Any

import click

SIDES = (32, 4096)
"""Smallest and largest side of a picture, pixels."""


class UpAxis(click.Choice):
    """``auto``, or one of ``+Z``, ``-Z``, ``+Y``, ``-Y``, ``+X``, ``-X``, in either case."""

    def __init__(self) -> None:
        super().__init__(["auto", "+Z", "-Z", "+Y", "-Y", "+X", "-X"])

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        return super().convert("auto" if value.lower() == "auto" else value.upper(), param, ctx)


class View(click.ParamType):
    """``auto``, ``front``, ``sensor``, or azimuth and elevation in degrees from ``AZ,EL``."""

    name = "auto|front|sensor|AZ,EL"

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str:
        """As the words are written."""
        return self.name

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> str | tuple[float, float]:
        if isinstance(value, tuple):  # click may hand back what came from here
            return value
        if value.lower() in ("auto", "front", "sensor"):
            return str(value.lower())
        try:
            azimuth, elevation = (float(part) for part in value.split(","))
        except ValueError:
            azimuth = elevation = math.nan
        if not (math.isfinite(azimuth) and 0 <= elevation <= 90):
            self.fail(f"expected auto, front, sensor, or AZ,EL in degrees with EL from 0 to 90, got {value!r}", param,
                      ctx)
        return azimuth, elevation


class Degrees(click.ParamType):
    """A finite number."""

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
    """Degrees, or the word ``random``: drawn for each view as in training."""

    name = "DEG|random"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float | str:
        if value == "random":
            return "random"
        try:
            degrees = float(value)
        except ValueError:
            degrees = math.nan
        if not 0 <= degrees <= 80:
            self.fail(f"expected 0 to 80 degrees or 'random', got {value!r}", param, ctx)
        return degrees


class Resolution(click.ParamType):
    """Width and height in pixels from ``W``, ``W,H`` or ``WxH``."""

    name = "W[,H]"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[int, int]:
        if isinstance(value, tuple):  # click may hand back what came from here
            return value
        match = re.fullmatch(r"\s*(\d{1,6})\s*(?:[,xX]\s*(\d{1,6})\s*)?", value)
        width, height = (int(match[1]), int(match[2] or match[1])) if match else (0, 0)
        if not (SIDES[0] <= width <= SIDES[1] and SIDES[0] <= height <= SIDES[1]):
            self.fail(f"expected W or W,H with sides from {SIDES[0]} to {SIDES[1]} pixels, got {value!r}", param, ctx)
        return width, height


class Background(click.ParamType):
    """sRGB triple in [0, 1] from a CSS name or ``#hex``; the word ``transparent`` stays itself."""

    name = "COLOR"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, float, float] | str:
        if value == "transparent" or isinstance(value, tuple):
            return value
        from pipeline.settings import background_from
        from z2p_core.interfaces import SettingError

        try:
            return background_from(value) or "transparent"
        except SettingError as error:
            self.fail(str(error), param, ctx)


class Grid(click.ParamType):
    """Columns and rows from ``4x3``."""

    name = "COLSxROWS"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[int, int]:
        if isinstance(value, tuple):
            return value
        match = re.fullmatch(r"([1-9]\d?)[xX,]([1-9]\d?)", value.strip())
        if match is None:
            self.fail(f"expected columns and rows from 1x1 to 99x99, got {value!r}", param, ctx)
        return int(match[1]), int(match[2])
