"""The user's options for the placement of a scan."""

from __future__ import annotations

from dataclasses import dataclass

from z2p_core.pinhole import AnyCamera
from z2p_core.placement.viewpoint import Viewpoint


@dataclass(frozen=True)
class PlacementOptions:
    """The user's options for the placement of a scan."""

    up: str = "auto"
    """``auto``, or the data's axis that points up: ``+Z``, ``-Y``, ..."""
    view: str | float = "auto"
    """``auto``, ``front`` (the data's own front), ``sensor``, or an azimuth in degrees."""
    azimuth: float = 0.0
    """Degrees that the view is turned by on top."""
    keep_outliers: bool = False
    """Keeps outliers, and what lies far behind a depth camera's subject."""
    cut_top: float = 0.0
    """Percent of the height that is cut off from above, such as a room's ceiling."""
    viewpoint: Viewpoint | None = None
    """A fixed camera: it replaces `up`, `view` and the cloud's own frame; `azimuth` still turns it."""
    smooth: str | float = "auto"
    """Radius, in the frame's, of the surface patches that points are moved onto; 0 leaves points where they are.

    ``auto`` smooths only noisy clouds of depth cameras. Gaps in a depth camera's measurements are filled unless 0.
    """
    camera: AnyCamera | None = None
    """A camera in the data's units: it replaces `view` and the frame; the cloud is still set upright by `up`."""
    points_alone: bool = False
    """Whether few points stay as they are, as the style of balls draws them; else each becomes a ball of points."""
    grounded: bool = False
    """Moves the cloud onto the floor of `viewpoint`, whatever its height."""
