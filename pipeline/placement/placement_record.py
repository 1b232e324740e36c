"""How a cloud came to stand in its picture, in numbers and in words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

SETTLED = "as settled"
"""Stands for up where a camera was settled before."""


@dataclass(frozen=True)
class Stance:
    """How a cloud came to stand in its picture, and why."""

    up: str
    up_reason: str
    azimuth: float
    """Degrees that the upright cloud was turned by in all."""
    elevation: float | None
    """Degrees that the view asks of the camera; None leaves it to the settings."""
    view_reason: str
    outliers: int
    """Stray points left out."""
    outside: int = 0
    """Points beyond the frame of a camera that was settled before."""
    background: int = 0
    """Points left out that lie far behind a depth camera's subject."""
    hint: str = ""
    """What the user may want to try."""
    rounded: float = 0.0
    """Step, in the data's units, to which float32 has rounded it far from the origin; 0 where that does not show."""
    smooth: float = 0.0
    """Radius, in the frame's, of the patches that points were moved onto; 0 where they were not."""
    added: int = 0
    """Points put into gaps of what a depth camera measured."""
    far: int = 0
    """Those of the stray points that lie in clusters so far from the largest one that nothing would show."""
    turned: float = 0.0
    """Degrees of the azimuth by which the user turned the view on."""

    def to_json(self) -> dict[str, Any]:
        """The placement as a picture's record and ``--json`` keep it; the keys belong to these formats."""
        return {
            "up": self.up,
            "up_reason": self.up_reason,
            "azimuth": self.azimuth,
            "elevation": self.elevation,
            "view_reason": self.view_reason,
            "outliers": self.outliers,
            "outside": self.outside,
            "background": self.background,
            "hint": self.hint,
            "rounded": self.rounded,
            "smooth": self.smooth,
            "added": self.added,
            "far": self.far,
            "turned": self.turned,
        }

    @property
    def told(self) -> str:
        """Part of a line that says it."""
        parts = (
            self.told_view,
            f"{self.told_strays} left out of the frame" if self.outliers else "",
            "--keep-outliers keeps all" if self.far else "",
            f"{self.background} points far behind it left out" if self.background else "",
            f"{self.outside} points beyond the camera's frame" if self.outside else "",
            f"{self.added} put into small gaps of it" if self.added else "",
            self.told_rounded if self.rounded else "",
            f"made smooth over {self.smooth:.2g} of its radius" if self.smooth else "",
            self.hint,
        )
        return "; ".join(filter(None, parts))

    @property
    def told_view(self) -> str:
        """Up and view, with their reasons; azimuths count from the file's own front, but for what turns a camera on."""
        height = "" if self.elevation is None else f", elevation {round(self.elevation)}"
        if self.up == SETTLED:
            on = f", turned on by {round(self.azimuth)} from there" if self.azimuth else ""
            return f"{self.view_reason}{height}{on}"
        on = f", turned on by {round(self.turned)}" if self.turned else ""
        return (f"up {self.up}: {self.up_reason}; azimuth {round(self.azimuth)} from the file's front{height}: "
                f"{self.view_reason}{on}")

    @property
    def told_strays(self) -> str:
        """How many were left out."""
        few = self.outliers == 1
        if not self.far:
            return f"{self.outliers} stray point{'' if few else 's'}"
        near = "" if self.far == self.outliers else f"{self.outliers - self.far} stray points, and "
        return f"{near}{self.far} point{'' if few else 's'} so far off that next to nothing would show,"

    @property
    def told_rounded(self) -> str:
        """What a `rounded` that is not 0 means."""
        return (f"its float32 numbers, so far from the origin, are rounded to steps of {self.rounded:g}: save float64, "
                "or subtract an offset first")
