"""Two meshes to train on and one kept aside, and a config that uses them; the files hold no real mesh."""

from dataclasses import replace

import pytest

from z2p_core.config import parse_config


@pytest.fixture
def meshes(tmp_path):
    for folder in ("meshes", "kept"):
        (tmp_path / folder).mkdir()
    (tmp_path / "meshes" / "ape.ply").write_text("ape")
    (tmp_path / "meshes" / "bee.obj").write_text("bee")
    (tmp_path / "meshes" / "notes.txt").write_text("no mesh")
    (tmp_path / "kept" / "cow.ply").write_text("cow")
    return tmp_path


@pytest.fixture
def config(meshes):
    base = parse_config("[render]\nviews = 12\nchunk = 10\n")
    return replace(base, meshes=str(meshes / "meshes"), evaluate_meshes=str(meshes / "kept"))
