"""What to leave out of the frame: strays, whatever their distance, and no part of the thing itself."""

from __future__ import annotations

import numpy as np
import pytest
from made_clouds import box, chair, lamppost, moved, sphere

from z2p_core.placement.bounding_sphere import bounding_sphere
from z2p_core.placement.outliers import above_low_outliers_mask, inlier_mask, visible_cluster_mask

CLEAN = {
    "sphere": sphere(5000), "sparse sphere": sphere(500), "few": sphere(40), "chair": chair(1500),
    "lamppost": lamppost(1500), "sparse lamppost": lamppost(400), "plate": box(3000, 1, 1, 0.001),
    "two balls": np.vstack([sphere(2000), sphere(2000) + 5.0]), "far away": moved(sphere(3000), 5e5, 5e6, 100),
}  # fmt: skip


@pytest.mark.parametrize("name", CLEAN)
def test_a_clean_object_loses_no_point(name: str) -> None:
    assert inlier_mask(CLEAN[name]).all()


@pytest.mark.parametrize("distance", [4.0, 1e3, 1e9])
def test_strays_are_left_out_whatever_their_distance(distance: float) -> None:
    thing = chair(2000)
    strays = np.vstack([thing, [[distance, 0, 0], [0, -distance / 2, 0]], moved(sphere(20) * 0.1, 0, 0, distance)])
    kept = inlier_mask(strays)
    assert kept[: len(thing)].all()
    assert not kept[len(thing) :].any()
    assert np.array_equal(inlier_mask(strays[::-1]), kept[::-1])


def test_at_most_two_percent_are_removed_and_only_if_harmful() -> None:
    thing = sphere(1000)
    many = np.vstack([thing, *(sphere(9, seed) * 0.01 + direction * 5 for seed, direction in enumerate(sphere(5, 9)))])
    assert (~inlier_mask(many)).sum() <= 0.02 * len(many)
    assert inlier_mask(np.vstack([thing, [[0, 0, 0]]])).all()  # inside: nothing would be won
    assert inlier_mask(np.vstack([thing, [[1.05, 0, 0]]])).all()


def test_a_large_detached_part_is_part_of_the_object() -> None:
    assert inlier_mask(np.vstack([sphere(1000), sphere(60) * 0.2 + 4.0])).all()


def test_a_part_that_was_scanned_coarsely_is_part_of_the_object() -> None:
    """A bust scanned closely on a plinth that is not: the plinth's points stand apart in the bust's small cells."""
    close, coarse = moved(sphere(40_000), 0, 0, 1.0), box(400, 0.3, 0.3, 1.2)
    thing = np.vstack([close, moved(coarse[coarse[:, 2] < 1.1], 0, 0, -1.2)])
    assert inlier_mask(thing).all()
    kept = inlier_mask(np.vstack([thing, moved(sphere(30) * 0.05, 0, 0, -8.0)]))
    assert kept[: len(thing)].all() and not kept[len(thing) :].any()


def test_the_clipped_sphere_is_that_of_the_object() -> None:
    thing = chair(2000)
    points = np.vstack([thing, [[30.0, 0, 0]]])
    assert bounding_sphere(points[inlier_mask(points)]) == bounding_sphere(thing)


@pytest.mark.parametrize("depth", [0.6, 3.0])
def test_a_few_points_below_do_not_lift_a_thing_off_its_floor(depth: float) -> None:
    thing = box(5000, 2, 2, 0.4)
    below = moved(sphere(3) * 0.05, 0.5, 0, thing[:, 2].min() - depth)
    for axis in (2, 0):
        points = np.roll(np.vstack([thing, below]), axis - 2, axis=1)
        kept = above_low_outliers_mask(points, points[:, axis])
        assert kept[: len(thing)].all() and not kept[len(thing) :].any()


@pytest.mark.parametrize("name", CLEAN)
def test_a_clean_object_stands_as_it_is(name: str) -> None:
    for height in CLEAN[name].T:
        assert above_low_outliers_mask(CLEAN[name], height).all()
        assert above_low_outliers_mask(CLEAN[name], -height).all()


def test_a_thin_foot_and_many_points_below_are_no_strays() -> None:
    foot = np.column_stack([np.zeros((5, 2)), np.linspace(-1.5, -1.05, 5)])
    top = np.vstack([sphere(6000), foot])
    assert above_low_outliers_mask(top, top[:, 2]).all()
    many = np.vstack([sphere(6000), moved(sphere(20) * 0.05, 0, 0, -3)])
    assert above_low_outliers_mask(many, many[:, 2]).all()


@pytest.mark.parametrize("share", [0.02, 0.2, 0.5, 0.97])
@pytest.mark.parametrize("sizes", [20, 200, 1e6])
def test_of_clusters_that_would_be_specks_the_largest_is_kept(share: float, sizes: float) -> None:
    thing, other = chair(1500), sphere(int(share * len(chair(1500))))
    points = np.vstack([thing, moved(other, 2 * sizes, -sizes, 0)])
    kept = visible_cluster_mask(points)
    assert kept[: len(thing)].all() and not kept[len(thing) :].any()
    order = np.random.default_rng(1).permutation(len(points))
    assert np.array_equal(visible_cluster_mask(points[order]), kept[order])


@pytest.mark.parametrize("sizes", [2, 5, 8])
def test_clusters_that_both_show_are_kept(sizes: float) -> None:
    for count in (60, 600, 3000):
        assert visible_cluster_mask(np.vstack([sphere(3000), moved(sphere(count), 2 * sizes, 0, 0)])).all()


def test_the_largest_cluster_is_kept_amid_outliers() -> None:
    thing = sphere(3000)
    three = np.vstack([thing, moved(sphere(1000), 900, 0, 0), moved(sphere(2000), 0, 1e6, 5)])
    strewn = np.vstack([thing, np.random.default_rng(2).uniform(-1e4, 1e4, (200, 3))])
    near = np.vstack([thing, moved(sphere(500), 4, 0, 0), moved(sphere(2000), 0, 1e6, 5)])
    for points, count in ((three, 3000), (strewn, 3000), (near, 3500)):
        kept = visible_cluster_mask(points)
        assert kept[:count].all() and not kept[count:].any()


@pytest.mark.parametrize("name", CLEAN)
def test_a_clean_object_has_nothing_far_away(name: str) -> None:
    assert visible_cluster_mask(CLEAN[name]).all()


def test_a_row_of_small_things_is_no_speck() -> None:
    row = [moved(sphere(200) * 0.3, x, y, 0) for x in range(0, 40, 2) for y in range(0, 10, 2)]
    assert visible_cluster_mask(np.vstack(row)).all()
    assert inlier_mask(np.vstack(row)).all()


@pytest.mark.parametrize("count", [64, 70, 99, 100])
def test_of_a_few_dozen_points_far_apart_the_larger_part_is_kept(count: int) -> None:
    points = np.vstack([sphere(count - 30), moved(sphere(30), 1000.0, 0, 0)])
    assert np.array_equal(np.flatnonzero(visible_cluster_mask(points)), np.arange(count - 30))
