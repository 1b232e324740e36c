"""Data augmentation: even clouds, holes, and mirrored records."""

from dataclasses import replace

import numpy as np
import pytest
from sphere_shards import sphere_record

from z2p_core import native
from z2p_core.config import TrainConfig
from z2p_renderer.pipeline.training.augment import (
    HOLE_POINTS,
    MAX_HOLES,
    draw_training_cloud,
    mirror_record,
    remove_patches,
    sample_evenly,
)
from z2p_renderer.plugins.controls.light import Light


def sphere(count, seed=0):
    points = np.random.default_rng(seed).normal(size=(count, 3))
    return (points / np.linalg.norm(points, axis=1, keepdims=True)).astype(np.float32)


def gaps(cloud):
    """Distances to the nearest neighbour, relative to their mean."""
    grid = native.NeighborGrid(cloud)
    neighbors, _ = grid.neighbors(np.arange(len(cloud), dtype=np.int32), 2)
    near = np.linalg.norm(grid.points[neighbors[:, 1]] - grid.points, axis=1)
    return near / near.mean()


@pytest.mark.parametrize("count", [50, 1000, 5000])
def test_even_clouds_have_even_gaps_and_about_as_many_points(count):
    pool = sphere(50_000)
    even, random = sample_evenly(pool, count, np.random.default_rng(1)), pool[:count]
    assert abs(len(even) / count - 1) < 0.15
    assert gaps(even).std() < 0.7 * gaps(random).std()
    assert {tuple(point) for point in even} <= {tuple(point) for point in pool}


def test_even_sampling_works_for_tiny_clouds():
    assert len(sample_evenly(sphere(3), 3, np.random.default_rng(0))) >= 1
    assert len(sample_evenly(sphere(20), 20, np.random.default_rng(0))) >= 5


def test_share_of_even_clouds_matches_the_config():
    pool, config = sphere(20_000), TrainConfig(points=(2000, 2000), even=0.3)
    spread = [gaps(draw_training_cloud(pool, config, np.random.default_rng(seed))).std() for seed in range(60)]
    assert 8 <= sum(spread < np.median(gaps(pool[:2000]).std()) * 0.8) <= 30


def test_holes_remove_patches_and_nothing_else():
    cloud = sphere(2000)
    for seed in range(8):
        kept = remove_patches(cloud, np.random.default_rng(seed))
        lost = np.array(sorted({tuple(point) for point in cloud} - {tuple(point) for point in kept}))
        assert HOLE_POINTS[0] <= len(lost) == 2000 - len(kept) <= MAX_HOLES * HOLE_POINTS[1]
        # what goes has neighbours that go: at random, few of so few points would be the nearest of another
        near = np.linalg.norm(lost[:, None] - lost[None], axis=2) + 9 * np.eye(len(lost))
        assert (near.min(axis=1) < 4 * np.sqrt(4 * np.pi / 2000)).mean() > 0.9
    assert len(remove_patches(sphere(3), np.random.default_rng(0))) >= 1
    config = TrainConfig(points=(2000, 2000), holes=0.4)
    counts = [len(draw_training_cloud(sphere(5000), config, np.random.default_rng(seed))) for seed in range(40)]
    assert 6 <= sum(count < 2000 for count in counts) <= 28


def test_mirroring_flips_image_light_and_settings():
    record = sphere_record(16, np.random.default_rng(3))
    other = mirror_record(record)
    np.testing.assert_array_equal(other.rgba, record.rgba[:, ::-1])
    np.testing.assert_array_equal(other.coverage, record.coverage[:, ::-1])
    radius, azimuth, elevation = record.scene.light
    assert other.scene == replace(record.scene, light=(radius, -azimuth, elevation))
    np.testing.assert_allclose(other.settings[3:6], Light().encode(other.scene.light), atol=1e-6)
    np.testing.assert_array_equal(other.settings[[0, 1, 2, 6]], record.settings[[0, 1, 2, 6]])
    again = mirror_record(other)
    np.testing.assert_array_equal(again.rgba, record.rgba)
    np.testing.assert_allclose(again.settings, record.settings, atol=1e-6)
    assert again.scene == record.scene
