"""Fields of a scan are found by name, and the points of some classes are kept."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from z2p_core.coloring.options import ColorOptions
from z2p_core.interfaces import RawCloud, ScanError
from z2p_renderer.pipeline.coloring.fields import find_scalars, keep_classes
from z2p_renderer.storage.scans.clouds import Scan, scan_from_raw

POINTS = np.random.default_rng(0).normal(size=(60, 3))


def scan(**fields: Any) -> Scan:
    return scan_from_raw(RawCloud(POINTS, fields={name: np.asarray(values) for name, values in fields.items()}), "")


@pytest.mark.parametrize("name", ["scalar_Intensity", "intensity", "INTENSITY", "scalar_intensity"])
def test_a_name_is_found_however_it_is_written(name: str) -> None:
    values = np.arange(60.0)
    assert np.array_equal(find_scalars(scan(scalar_Intensity=values), name).values, values)


def test_coordinates_are_fields() -> None:
    assert np.array_equal(find_scalars(scan(), "Z").values, POINTS[:, 2])


def test_an_unknown_field_names_those_that_exist() -> None:
    with pytest.raises(ScanError, match=r"rgb, error, x, y, z, height, none, got 'eror' \(did you mean error\?\)"):
        find_scalars(scan(rgb=np.zeros((60, 3)), error=np.zeros(60)), "eror")


@pytest.mark.parametrize(("name", "values", "expected"), [
    ("segment", np.arange(60), True), ("code", np.arange(60) % 7, True), ("code", np.arange(60), False),
    ("intensity", np.arange(60) % 7, False), ("label", np.arange(60) % 3 * 1.0, True),
    ("label", np.arange(60) / 7, False), ("value", np.arange(60) % 3 * 1.0, False), ("mask", np.arange(60) > 9, True),
])  # fmt: skip
def test_labels_are_told_from_measurements(name: str, values: np.ndarray, expected: bool) -> None:
    assert find_scalars(scan(**{name: values}), name).is_categorical == expected


def test_kept_classes_keep_their_points_and_fields() -> None:
    labels, times = np.arange(60) % 4, np.arange(60.0)
    kept = keep_classes(scan(label=labels, time=times), ColorOptions(classes=(1, 3)))
    assert len(kept.points) == 30 and "30 points of other classes left out (label)" in kept.note
    assert kept.fields is not None and np.array_equal(kept.fields.values["time"], times[labels % 2 == 1])
    assert np.array_equal(kept.fields.points, POINTS[labels % 2 == 1])


def test_classes_that_are_not_there_are_named() -> None:
    with pytest.raises(ScanError, match=r"classes 9 in the field 'label', got 0; its classes are 0, 1, 2, 3"):
        keep_classes(scan(label=np.arange(60) % 4), ColorOptions(classes=(9,)))
    with pytest.raises(ScanError, match=r"expected a field of classes .* got the fields time"):
        keep_classes(scan(time=np.arange(60.0)), ColorOptions(classes=(1,)))


def test_the_field_of_the_colors_chooses_the_classes() -> None:
    both = scan(label=np.arange(60) % 2, part=np.arange(60) % 3)
    assert len(keep_classes(both, ColorOptions("part", classes=(0,))).points) == 20
    assert len(keep_classes(both, ColorOptions(classes=(0,))).points) == 30
