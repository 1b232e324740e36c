"""A file is there whole, or as it was before; nothing else is left, whatever goes wrong on the way."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from z2p_renderer.storage.files.atomic_write import NotAFileError, atomic_path, atomic_write
from z2p_renderer.storage.images.image_files import PictureError, write_picture


def names(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir()]


@pytest.mark.parametrize("durable", [False, True])
def test_a_write_leaves_the_content_and_no_other_file(tmp_path: Path, durable: bool) -> None:
    path = tmp_path / "new" / "folders" / "one.bin"
    for content in (b"first", b""):
        assert atomic_write(content, path, durable=durable) == path
        assert path.read_bytes() == content and names(path.parent) == ["one.bin"]


def test_a_failure_at_any_point_keeps_the_old_content(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "one.bin"
    atomic_write(b"before", path)
    with pytest.raises(KeyError), atomic_path(path) as temporary:
        temporary.write_bytes(b"half")
        assert path.read_bytes() == b"before"
        raise KeyError
    for name in ("fsync", "replace"):  # a full disk, and a folder that went

        def fail(*given: object) -> None:
            raise OSError("full")

        with monkeypatch.context() as patch:
            patch.setattr(os, name, fail)
            if name == "replace":
                patch.setattr(Path, name, fail)
            with pytest.raises(OSError, match="full"):
                atomic_write(b"after", path, durable=True)
        assert path.read_bytes() == b"before" and names(tmp_path) == ["one.bin"]


def test_the_longest_valid_file_name_can_be_written(tmp_path: Path) -> None:
    atomic_write(b"x", tmp_path / ("n" * 255))


def test_concurrent_writers_leave_one_whole_content(tmp_path: Path) -> None:
    path, contents = tmp_path / "one.bin", [bytes([number]) * 50_000 for number in range(8)]
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda content: atomic_write(content, path), contents * 4))
    assert path.read_bytes() in contents and names(tmp_path) == ["one.bin"]


def test_only_regular_files_are_replaced(tmp_path):
    os.mkfifo(tmp_path / "pipe.png")
    (tmp_path / "folder.png").mkdir()
    (tmp_path / "null.png").symlink_to("/dev/null")
    before = {path.name: path.lstat().st_ino for path in tmp_path.iterdir()}
    for name, kind in (("pipe.png", "a pipe"), ("folder.png", "a folder"), ("null.png", "a device")):
        with pytest.raises(NotAFileError, match=f"expected the name of a file to write, got {kind}"):
            atomic_write(b"x", tmp_path / name)
        with pytest.raises(PictureError, match=kind):
            write_picture(np.zeros((4, 4, 4), np.uint8), tmp_path / name)
    assert before == {path.name: path.lstat().st_ino for path in tmp_path.iterdir()}
    (tmp_path / "gone.png").symlink_to("nowhere")
    atomic_write(b"x", tmp_path / "gone.png")
    assert (tmp_path / "gone.png").read_bytes() == b"x"
