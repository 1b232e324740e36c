"""The rough rendering in half the time: light from fewer directions, shadows of points instead of discs."""

from __future__ import annotations

from z2p_core.shading.light_transport import Quality
from z2p_renderer.plugins.gbuffers.surfels import Surfels


class Sketch(Surfels):
    """The channels of `Surfels`, with less accurate light, and normals that the network does not refine."""

    name = "sketch"
    version = "1"
    refines = "surfels"
    quality = Quality(
        sky_axes=8, floor_directions=8, mirror_directions=16, floor_sky_directions=64, use_disc_shadows=False,
        use_normal_gnn=False,
    )  # fmt: skip
