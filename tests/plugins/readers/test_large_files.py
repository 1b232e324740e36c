"""Of large files so many points are kept as a picture can show, spread over the file."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import laspy
import numpy as np
import pytest

from z2p_core.formats.row_subsampling import MAX_ROWS_LIMIT, MIN_ROWS_LIMIT, ThinnedRows, rows_for_picture
from z2p_core.interfaces import Reader, ScanError
from z2p_renderer.plugins.readers import ply
from z2p_renderer.plugins.readers._helpers.las_header import packed_chunk_points
from z2p_renderer.plugins.readers.las import Las
from z2p_renderer.plugins.readers.pcd import Pcd
from z2p_renderer.plugins.readers.ply import Ply
from z2p_renderer.plugins.readers.ptx import Ptx
from z2p_renderer.plugins.readers.text import Text
from z2p_renderer.storage.scans.clouds import read_clouds

COUNT, KEPT = 5000, 500
POINTS = np.column_stack([np.arange(COUNT), np.random.default_rng(0).integers(1, 99, (COUNT, 2))]).astype(float)


def rows(values: np.ndarray) -> str:
    return "\n".join(" ".join(f"{value:g}" for value in row) for row in values) + "\n"


def write_xyz(path: Path) -> None:
    path.write_text(rows(POINTS))


def write_numbered(path: Path) -> None:
    path.write_text(rows(np.column_stack([np.arange(COUNT), POINTS])))


def write_pts(path: Path) -> None:
    path.write_text(f"{COUNT}\n{rows(POINTS)}")


def write_ptx(path: Path) -> None:
    axes = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"
    path.write_text(f"{COUNT}\n1\n{axes}{rows(np.column_stack([POINTS, np.full(COUNT, 0.5)]))}")


def write_pcd(path: Path) -> None:
    path.write_text(
        f"VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {COUNT}\nHEIGHT 1\n"
        f"VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {COUNT}\nDATA ascii\n{rows(POINTS)}"
    )


def write_ply(path: Path) -> None:
    """A mesh in text, with an element before its vertices."""
    header = f"ply\nformat ascii 1.0\nelement camera 2\nproperty float f\nelement vertex {COUNT}\n"
    axes = "".join(f"property float {axis}\n" for axis in "xyz")
    faces = "element face 3\nproperty list uchar int vertex_indices\nend_header\n"
    text = f"{header}{axes}{faces}35\n50\n{rows(POINTS)}" + 3 * "3 0 1 2\n"
    path.write_text(text)


TEXTS = [(Text, "a.xyz", write_xyz), (Text, "numbered.txt", write_numbered), (Text, "a.pts", write_pts),
         (Ptx, "a.ptx", write_ptx), (Pcd, "a.pcd", write_pcd),
         (Ply, "a.ply", write_ply)]  # fmt: skip


@pytest.mark.parametrize(("kind", "name", "write"), TEXTS)
def test_texts_keep_an_even_part_of_their_rows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: type[Reader], name: str, write: Callable[[Path], None]
) -> None:
    write(tmp_path / name)
    monkeypatch.setattr(kind, "max_rows", KEPT)
    [scan] = read_clouds(tmp_path / name)
    kept = scan.points[:, 0].astype(int)
    assert scan.total == COUNT and KEPT / 2 <= len(kept) <= 1.3 * KEPT
    assert np.array_equal(scan.points, POINTS[kept])
    assert np.diff(kept).min() > 0 and np.diff(kept).max() <= 4 * COUNT / len(kept)


@pytest.mark.parametrize("lines", ["\n", "\r\n", "\n\n"])
def test_ply_text_is_the_same_in_any_blocks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, lines: str) -> None:
    write_ply(tmp_path / "a.ply")
    text = (tmp_path / "a.ply").read_bytes()
    at = text.index(b"end_header\n") + len(b"end_header\n")
    (tmp_path / "a.ply").write_bytes(text[:at] + text[at:].replace(b"\n", lines.encode()))
    for size in (64, 1 << 22):
        monkeypatch.setattr(ply, "_BLOCK_CHARACTERS", size)
        [scan] = read_clouds(tmp_path / "a.ply")
        assert np.array_equal(scan.points, POINTS)


def test_ply_text_cut_short_says_how_many_vertices_came(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_ply(tmp_path / "a.ply")
    kept = (tmp_path / "a.ply").read_text().splitlines()[: -3 - 40]
    (tmp_path / "a.ply").write_text("\n".join(kept))
    monkeypatch.setattr(ply, "_BLOCK_CHARACTERS", 1000)
    with pytest.raises(ScanError, match=rf"promises {COUNT} vertices, {COUNT - 40} lines came"):
        read_clouds(tmp_path / "a.ply")


def test_the_limit_reaches_readers_in_processes_of_their_own(tmp_path: Path) -> None:
    cloud = laspy.LasData(laspy.LasHeader(point_format=0, version="1.2"))
    cloud.x, cloud.y, cloud.z = POINTS.T
    cloud.write(str(tmp_path / "a.laz"))
    [scan] = read_clouds(tmp_path / "a.laz", max_rows=KEPT)
    assert scan.total == COUNT and len(scan.points) == KEPT


def test_a_bad_row_is_named_by_its_line(tmp_path: Path) -> None:
    write_xyz(tmp_path / "a.xyz")
    lines = (tmp_path / "a.xyz").read_text().splitlines()
    (tmp_path / "a.xyz").write_text("\n".join([*lines[:4000], "no point", *lines[4001:], ""]))
    with pytest.raises(ScanError, match="line 4001"):
        Text().read(tmp_path / "a.xyz")


def test_blocks_of_a_laz_file_begin_where_its_chunks_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cloud = laspy.LasData(laspy.LasHeader(point_format=0, version="1.2"))
    cloud.x, cloud.y, cloud.z = np.tile(POINTS.T, 24)
    cloud.write(str(tmp_path / "a.laz"))
    with laspy.open(tmp_path / "a.laz", laz_backend=laspy.LazBackend.Lazrs) as reader:
        chunk = packed_chunk_points(reader.header)
        kind = type(reader)
    assert chunk == 50_000
    begins: list[int] = []
    seek = kind.seek
    monkeypatch.setattr(kind, "seek", lambda self, start: (begins.append(start), seek(self, start))[1])
    monkeypatch.setattr("z2p_renderer.plugins.readers.las._CHUNK_POINTS", 60_000)
    monkeypatch.setattr(Las, "max_rows", 30_007)
    [whole] = Las().read(tmp_path / "a.laz")
    assert begins == [100_000] and abs(len(whole.points) - 30_007) <= 2 and whole.total == 120_000


def test_unpacked_points_have_no_chunks(tmp_path: Path) -> None:
    cloud = laspy.LasData(laspy.LasHeader(point_format=0, version="1.2"))
    cloud.x, cloud.y, cloud.z = POINTS.T
    cloud.write(str(tmp_path / "a.las"))
    with laspy.open(tmp_path / "a.las") as reader:
        assert packed_chunk_points(reader.header) == 1
        record = type("Record", (), {"record_id": 22204, "record_data": bytes(12) + struct.pack("<I", 0xFFFFFFFF)})
        header = type("Header", (), {"vlrs": [record]})
    assert packed_chunk_points(header) == 1


def test_larger_pictures_keep_more_points() -> None:
    limits = [rows_for_picture(side, side) for side in (64, 512, 768, 1024, 4096)]
    assert limits[0] == MIN_ROWS_LIMIT and limits == sorted(limits) and limits[-1] == MAX_ROWS_LIMIT
    assert limits[2] > limits[1]


@pytest.mark.parametrize("expected", [0, 10_000, 1_000_000])
def test_rows_of_unknown_number_are_thinned_out_whatever_was_expected(expected: int) -> None:
    thinned = ThinnedRows(1, 1000, expected)
    for start in range(0, 100_000, 5000):
        thinned.add(np.arange(start, start + 5000)[:, None])
        assert len(thinned.table()) <= 1200
    kept = thinned.table()[:, 0]
    assert thinned.is_thinned and (np.diff(kept) > 0).all() and kept[-1] > 98_000
    assert np.diff(kept).max() <= 6 * 100_000 / len(kept)
