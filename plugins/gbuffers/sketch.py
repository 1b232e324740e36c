"""The rough rendering in half the time: light from fewer directions, and shadows of points instead of discs."""

from __future__ import annotations

from z2p_core.shading.light_transport import Quality
from z2p_renderer.plugins.gbuffers.surfels import Surfels


class Sketch(Surfels):
    """The channels of `Surfels`, less sure of light and, for neighbours do not agree upon them, of normals."""

    name = "sketch"
    version = "1"
    refines = "surfels"
    detail = Quality(sky=8, below=8, mirrored=16, floor_sky=64, discs=False, agreed=False)
