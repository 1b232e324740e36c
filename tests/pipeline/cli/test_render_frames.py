"""One frame for clouds of very different sizes, or of which one cannot be read."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result

from z2p_renderer.storage.images.image_files import read_record


def test_clouds_too_small_in_the_common_frame_are_named(
    render: Callable[..., Result], tmp_path: Path, cloud: np.ndarray
) -> None:
    folder = tmp_path / "series"
    folder.mkdir()
    np.save(folder / "metres.npy", cloud)
    np.save(folder / "frames.npy", np.stack([cloud * 1000, cloud * 0.9]))  # millimetres
    result = render(folder, "--same-frame")
    assert result.exit_code == 0, result.output
    notes = [line for line in result.stderr.splitlines() if line.startswith("note: ")]
    assert [line.split(" spans ")[0] for line in notes] == [f"note: {folder / name}" for name in
                                                            ("frames.npy[1]", "metres.npy")]  # fmt: skip
    for number in range(9):
        np.save(folder / f"more{number}.npy", cloud)
    assert "note: so do 6 more clouds" in render(folder, "--same-frame").stderr
    np.save(folder / "frames.npy", np.stack([cloud / 10, cloud]))  # small, but seen
    assert "note: " not in render(folder, "--same-frame").stderr


def test_a_series_survives_a_file_that_cannot_be_read(
    render: Callable[..., Result], scans: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from z2p_renderer.storage.scans import unpack

    (scans / "three.npy.gz").write_bytes(gzip.compress((scans / "one.npy").read_bytes()))

    def full(path: Path, inner: Path, largest: int | None) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(unpack, "_unpack", full)
    result = render(scans, "--same-frame")
    assert result.exit_code == 1 and "three.npy.gz: No space left" in result.stderr
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["one.png", "two.png"]
    alone = render(scans / "three.npy.gz", "--same-frame")
    assert alone.exit_code == 75 and "no space left" in alone.stderr


def test_the_first_cloud_sets_up_view_and_weights_of_a_series(
    render: Callable[..., Result], tmp_path: Path
) -> None:
    rng = np.random.default_rng(0)
    ball = rng.normal(size=(4000, 3))
    ball *= 0.3 / np.linalg.norm(ball, axis=1, keepdims=True)
    np.save(tmp_path / "a.npy", ball)
    np.save(tmp_path / "b.npy", ball * 0.9 + rng.normal(0, 0.02, ball.shape))  # noisy
    for first, other in ("ab", "ba"):
        words = [tmp_path / f"{name}.npy" for name in (first, other)]
        alone = render(words[0], weights="auto", output=tmp_path / "alone")
        series = render(*words, "--same-frame", weights="auto", output=tmp_path / first)
        assert alone.exit_code == series.exit_code == 0, series.output
        records = [read_record(tmp_path / first / f"{name}.png") for name in "ab"]
        own = read_record(tmp_path / "alone" / f"{first}.png")
        for record in records:
            assert record["camera"]["rotation"] == own["camera"]["rotation"]
            assert record["weights"] == own["weights"]
        text = series.stderr.splitlines()[0]
        assert f"up {own['stance']['up']}: {own['stance']['up_reason']}" in text
        assert ("weights denoise" in text) == (own["weights"]["name"] == "denoise") == (first == "b")
