"""A mesh that is not manifold is used, with a warning."""

import numpy as np
import pytest
from world import PYRAMID, TETRA, World, write_off

from z2p_renderer.workflows.mesh_warnings import count_non_manifold_edges, mesh_warnings

FIN = ([*TETRA[0], (3, 0, 0)], [*TETRA[1], (0, 1, 4)])
"""A tetrahedron with a triangle that sticks out of one of its edges."""


def test_edges_of_more_than_two_faces_are_counted(tmp_path):
    assert count_non_manifold_edges(np.array(TETRA[1])) == count_non_manifold_edges(np.array(PYRAMID[1])) == 0
    assert count_non_manifold_edges(np.array(FIN[1])) == 1
    write_off(tmp_path / "fin.off", *FIN)
    write_off(tmp_path / "tetra.off", *TETRA)
    assert mesh_warnings(tmp_path / "tetra.off") == []
    assert "fin.off: not manifold, 1 edges" in mesh_warnings(tmp_path / "fin.off")[0]


@pytest.mark.slow
def test_a_pipeline_warns_and_goes_on(tmp_path):
    world = World(tmp_path, code=False)
    write_off(tmp_path / "meshes" / "tetra.off", *FIN)
    status, said = world.run()
    assert status == 0 and "warning: tetra.off: not manifold" in said and "pyramid.off: not" not in said
