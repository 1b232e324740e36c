"""The channels of the G-buffer `surfels` and of the material layer of `glossy`: one definition of each index.

G-buffer (10, H, W) float32, `GBufferChannel`. The first nine are 0 where no surfel is drawn.

===== ================== ======== ====== ===============================================================================
index name               range    unit   meaning
===== ================== ======== ====== ===============================================================================
0     COVERAGE           [0, 1]   -      confidence that a surfel covers the pixel: 1 - exp(-gain * w), w the sum of the
                                         surfels' weights (1 at a surfel's center, 0 at its rim)
1     DENSITY            [0, 1]   -      w over its value inside a closed surface; about a third at a surface's border
2     DEPTH              [0, 1]   -      linear in the distance to the camera's plane: 1 at the near end of the unit
                                         sphere, 0 at its far end (`z2p_core.camera.DEPTH_RANGE`)
3     NORMAL_RIGHT       [-1, 1]  -      component of the surface normal along the camera's +X axis
4     NORMAL_DOWN        [-1, 1]  -      along its +Y axis
5     RADIANCE_GREY      [0, 1]   sRGB   radiance of a diffuse surface with a fixed grey albedo
6     RADIANCE_RED       [0, 1]   sRGB   radiance of the surface with its own material
7     RADIANCE_GREEN     [0, 1]   sRGB
8     RADIANCE_BLUE      [0, 1]   sRGB
9     SHADOW             [0, 1]   alpha  opacity of the shadow on the floor
===== ================== ======== ====== ===============================================================================

Material layer (9, H, W) float32, `MaterialChannel`: what `glossy` needs at each pixel to add reflections there. The
first three are those of the G-buffer; the others are per-point values, averaged over the surfels of a pixel.

===== ================== ======== ====== ===============================================================================
index name               range    unit   meaning
===== ================== ======== ====== ===============================================================================
0-2   COVERAGE .. DEPTH                  as in `GBufferChannel`
3     NORMAL_FORWARD     [-1, 1]  -      component of the surface normal along the camera's +Z axis (< 0: towards it)
4     STEADY_RED         >= 0     linear radiance that varies little over a surfel: all but the mirrored light, sky and
                                         floor
5     STEADY_GREEN       >= 0     linear
6     STEADY_BLUE        >= 0     linear
7     LIGHT_VISIBILITY   [0, 1]   -      fraction of the area light that is visible from the point
8     MIRROR_VISIBILITY  [0, 1]   -      fraction of the mirrored sky and floor that is visible from the point
===== ================== ======== ====== ===============================================================================
"""

from __future__ import annotations

from enum import IntEnum


class GBufferChannel(IntEnum):
    """Index of each channel of the G-buffer; the table is in the module's docstring."""

    COVERAGE = 0
    DENSITY = 1
    DEPTH = 2
    NORMAL_RIGHT = 3
    NORMAL_DOWN = 4
    RADIANCE_GREY = 5
    RADIANCE_RED = 6
    RADIANCE_GREEN = 7
    RADIANCE_BLUE = 8
    SHADOW = 9


class MaterialChannel(IntEnum):
    """Index of each channel of the material layer; the table is in the module's docstring."""

    COVERAGE = 0
    DENSITY = 1
    DEPTH = 2
    NORMAL_FORWARD = 3
    STEADY_RED = 4
    STEADY_GREEN = 5
    STEADY_BLUE = 6
    LIGHT_VISIBILITY = 7
    MIRROR_VISIBILITY = 8


NORMAL_XY = slice(GBufferChannel.NORMAL_RIGHT, GBufferChannel.NORMAL_DOWN + 1)
"""The two channels of the normal, in the camera's axes."""
RADIANCE = slice(GBufferChannel.RADIANCE_GREY, GBufferChannel.RADIANCE_BLUE + 1)
"""The four channels of radiance: grey, then in the surface's own material."""
RADIANCE_RGB = slice(GBufferChannel.RADIANCE_RED, GBufferChannel.RADIANCE_BLUE + 1)
"""The three channels of radiance in the surface's own material."""
STEADY_RGB = slice(MaterialChannel.STEADY_RED, MaterialChannel.STEADY_BLUE + 1)
RASTERIZED = slice(0, GBufferChannel.SHADOW)
"""The channels that `z2p_core.native.rasterize_surfels` draws: three of its own, then six values of each surfel."""
