"""Rows of the mutation matrix on luigid with two worker processes: exactly the steps run that depend on a change.

What is stale does not depend on who schedules: here are rows in which the processes have to share the steps.
"""

from __future__ import annotations

import pytest
from mutations import ALL, change_and_go_back, lose_and_mend
from world import World, luigid

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    """A world whose pipeline has run; each test leaves it as it was."""
    world = World(tmp_path_factory.mktemp("world"))
    world.processes = 2
    with luigid(world):
        assert world.make() == sorted(ALL)
        yield world


@pytest.mark.parametrize("name", ["points in a pool", "chunks", "more views", "adding a mesh", "evaluation clouds"])
def test_a_changed_input_runs_only_what_depends_on_it(world, tmp_path, name):
    change_and_go_back(world, name, tmp_path)


@pytest.mark.parametrize("name", ["deleting render/tetra/0-2", "a flipped bit in a shard", "touching every output"])
def test_a_damaged_output_is_remade_with_the_same_bytes(world, name):
    lose_and_mend(world, name)
