"""Limits of all values of the report's configuration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from z2p_core.config.pipeline import DENOISE_QUALITIES
from z2p_core.config.pipeline_limits import (
    FOLDER_LIMIT,
    NAME_LIMIT,
    POINTS_LIMIT,
    SAMPLES_LIMIT,
    SEED_LIMIT,
    Plugin,
)
from z2p_core.errors.value_limits import Choice, Count, DataclassFields, Limit, ListOf, Number, Text

_MESHES = Count(0, 100_000)
_MATERIAL = Text("metallic and roughness, each 0 to 1, as in 1,0.3", r"(0(\.\d+)?|1(\.0+)?),(0(\.\d+)?|1(\.0+)?)", 40)


@dataclass(frozen=True)
class _Colour:
    """An opaque colour."""

    expected: str = "a CSS colour name or #hex"

    def allows(self, value: Any) -> bool:
        from PIL import ImageColor  # late: only the report needs it

        if not isinstance(value, str) or len(value) > 100:
            return False
        try:
            return len(ImageColor.getrgb(value)) == 3
        except ValueError:
            return False


@dataclass(frozen=True)
class _Sweep:
    """The levels of a sweep, and its number of meshes."""

    level: Limit

    @property
    def fields(self) -> DataclassFields:
        return DataclassFields({"levels": ListOf(self.level, 0, 100, distinct=True), "meshes": _MESHES})


SWEEPS: dict[str, Limit] = {
    "base": Number(0, 0),
    "noise": Number(0, 10),
    "density": Number(1, 20_000_000),
    "sampling": Plugin(("samplers",), ("non-uniform",)),
    "inner": Number(0, 0.9),
    "scale": Number(0.01, 1),
    "single": Choice(("clean", "noise", "holes")),
    "lift": Number(0, 10),
    "light": Number(-90, 90),
    "color": _Colour(),
    "turning": Number(-360, 360),
    "material": _MATERIAL,
    "texture": Plugin(("textures",), ("none",)),
    "sheet": Number(0, 1),
    "scene": Number(1, 100),
    "bumps": Number(1, 128),
    "gap": Number(0, 2, exclude_minimum=True),
}
"""Sweep -> limit of its levels."""

REPORT: dict[str, Limit | DataclassFields] = {
    "name": NAME_LIMIT,
    "meshes": FOLDER_LIMIT,
    "scans": FOLDER_LIMIT,
    "weights": ListOf(Text("the name or file of weights"), 0, 100),
    "baselines": ListOf(Plugin(("baselines", "painters")), 0, 100, distinct=True),
    "views": Count(1, 100_000),
    "points": POINTS_LIMIT,
    "resolution": Count(32, 8192),
    "samples": SAMPLES_LIMIT,
    "denoise": Choice(DENOISE_QUALITIES),
    "seed": SEED_LIMIT,
    "time_repeats": Count(1, 1000),
    "trust_draws": Count(0, 1000),
    "trust_meshes": _MESHES,
    **{name: _Sweep(level).fields for name, level in SWEEPS.items()},
}
