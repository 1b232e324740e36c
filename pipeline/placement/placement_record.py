"""How a cloud was placed in its picture, in numbers for records and in words for messages."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

FIXED_CAMERA = "as settled"
"""Value of `Placement.up` in records if the camera was given by the user or shared between clouds."""


@dataclass(frozen=True)
class Placement:
    """How a cloud was placed before the camera, and why."""

    up: str
    up_reason: str
    azimuth: float
    """Degrees by which the upright cloud was turned, the user's part included."""
    elevation: float | None
    """Degrees of the camera that the view brings with it; None leaves it to the settings."""
    view_reason: str
    outlier_count: int
    """Outliers left out."""
    outside_count: int = 0
    """Points outside the frame of a fixed camera."""
    background_count: int = 0
    """Points left out because they lie far behind a depth camera's subject."""
    hint: str = ""
    """What the user may want to try."""
    rounding_step: float = 0.0
    """Spacing of float32 numbers, in the data's units, if the file was visibly rounded to it; 0 otherwise."""
    smoothing_radius: float = 0.0
    """Radius, in the frame's, of the surface patches that points were moved onto; 0 if they were not moved."""
    filled_count: int = 0
    """Points added in gaps of a depth camera's measurements."""
    far_count: int = 0
    """Outliers that lie in clusters so far from the largest one that nothing would show."""
    user_azimuth: float = 0.0
    """Part of the azimuth, in degrees, by which the user turned the view."""
    own_camera: bool = False
    """Whether a camera in the data's units determines the side, so that the azimuth means nothing."""

    def to_json(self) -> dict[str, Any]:
        """The placement as a picture's record and ``--json`` keep it; the keys belong to these formats."""
        return {
            "up": self.up,
            "up_reason": self.up_reason,
            "azimuth": self.azimuth,
            "elevation": self.elevation,
            "view_reason": self.view_reason,
            "outliers": self.outlier_count,
            "outside": self.outside_count,
            "background": self.background_count,
            "hint": self.hint,
            "rounded": self.rounding_step,
            "smooth": self.smoothing_radius,
            "added": self.filled_count,
            "far": self.far_count,
            "turned": self.user_azimuth,
        }

    @property
    def description(self) -> str:
        """The placement as parts of one line, joined by semicolons."""
        parts = (
            self.view_description,
            f"{self.outliers_message} left out of the frame" if self.outlier_count else "",
            "--keep-outliers keeps all" if self.far_count else "",
            f"{self.background_count} points far behind it left out" if self.background_count else "",
            f"{self.outside_count} points beyond the camera's frame" if self.outside_count else "",
            f"{self.filled_count} put into small gaps of it" if self.filled_count else "",
            self.rounding_message if self.rounding_step else "",
            f"made smooth over {self.smoothing_radius:.2g} of its radius" if self.smoothing_radius else "",
            self.hint,
        )
        return "; ".join(filter(None, parts))

    @property
    def view_description(self) -> str:
        """Up and view, with their reasons; azimuths count from the file's own front, but for what turns a camera on."""
        height = "" if self.elevation is None else f", elevation {round(self.elevation)}"
        if self.up == FIXED_CAMERA:
            on = f", turned on by {round(self.azimuth)} from there" if self.azimuth else ""
            return f"{self.view_reason}{height}{on}"
        if self.own_camera:
            return f"up {self.up}: {self.up_reason}; {self.view_reason}"
        on = f", turned on by {round(self.user_azimuth)}" if self.user_azimuth else ""
        return (f"up {self.up}: {self.up_reason}; azimuth {round(self.azimuth)} from the file's front{height}: "
                f"{self.view_reason}{on}")

    @property
    def outliers_message(self) -> str:
        """How many points were left out as outliers."""
        few = self.outlier_count == 1
        if not self.far_count:
            return f"{self.outlier_count} stray point{'' if few else 's'}"
        near_count = self.outlier_count - self.far_count
        near = f"{near_count} stray points, and " if near_count else ""
        return f"{near}{self.far_count} point{'' if few else 's'} so far off that next to nothing would show,"

    @property
    def rounding_message(self) -> str:
        """What a `rounding_step` above 0 means and how to avoid it."""
        return (f"its float32 numbers, so far from the origin, are rounded to steps of {self.rounding_step:g}: "
                "save float64, or subtract an offset first")
