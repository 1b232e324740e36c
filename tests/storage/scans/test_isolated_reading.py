"""A reader that ends its process, or takes all memory, fails for its file alone; a good one gives all that it read."""

from __future__ import annotations

import os
import signal
import threading
from dataclasses import fields
from pathlib import Path

import laspy
import numpy as np
import pytest

from z2p_core.interfaces import RawCloud, Reader, ScanError, Sensor
from z2p_renderer.storage.scans import clouds
from z2p_renderer.storage.scans.clouds import read_clouds
from z2p_renderer.storage.scans.isolated_reading import SPARE_BYTES, ReaderEndedError, read_in_subprocess

POINTS = np.random.default_rng(1).normal(size=(50, 3))
WHOLE = RawCloud(POINTS, Sensor(np.arange(3.0), np.eye(3)), total=99, note="nach Maß", up="-Y", up_reason="so",
                 up_certain=False, upward=np.array([0.0, 0.6, 0.8]), seen_from=np.ones(3),
                 fields={"rgb": np.full((50, 3), 0.5, np.float32), "class": np.arange(50, dtype=np.uint16)},
                 field_names=["rgb", "class", "time"], class_names={"class": {2: "ground"}}, units={"time": "s"},
                 color_kind="16-bit")  # fmt: skip


class Fragile(Reader):
    """Does what the file's name says."""

    name = "fragile"
    version = "1"
    suffixes = (".fragile",)

    def is_fragile(self, path: Path) -> bool:
        return True

    def read(self, path: Path) -> list[RawCloud | np.ndarray]:
        match path.stem:
            case "exit":
                os._exit(3)
            case "abort":
                os.kill(os.getpid(), signal.SIGABRT)
            case "greedy":
                return [np.ones((SPARE_BYTES // 8, 3))]
            case "refuses":
                raise ScanError("expected something else")
            case "fails":
                raise KeyError("no such thing")
            case "shape":
                return [np.ones((3, 4))]
            case "columns":
                return [POINTS[: len(self.columns or ())]]
            case "loud":
                os.write(2, b"a library says something\n")
        return [WHOLE, POINTS[:9]]


def read(path: Path, memory: int = 1 << 20) -> list[RawCloud]:
    path.touch()
    return read_in_subprocess(Fragile(), path, memory)


@pytest.mark.parametrize(("stem", "error", "message"), [
    ("exit", ReaderEndedError, "the reader's process ended .exit status 3.: the file is damaged"),
    ("abort", ReaderEndedError, "the reader's process ended .SIGABRT."),
    ("greedy", ScanError, "MemoryError|process ended"),
    ("refuses", ScanError, "^expected something else$"),
    ("fails", ScanError, "the reader 'Fragile' failed .KeyError: 'no such thing'."),
    ("shape", ScanError, r"gave an array .3, 4., expected .N, 3."),
])  # fmt: skip
def test_errors_in_the_subprocess_become_errors_of_the_file(
    tmp_path: Path, stem: str, error: type[ScanError], message: str
) -> None:
    with pytest.raises(error, match=message):
        read(tmp_path / f"{stem}.fragile")


def test_child_reader_output_is_returned_not_printed(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    whole, bare = read(tmp_path / "loud.fragile")
    assert np.array_equal(bare.points, POINTS[:9])
    for field in fields(RawCloud):
        given, expected = getattr(whole, field.name), getattr(WHOLE, field.name)
        if field.name == "sensor":
            assert np.array_equal(given.position, expected.position)
            assert np.array_equal(given.rotation, expected.rotation)
        elif isinstance(expected, np.ndarray):
            assert np.array_equal(given, expected)
        elif field.name == "fields":
            assert {name: (values.dtype, values.tolist()) for name, values in given.items()} == {
                name: (values.dtype, values.tolist()) for name, values in expected.items()}  # fmt: skip
        else:
            assert given == expected
    assert capfd.readouterr() == ("", "")


def test_columns_reach_the_subprocess_and_threads_stay_apart(tmp_path: Path) -> None:
    (tmp_path / "columns.fragile").touch()
    counts: dict[int, int] = {}

    def count(columns: int) -> None:
        reader = Fragile()
        reader.columns = ("x",) * columns
        counts[columns] = len(read_in_subprocess(reader, tmp_path / "columns.fragile", 1 << 20)[0].points)

    threads = [threading.Thread(target=count, args=(columns,)) for columns in (3, 5)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert counts == {3: 3, 5: 5}


def laz(path: Path) -> Path:
    content = laspy.LasData(laspy.LasHeader(point_format=3, version="1.2"))
    content.x, content.y, content.z = POINTS.T
    content.write(path)
    return path


def test_only_compressed_scans_are_read_in_a_subprocess(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    [plain] = read_clouds(laz(tmp_path / "a.las"))
    [packed] = read_clouds(laz(tmp_path / "a.laz"))
    assert np.array_equal(plain.points, packed.points)

    def ended(*_: object) -> list[RawCloud]:
        raise ReaderEndedError("the reader's process ended (SIGABRT)")

    monkeypatch.setattr(clouds, "read_in_subprocess", ended)
    assert len(read_clouds(tmp_path / "a.las")[0].points) == len(plain.points)
    with pytest.raises(ScanError, match=r"a\.laz: the reader's process ended"):
        read_clouds(tmp_path / "a.laz")
