"""Colors of labels: the same in every cloud, told apart, customary for LAS classes, grey without a label."""

from __future__ import annotations

import numpy as np
import pytest

from z2p_core.coloring.asprs_classes import ASPRS_COLORS
from z2p_core.coloring.class_palettes import UNLABELLED_COLOR, class_colors, label_color, label_palette
from z2p_core.coloring.scales import ClassEntry
from z2p_core.formats.las_classes import LAS_CLASS_NAMES
from z2p_core.images import linear_from_srgb


def test_a_label_has_one_color_in_every_cloud() -> None:
    alone = class_colors("label", np.array([7]))
    among = class_colors("label", np.arange(-1, 200))
    assert alone.entries[0].color == next(entry for entry in among.entries if entry.value == 7).color


def test_256_labels_have_256_colors() -> None:
    assert len({label_color(label) for label in range(256)}) == 256


def test_first_colors_are_far_apart() -> None:
    colors = np.array(label_palette()[:20])
    distances = np.linalg.norm(colors[:, None] - colors[None], axis=2)[np.triu_indices(20, 1)]
    assert distances.min() > 0.15


def test_palette_stands_out_on_white() -> None:
    luminance = linear_from_srgb(np.array(label_palette())) @ [0.2126, 0.7152, 0.0722]
    assert luminance.max() < 0.62 and luminance.min() > 0.06


def test_las_classes_have_customary_colors_and_names() -> None:
    classes = class_colors("classification", np.array([2, 5, 2, 9, 6, 70], dtype=np.uint8))
    ground, tree, building, water, own = classes.entries
    assert ground == ClassEntry(2, "ground", ASPRS_COLORS[2], 2)
    assert (tree.name, building.name, water.name) == ("high vegetation", "building", "water")
    assert np.argmax(tree.color) == 1 and np.argmax(building.color) == 0 and np.argmax(water.color) == 2
    assert (own.name, own.color) == ("70", label_color(70))


@pytest.mark.parametrize("field", ["Classification", "scalar_Classification", "CLASSIFICATION"])
def test_other_spellings_of_classification_count(field: str) -> None:
    assert class_colors(field, np.array([2])).entries[0].name == "ground"


def test_las_colors_are_all_different() -> None:
    assert len(set(ASPRS_COLORS.values())) == len(ASPRS_COLORS)
    assert set(ASPRS_COLORS) == set(LAS_CLASS_NAMES) == set(range(23))


def test_names_of_the_file_come_first() -> None:
    classes = class_colors("classification", np.array([2, 3]), {2: "Boden"})
    assert [entry.name for entry in classes.entries] == ["Boden", "low vegetation"]


def test_given_colors_come_first() -> None:
    classes = class_colors("label", np.array([0, 1]), colors_given={1: (0.0, 0.0, 0.0)})
    assert [entry.color for entry in classes.entries] == [label_color(0), (0.0, 0.0, 0.0)]


def test_negative_labels_are_grey() -> None:
    classes = class_colors("label", np.array([-1, -5, 255]))
    assert [entry.name for entry in classes.entries] == ["-5", "unlabelled", "255"]
    assert [entry.color == UNLABELLED_COLOR for entry in classes.entries] == [True, True, False]


def test_points_of_each_label_are_counted() -> None:
    labels = np.random.default_rng(0).integers(-3, 40, 1000)
    classes = class_colors("label", labels)
    assert {entry.value: entry.count for entry in classes.entries} == dict(
        zip(*map(np.ndarray.tolist, np.unique(labels, return_counts=True)), strict=True))


def test_floats_that_are_no_labels_are_left_out() -> None:
    classes = class_colors("label", np.array([1.0, 1.5, np.nan, np.inf, 1e300, 2.0, 1.0]))
    assert [(entry.value, entry.count) for entry in classes.entries] == [(1, 2), (2, 1)]


def test_labels_far_apart_are_found() -> None:
    labels = np.array([0, 2**40, 2**64 - 1], dtype=np.uint64)
    assert [entry.value for entry in class_colors("id", labels).entries] == [0, 2**40, 2**64 - 1]
    assert np.isfinite(class_colors("id", labels).colors_of(labels)).all()


def test_no_labels_have_no_classes() -> None:
    assert class_colors("label", np.array([])).entries == ()
    assert class_colors("label", np.array([np.nan, 0.5])).entries == ()
