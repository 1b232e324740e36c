"""Contract tests for plugins: each `check_*` raises AssertionError, which says what is wrong, or returns None.

The built-in plugins pass them; run them on yours from any test runner:

    from z2p_core.testing import check_control

    def test_contract():
        check_control(MyControl)

==================================================  ===================================================================
check                                               what it verifies, beside shapes, dtypes and finite numbers
==================================================  ===================================================================
``check_control(MyControl)``                        parses its default, refuses values outside its range, encodes to
                                                    `size` numbers, applies to a scene that survives JSON
``check_zbuffer(MyZBuffer)``                        the nearest point wins, in any order of points; 0 elsewhere
``check_gbuffer(MyGBuffer)``                        the order of points does not matter; few or no points are drawn
``check_condition(MyCondition)``                    its picture tells colors apart; 0 where the cloud is not
``check_encoder(MyEncoder)``                        its saved state rebuilds it; a crop gets the frame's features
``check_engine(MyEngine, network, cell)``           what torch computes, at any size, from several threads
``check_sampler(MySampler)``                        exactly as many points as asked for, all over the surface
``check_texture(MyTexture)``                          colors in [0, 1] that depend on a place and the rng alone
``check_reader(MyReader, example, broken)``         reads an example file, refuses a broken one with ScanError
``check_baseline(MyBaseline)``                      a mesh where the cloud is; an empty cloud is a ScanError
``check_painter(MyPainter)``                        the object where the cloud is; an empty cloud is a ScanError
==================================================  ===================================================================

All of them also check that equal inputs give equal results, and that inputs are not changed.
"""

from __future__ import annotations

from z2p_core.contracts.baselines import check_baseline, check_painter
from z2p_core.contracts.buffers import check_gbuffer, check_zbuffer
from z2p_core.contracts.conditions import check_condition
from z2p_core.contracts.controls import check_control
from z2p_core.contracts.encoders import check_encoder
from z2p_core.contracts.engines import check_engine
from z2p_core.contracts.readers import check_reader
from z2p_core.contracts.samplers import check_sampler
from z2p_core.contracts.textures import check_texture

__all__ = [
    "check_baseline", "check_condition", "check_control", "check_encoder", "check_engine", "check_gbuffer",
    "check_painter", "check_reader", "check_sampler", "check_texture", "check_zbuffer",
]  # fmt: skip
