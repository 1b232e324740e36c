"""HDF5 files of the usual data sets give their clouds; links out of the file are never followed."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from z2p_core.interfaces import RawCloud, ScanError
from z2p_renderer.plugins.readers.h5 import H5

RNG = np.random.default_rng(2)
BATCH = RNG.normal(size=(5, 40, 3)).astype("f4")


def given(path: Path, **arrays: Any) -> list[RawCloud]:
    with h5py.File(path, "w") as file:
        for name, array in arrays.items():
            file.create_dataset(name.replace("__", "/"), data=array, compression="gzip" if np.ndim(array) > 1 else None)
    return [cloud if isinstance(cloud, RawCloud) else RawCloud(cloud) for cloud in H5().read(path)]


def refusal(path: Path, **arrays: Any) -> str:
    with pytest.raises(ScanError) as caught:
        given(path, **arrays)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("suffix", [".h5", ".hdf5"])
@pytest.mark.parametrize("key", ["data", "complete_pcds", "incomplete_pcds", "pcds", "gt"])
def test_data_sets_give_one_y_up_cloud_per_object(tmp_path: Path, key: str, suffix: str) -> None:
    raw_clouds = given(tmp_path / f"a{suffix}", **{key: BATCH, "label": np.arange(5), "mask": np.zeros((5, 40))})
    assert np.array_equal([cloud.points for cloud in raw_clouds], BATCH)
    assert {(cloud.up, cloud.up_certain) for cloud in raw_clouds} == {("+Y", False)}


@pytest.mark.parametrize("key", ["points", "pcd", "xyz", "pos", "Points", "scene__scan__points"])
def test_one_cloud_under_a_usual_name(tmp_path: Path, key: str) -> None:
    (cloud,) = given(tmp_path / "a.h5", **{key: BATCH[0], "colors": BATCH[1], "label": np.arange(40)})
    assert np.array_equal(cloud.points, BATCH[0]) and cloud.up == ""
    (cloud,) = given(tmp_path / "b.h5", **{key: np.hstack([BATCH[0], np.abs(BATCH[1])])})
    assert np.array_equal(cloud.points, BATCH[0])
    assert cloud.field_names == ("column 4", "column 5", "column 6")


def test_each_group_gives_clouds_and_a_note_on_ignored_data(tmp_path: Path) -> None:
    raw_clouds = given(tmp_path / "a.h5", one__points=BATCH[0], two__points=BATCH[1], two__labels=np.zeros(40))
    assert np.array_equal([cloud.points for cloud in raw_clouds], BATCH[:2])
    (first, *_) = given(tmp_path / "b.h5", incomplete_pcds=BATCH + 1, complete_pcds=BATCH, labels=np.zeros(5))
    assert np.array_equal(first.points, BATCH[0]) and first.note == "of complete_pcds, not of incomplete_pcds"


def test_separate_coordinates_and_records_are_read(tmp_path: Path) -> None:
    (cloud,) = given(tmp_path / "a.h5", X=BATCH[0, :, 0], Y=BATCH[0, :, 1], Z=BATCH[0, :, 2], i=np.zeros(40))
    assert np.array_equal(cloud.points, BATCH[0])
    records = np.zeros(40, [("i", "i4"), ("x", "f4"), ("y", "f4"), ("z", "f4")])
    records["x"], records["y"], records["z"] = BATCH[0].T
    assert np.array_equal(given(tmp_path / "b.h5", points=records)[0].points, BATCH[0])


def test_files_without_points_are_refused_by_content(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    assert "got image, label; save the points as points" in refusal(path, image=np.zeros((9, 9)), label=np.zeros(9))
    assert "got no data sets" in refusal(path)
    assert "depth map" in refusal(path, points=np.outer(np.arange(1, 50), np.arange(1, 60)) / 9)
    assert "got points" in refusal(path, points=np.bytes_("x y z"))
    assert "got points" in refusal(path, points=np.zeros((4, 3), "c8"))
    assert "of one shape" in refusal(path, x=np.zeros(4), y=np.zeros(4), z=np.zeros(5))
    path.write_bytes(b"no hdf5")
    with pytest.raises(ScanError, match="HDF5 file cannot be read"):
        H5().read(path)


def test_links_to_other_files_are_not_followed(tmp_path: Path) -> None:
    given(tmp_path / "other.h5", points=BATCH[0])
    path, layout = tmp_path / "a.h5", h5py.VirtualLayout((40, 3), "f4")
    layout[:] = h5py.VirtualSource(tmp_path / "other.h5", "points", (40, 3))
    with h5py.File(path, "w") as file:
        file["points"] = h5py.ExternalLink(str(tmp_path / "other.h5"), "/points")
    with pytest.raises(ScanError, match="got no data sets"):
        H5().read(path)
    with h5py.File(path, "w") as file:
        file.create_virtual_dataset("points", layout)
    with pytest.raises(ScanError, match="points lies in other files"):
        H5().read(path)
    with h5py.File(path, "w") as file:
        file["loop"] = h5py.SoftLink("/")
        file["group/up"] = file["/"]
        file["group/points"] = BATCH[0]
    assert np.array_equal(H5().read(path)[0].points, BATCH[0])  # type: ignore[union-attr]


def test_a_bomb_is_refused_before_it_unpacks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("z2p_renderer.plugins.readers._helpers.array_clouds._MIN_SUSPICIOUS_BYTES", 1 << 16)
    assert "would unpack to" in refusal(tmp_path / "a.h5", points=np.zeros((100_000, 3), "f4"))


def test_without_the_library_the_error_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    given(tmp_path / "a.h5", points=BATCH[0])
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(ScanError, match=r"needs an extra.*\[h5\]"):
        H5().read(tmp_path / "a.h5")


def test_damaged_files_raise_nothing_but_scan_errors(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    given(path, points=BATCH[0])
    blob, rng = np.frombuffer(path.read_bytes(), "u1"), np.random.default_rng(0)
    for cut in range(8):
        path.write_bytes(blob[: rng.integers(0, len(blob))].tobytes())
        with pytest.raises(ScanError):
            H5().read(path)
        assert cut < 8


@pytest.mark.parametrize("key", ["data", "points", "pts"])
def test_a_known_name_with_another_shape_is_refused(tmp_path: Path, key: str) -> None:
    message = refusal(tmp_path / "a.h5", **{key: BATCH.swapaxes(-1, -2), "label": np.zeros(len(BATCH))})
    assert f"{key}: " in message and "transpose it" in message
    assert "normal, other" in refusal(tmp_path / "b.h5", normal=BATCH, other=BATCH)
