"""The mutation matrix on luigid with two worker processes: after each change exactly the steps run that depend on it.

For each: the dry run predicts it and writes nothing, a second run runs nothing, and going back runs nothing. What is
stale does not depend on who schedules, so of changes that make the same steps run there is one here.
"""

from __future__ import annotations

import pytest
from mutations import ALL, INPUTS, OUTPUTS, change_and_go_back, lose_and_mend, one_of_each
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


@pytest.mark.parametrize("name", one_of_each(INPUTS))
def test_a_changed_input_runs_only_what_depends_on_it(world, tmp_path, name):
    change_and_go_back(world, name, tmp_path)


@pytest.mark.parametrize("name", one_of_each(OUTPUTS))
def test_a_damaged_output_is_remade_with_the_same_bytes(world, name):
    lose_and_mend(world, name)
