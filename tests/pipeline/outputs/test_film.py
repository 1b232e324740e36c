"""A film of a series has one frame of reference, and goes from cloud to cloud without a jump."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from PIL import Image

from z2p_core.interfaces import ScanError
from z2p_renderer.pipeline.inference.look import Look
from z2p_renderer.pipeline.inference.render_scan import render_scan
from z2p_renderer.pipeline.inference.renderer import Renderer
from z2p_renderer.pipeline.outputs.film import Film, FilmPlan, plan_film
from z2p_renderer.pipeline.outputs.series import (
    between,
    have_matching_points,
    natural_order,
    series_of_files,
    series_of_scans,
)
from z2p_renderer.pipeline.placement.options import PlacementOptions
from z2p_renderer.storage.images.image_files import read_record
from z2p_renderer.storage.scans.clouds import PointFields, usable

LOOK = Look(width=48, height=48, placement_options=PlacementOptions("+Z", "front"))


@pytest.fixture(scope="module")
def renderer(tiny_weights: Path) -> Renderer:
    return Renderer(tiny_weights)


def film(renderer: Renderer, clouds: list[np.ndarray], plan: FilmPlan, look: Look = LOOK) -> Film:
    return plan_film(series_of_scans([usable(cloud) for cloud in clouds]), renderer, look, plan)


def difference(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.abs(one.astype(float) - other).mean())


def test_a_film_has_the_frames_of_its_plan() -> None:
    assert FilmPlan(2, 1).moments(2) == [(0, 0.0), (0, 0.0), (0, 0.5), (1, 0.0), (1, 0.0)]
    assert FilmPlan(1, 1, closes=True).moments(2) == [(0, 0.0), (0, 0.5), (1, 0.0), (1, 0.5)]
    assert FilmPlan(3, 5, closes=True).moments(1) == [(0, 0.0)] * 3


def test_all_clouds_keep_their_size_and_place(renderer: Renderer, cloud: np.ndarray) -> None:
    drawn = film(renderer, [cloud, cloud * 0.5 + 2], FilmPlan())
    first, second = drawn.frames()
    for points, frame in ((cloud, first), (cloud * 0.5 + 2, second)):
        options = replace(LOOK.placement_options, viewpoint=drawn.viewpoint, smooth=0.0)
        still = render_scan(renderer, usable(points), "", replace(drawn.look, placement_options=options)).picture
        assert difference(frame, still) < 0.5
    assert difference(first, second) > 1


def test_moving_points_change_the_picture_little_by_little(renderer: Renderer, cloud: np.ndarray) -> None:
    frames = list(film(renderer, [cloud, np.add(cloud, [0.8, 0, 0])], FilmPlan(blend=3)).frames())
    steps = [difference(one, other) for one, other in pairwise(frames)]
    assert len(frames) == 5 and max(steps) < 0.8 * difference(frames[0], frames[-1])


def test_other_clouds_fade(renderer: Renderer, cloud: np.ndarray) -> None:
    first, middle, last = film(renderer, [cloud, cloud[:300] * (1, 1, 0.5)], FilmPlan(blend=1)).frames()
    mean = (first[..., 3].astype(float) + last[..., 3]) / 2
    assert np.abs(middle[..., 3] - mean).max() <= 1


def test_points_that_cannot_move_are_refused_on_wish(renderer: Renderer, cloud: np.ndarray) -> None:
    drawn = film(renderer, [cloud, cloud[:300]], FilmPlan(blend=1, blend_by="points"))
    with pytest.raises(ScanError, match="400 and 300 points"):
        list(drawn.frames())


def test_the_camera_turns_while_the_series_plays(renderer: Renderer, cloud: np.ndarray) -> None:
    turning = list(film(renderer, [cloud] * 4, FilmPlan(turns=1.0)).frames())
    still = list(film(renderer, [cloud] * 4, FilmPlan()).frames())
    assert all(np.array_equal(frame, still[0]) for frame in [*still, turning[0]])
    assert all(difference(turning[0], frame) > 0.5 for frame in turning[1:])


def test_the_reference_chooses_the_frame(renderer: Renderer, cloud: np.ndarray) -> None:
    plan = FilmPlan(reference=-1, frames_reference=True)
    drawn = film(renderer, [cloud * 1.5, cloud], plan)
    alone = film(renderer, [cloud], FilmPlan())
    assert drawn.viewpoint.radius == pytest.approx(alone.viewpoint.radius)
    assert film(renderer, [cloud * 1.5, cloud], FilmPlan()).viewpoint.radius > 1.2 * drawn.viewpoint.radius


def test_a_trimmed_film_has_frames_of_one_size(renderer: Renderer, cloud: np.ndarray) -> None:
    frames = list(film(renderer, [cloud, cloud * 0.5 + 2], FilmPlan(), replace(LOOK, tight=True)).frames())
    assert frames[0].shape == frames[1].shape


def test_matching_points_are_told_from_shuffled_ones(cloud: np.ndarray) -> None:
    rng = np.random.default_rng(0)
    angle = np.deg2rad(70)
    turned = cloud @ np.array([[np.cos(angle), np.sin(angle), 0], [-np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    moved = [cloud + 9, turned, cloud + 0.2 * rng.normal(size=cloud.shape)]
    assert all(have_matching_points(usable(cloud), usable(points)) for points in moved)
    others = [rng.permutation(cloud), cloud[:-1], rng.normal(size=cloud.shape)]
    assert not any(have_matching_points(usable(cloud), usable(points)) for points in others)


def test_colors_and_scalars_move_with_their_points_and_labels_do_not(cloud: np.ndarray) -> None:
    def painted(value: float, label: int) -> PointFields:
        rgb, heat = np.full((400, 3), value, np.float32), np.full(400, value)
        return PointFields(cloud, {"rgb": rgb, "heat": heat, "label": np.full(400, label)})

    first, second = (replace(usable(cloud), fields=painted(*given)) for given in ((0.0, 1), (1.0, 2)))
    middle = between(first, second, 0.25)
    assert middle.fields is not None
    assert middle.fields.values["heat"][0] == middle.fields.values["rgb"][0, 0] == 0.25
    assert middle.fields.values["label"][0] == 1


def test_files_are_sorted_by_the_numbers_in_their_names() -> None:
    names = ["a/step_10.npy", "a/step_9.npy", "a/step_1b.npy", "a/step.npy"]
    assert [path.name for path in natural_order(map(Path, names))] == [
        "step.npy", "step_1b.npy", "step_9.npy", "step_10.npy"
    ]  # fmt: skip


def test_a_damaged_file_is_left_out_of_a_series(tmp_path: Path, cloud: np.ndarray) -> None:
    np.save(tmp_path / "1.npy", np.stack([cloud, cloud + 1]))
    (tmp_path / "2.npy").write_bytes(b"no array")
    lines: list[str] = []
    series = series_of_files([tmp_path / "1.npy", tmp_path / "2.npy"], None, LOOK.color_options, lines.append)
    assert len(series) == 2 and len(lines) == 1 and "2.npy" in lines[0]
    with pytest.raises(ScanError, match=r"2\.npy"):
        len(series_of_files([tmp_path / "2.npy"], None, LOOK.color_options))


def test_the_command_writes_a_film_with_its_record(
    tmp_path: Path, z2p: Callable[..., Result], tiny_weights: Path, cloud: np.ndarray
) -> None:
    for number in (2, 10):
        np.save(tmp_path / f"step_{number}.npy", cloud * (1, 1, number / 10))
    words = ("film", tmp_path / "*.npy", "--weights", tiny_weights, "--resolution", 40, "--blend", 1, "--up", "+Z")
    for suffix, kept in ((".webp", True), (".apng", True), (".mp4", False)):
        output = tmp_path / f"film{suffix}"
        done = z2p(*words, "--output", output)
        assert done.exit_code == 0 and "one frame for 2 clouds" in done.output and "3 frames" in done.output
        if kept:
            assert Image.open(output).n_frames == 3
            record = read_record(output)
            assert record["batch"] == 2 and record["motion"]["blend"] == 1 and record["input"]["name"] == "step_2.npy"
    refused = z2p(*words, "--output", tmp_path / "film.webp")
    assert refused.exit_code == 2 and "--overwrite" in refused.output
