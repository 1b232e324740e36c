"""Files that no reader takes, or that have a wrong suffix, are described with advice."""

from __future__ import annotations

import gzip
import os
from pathlib import Path

import numpy as np
import pytest

from z2p_core.interfaces import ScanError
from z2p_renderer.storage.scans.clouds import find_scans, read_clouds, readable_suffixes, write_cloud
from z2p_renderer.storage.scans.unsupported_formats import UNREAD_CLOUDS, UNREAD_OTHERS

POINTS = np.random.default_rng(1).normal(size=(20, 3))


def refused(path: Path, blob: bytes, message: str) -> None:
    path.write_bytes(blob)
    with pytest.raises(ScanError, match=message) as caught:
        read_clouds(path)
    assert "\n" not in str(caught.value) and "--columns" not in str(caught.value)


@pytest.mark.parametrize("suffix", sorted({*UNREAD_CLOUDS, *UNREAD_OTHERS} - set(readable_suffixes())))
def test_unsupported_formats_get_advice_on_conversion(tmp_path: Path, suffix: str) -> None:
    refused(tmp_path / f"a{suffix}", b"\x01\x02\x03" * 9, rf"a\{suffix}: (is|holds) .*, which z2p does not read; \w")


@pytest.mark.parametrize(("name", "blob", "message"), [
    ("a.bin", b"CCB2" + bytes(99), "is a CloudCompare project .*save it as PLY or LAS"),
    ("a.bin", b"CCB0" + bytes(99), "is a CloudCompare project"),
    ("a.ply", b"\n <!DOCTYPE html>\n<html lang=en>", "is a web page .*download it again"),
    ("a.las", b"<?xml version='1.0'?>\n<Error><Code>NoSuchKey", "server's error message"),
    ("a.pcd", b"version https://git-lfs.github.com/spec/v1\noid sha256:0", "Git LFS pointer.* git lfs pull"),
    ("a.ply", gzip.compress(b"ply\n", mtime=0), r"is packed by gzip; rename it to a\.ply\.gz"),
    ("a.xyz", b"PK\x03\x04" + bytes(60), "is a ZIP archive; unpack it"),
    ("a.csv", b"PK\x03\x04" + bytes(60), "is a spreadsheet.*as CSV"),
    ("a.bin", b"LASF" + bytes(400), r"holds a LAS file under a name that ends in \.bin; rename it to a\.las"),
    ("a.ply", b"# .PCD v0.7 - Point Cloud Data\n", r"holds a PCD file .*rename it to a\.pcd"),
    ("scan", b"ply\nformat ascii 1.0\n", r"holds a PLY file under a name without suffix; rename it to scan\.ply"),
    ("a.txt", b"\x93NUMPY\x01\0", r"rename it to a\.npy"),
    ("a.bin", b"#ROSBAG V2.0\n" + bytes(99), "is a ROS bag.* bag_to_pcd"),
    ("a.ply", b"DRACO\x02\x02", "draco_decoder -i a.ply"),
    ("a.pcd", b"\x89PNG\r\n\x1a\n" + bytes(99), "is a picture"),
])  # fmt: skip
def test_content_that_contradicts_the_suffix_is_reported(tmp_path: Path, name: str, blob: bytes, message: str) -> None:
    refused(tmp_path / name, blob, message)


@pytest.mark.parametrize("name", ["a.ply", "b.PLY", "c.ply.gz"])
def test_files_whose_suffix_fits_are_read(tmp_path: Path, name: str) -> None:
    write_cloud(tmp_path / "plain", POINTS)
    blob = (tmp_path / "plain").read_bytes()
    (tmp_path / name).write_bytes(gzip.compress(blob) if name.endswith(".gz") else blob)
    assert np.array_equal(read_clouds(tmp_path / name)[0].points, POINTS)


def test_folders_skip_and_report_only_unsupported_clouds(tmp_path: Path) -> None:
    write_cloud(tmp_path / "a.ply", POINTS)
    for name in ("b.splat", "c.bag", "d.blend", "e.jpg", "f.zip"):
        (tmp_path / name).write_bytes(b"?")
    (tmp_path / "project.bin").write_bytes(b"CCB2" + bytes(99))
    skipped: list[str] = []
    scan_paths = find_scans([str(tmp_path)], False, lambda path: skipped.append(path.name))
    assert [path.name for path in scan_paths] == ["a.ply"]
    assert skipped == ["b.splat", "c.bag", "project.bin"]


def test_a_folder_of_unsupported_clouds_names_one(tmp_path: Path) -> None:
    (tmp_path / "b.splat").write_bytes(b"?")
    with pytest.raises(ScanError, match=r"holds no point cloud; .*; b.splat holds packed Gaussian splats.*SuperSplat"):
        find_scans([str(tmp_path)], False)


@pytest.mark.parametrize("name", ["pipe", "pipe.ply", "a\0b", "nowhere"])
def test_pipes_and_missing_files_are_refused_at_once(tmp_path: Path, name: str) -> None:
    if name.startswith("pipe"):
        os.mkfifo(tmp_path / name)
    with pytest.raises(ScanError):
        read_clouds(tmp_path / name)


def test_a_pipe_of_unknown_format_is_refused_without_blocking(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.unknown")
    with pytest.raises(ScanError, match=r"no reader for '\.unknown'"):
        read_clouds(tmp_path / "pipe.unknown")
