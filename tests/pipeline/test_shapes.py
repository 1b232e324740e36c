"""Built-in shapes: meshes that every stage can use, the same bytes every time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from z2p_core.meshes.triangle_sampling import triangle_areas
from z2p_renderer.pipeline.shapes import SUZANNE, TRAINING_SHAPES, VALIDATION_SHAPES, make_shapes, shape, shape_path
from z2p_renderer.storage.scans.clouds import read_mesh

PARAMETRIC = sorted({*TRAINING_SHAPES, *VALIDATION_SHAPES} - {SUZANNE})
OPEN = {"wavy_sheet", "seashell"}


def edge_counts(faces: np.ndarray) -> np.ndarray:
    """How many triangles share each edge."""
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    return np.unique(edges, axis=0, return_counts=True)[1]


def test_two_shapes_are_held_out() -> None:
    assert len(VALIDATION_SHAPES) == 2 and not set(VALIDATION_SHAPES) & set(TRAINING_SHAPES)
    assert len(PARAMETRIC) == 8


@pytest.mark.parametrize("name", PARAMETRIC)
def test_shape_is_a_sound_mesh_of_a_few_thousand_triangles(name: str) -> None:
    vertices, faces = shape(name)
    assert 1000 <= len(faces) <= 8000
    assert np.isfinite(vertices).all() and set(np.unique(faces)) == set(range(len(vertices)))
    assert triangle_areas(vertices, faces).min() > 0
    assert len(np.unique(vertices, axis=0)) == len(vertices)  # seams are welded
    shared = edge_counts(faces)
    assert shared.max() == 2
    assert ((shared == 1).sum() > 0) == (name in OPEN)


def test_files_are_the_same_bytes_and_read_back(tmp_path: Path) -> None:
    first, second = make_shapes(tmp_path / "a", suzanne=False), make_shapes(tmp_path / "b", suzanne=False)
    assert sorted(path.stem for path in first) == PARAMETRIC
    for ours, theirs in zip(first, second, strict=True):
        assert ours == shape_path(tmp_path / "a", ours.stem)
        assert ours.read_bytes() == theirs.read_bytes()
        assert np.array_equal(read_mesh(ours).vertices, shape(ours.stem)[0])


def test_an_unknown_shape_names_the_known() -> None:
    with pytest.raises(ValueError, match=r"unknown shape 'teapot'; parametric shapes: .*gear"):
        shape("teapot")


@pytest.mark.slow
def test_suzanne_comes_from_blender(tmp_path: Path) -> None:
    make_shapes(tmp_path)
    assert {path.stem for path in tmp_path.iterdir()} == {*TRAINING_SHAPES, *VALIDATION_SHAPES}
    monkey = read_mesh(shape_path(tmp_path, SUZANNE))
    assert 1000 <= len(monkey.faces) <= 8000
    assert np.ptp(monkey.vertices[:, 0]) > np.ptp(monkey.vertices[:, 1])  # ears to the sides
