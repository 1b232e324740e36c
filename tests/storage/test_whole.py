"""A file is there whole, or as it was before; nothing else is left, whatever goes wrong on the way."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from z2p_renderer.storage.whole import whole, write_whole


def names(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir()]


@pytest.mark.parametrize("lasting", [False, True])
def test_the_content_is_there_and_nothing_beside_it(tmp_path: Path, lasting: bool) -> None:
    path = tmp_path / "new" / "folders" / "one.bin"
    for content in (b"first", b""):
        assert write_whole(content, path, lasting=lasting) == path
        assert path.read_bytes() == content and names(path.parent) == ["one.bin"]


def test_a_failure_at_any_point_leaves_what_was_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "one.bin"
    write_whole(b"before", path)
    with pytest.raises(KeyError), whole(path) as temporary:
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
                write_whole(b"after", path, lasting=True)
        assert path.read_bytes() == b"before" and names(tmp_path) == ["one.bin"]


def test_the_longest_name_that_a_folder_holds_can_be_written(tmp_path: Path) -> None:
    write_whole(b"x", tmp_path / ("n" * 255))


def test_many_writers_of_one_file_leave_one_of_their_contents(tmp_path: Path) -> None:
    path, contents = tmp_path / "one.bin", [bytes([number]) * 50_000 for number in range(8)]
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda content: write_whole(content, path), contents * 4))
    assert path.read_bytes() in contents and names(tmp_path) == ["one.bin"]
