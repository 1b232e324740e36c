"""Views for training with textures: the same scenes as without, and textures that shards keep."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from z2p_core.config import RenderConfig, ShardConfig
from z2p_core.scene import SceneDescription
from z2p_renderer.pipeline.rendering import textured_views
from z2p_renderer.pipeline.rendering.textured_views import render_textured_chunk
from z2p_renderer.pipeline.rendering.views import load_controls, sample_view, view_rng
from z2p_renderer.pipeline.training.make_shard import make_shard
from z2p_renderer.storage.shards import Shard

CONFIG = RenderConfig(resolution=16, samples=1, bounces=1, textures=("stripes", "spots"), textured_share=0.5)
IDENTITY = "0123456789abcdef"


@pytest.fixture
def mesh(tmp_path: Path) -> Path:
    path = tmp_path / "tetra.off"
    path.write_text("OFF\n4 4 0\n1 1 1\n1 -1 -1\n-1 1 -1\n-1 -1 1\n3 0 1 2\n3 0 3 1\n3 0 2 3\n3 1 3 2\n")
    return path


def views(folder: Path) -> list[dict]:
    return [json.loads(path.read_text()) for path in sorted(folder.glob("view_*.json"))]


def test_scenes_are_those_without_textures_and_about_half_have_one(mesh, tmp_path, monkeypatch):
    monkeypatch.setattr(textured_views, "render_textured_mesh", lambda *_: None)
    monkeypatch.setattr(textured_views, "render_mesh", lambda *_: None)
    render_textured_chunk(mesh, IDENTITY, 0, 40, CONFIG, tmp_path / "out", log=lambda line: None)
    drawn, controls = views(tmp_path / "out"), load_controls(CONFIG.controls)
    for index, view in enumerate(drawn):
        expected = sample_view(controls, view_rng(CONFIG.seed, IDENTITY, index), CONFIG.upright)
        assert SceneDescription.from_json(view["scene"]) == expected.scene
    textures = [view["texture"] for view in drawn if view["texture"]]
    assert 10 < len(textures) < 30 and {texture["name"] for texture in textures} == {"stripes", "spots"}
    assert len({tuple(texture["seed"]) for texture in textures}) == len(textures)


@pytest.mark.slow
def test_a_shard_keeps_the_textures_of_real_renders(mesh, tmp_path):
    for index in range(100):  # the first two views of which one alone has a texture
        config = replace(CONFIG, seed=index)
        first, second = (textured_views.draw_texture(config, drawn) for drawn in map(rng_after_view(config), range(2)))
        if bool(first) != bool(second):
            break
    render_textured_chunk(mesh, IDENTITY, 0, 2, config, tmp_path / "out", log=lambda line: None)
    np.save(tmp_path / "pool.npy", np.zeros((10, 3), np.float32))
    controls = load_controls(config.controls)
    shard = Shard(make_shard([tmp_path / "out"], tmp_path / "pool.npy", ShardConfig(16), controls, tmp_path))
    assert [shard.read(row).texture for row in range(2)] == [view["texture"] for view in views(tmp_path / "out")]
    assert shard.attributes["textured"] and shard.read(0).coverage.max() > 200


def rng_after_view(config: RenderConfig):
    def rng(index: int) -> np.random.Generator:
        generator = view_rng(config.seed, IDENTITY, index)
        sample_view(load_controls(config.controls), generator, config.upright)
        return generator

    return rng
