"""What is kept for engines: whole or not at all, whatever happens to the disk or to those that write."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from z2p_renderer.storage.models.engine_cache import MAX_FILES, BlobCache, user_cache


def test_what_was_put_comes_back_and_only_under_its_key(tmp_path: Path) -> None:
    cache = BlobCache(tmp_path / "new" / "folder")
    assert cache.get("a") is None
    cache.put("a", b"first")
    cache.put("a", b"second" * 1000)
    assert cache.get("a") == BlobCache(tmp_path / "new" / "folder").get("a") == b"second" * 1000
    assert cache.get("b") is None


@pytest.mark.parametrize("damage", [lambda old: old[:-1], lambda old: old[:40] + b"?" + old[41:], lambda old: b""])
def test_a_damaged_file_is_as_though_it_had_never_been_kept(tmp_path: Path, damage) -> None:
    cache = BlobCache(tmp_path)
    cache.put("a", b"content" * 100)
    (file,) = tmp_path.iterdir()
    file.write_bytes(damage(file.read_bytes()))
    assert cache.get("a") is None
    cache.put("a", b"again")
    assert cache.get("a") == b"again"


def test_what_may_only_be_read_is_used_all_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    BlobCache(tmp_path).put("a", b"content")

    def refuse(path: Path) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "utime", refuse)
    assert BlobCache(tmp_path).get("a") == b"content"


def test_the_least_recently_used_files_are_dropped(tmp_path: Path) -> None:
    cache = BlobCache(tmp_path)
    for number in range(MAX_FILES):
        cache.put(str(number), b"x")
    for age, number in enumerate(reversed(range(MAX_FILES))):
        os.utime(cache._path(str(number)), (1000 - age, 1000 - age))
    assert cache.get("0") == b"x"  # the oldest, asked for
    cache.put("new", b"y")
    assert [cache.get(key) for key in ("0", "1", "2", "new")] == [b"x", None, b"x", b"y"]
    assert len(list(tmp_path.iterdir())) == MAX_FILES


def test_a_folder_that_cannot_be_written_is_no_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    cache = BlobCache(tmp_path / "file" / "below")
    cache.put("a", b"x")
    assert cache.get("a") is None


def test_a_killed_writer_leaves_no_partial_file(tmp_path: Path) -> None:
    """It writes two contents in turn; whenever it is killed, one of them is there, whole."""
    code = ("from z2p_renderer.storage.models.engine_cache import BlobCache; import sys, pathlib\n"
            "cache = BlobCache(pathlib.Path(sys.argv[1]))\n"
            "while True: cache.put('a', b'0' * 3_000_000); cache.put('a', b'1' * 3_000_000)")  # fmt: skip
    for pause in (0.05, 0.11, 0.17):
        with subprocess.Popen([sys.executable, "-c", code, str(tmp_path)]) as writer:
            while not list(tmp_path.glob("*.kept")):
                assert writer.poll() is None, "the writer died by itself"
                time.sleep(0.01)
            time.sleep(pause)
            writer.send_signal(signal.SIGKILL)
        assert BlobCache(tmp_path).get("a") in (b"0" * 3_000_000, b"1" * 3_000_000)


def test_the_users_folder_can_be_named_or_turned_off(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("Z2P_CACHE", str(tmp_path))
    user_cache().put("a", b"x")
    assert len(list(tmp_path.iterdir())) == 1
    monkeypatch.setenv("Z2P_CACHE", "")
    user_cache().put("b", b"x")
    assert user_cache().get("a") is None and len(list(tmp_path.iterdir())) == 1
    monkeypatch.delenv("Z2P_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    user_cache().put("c", b"x")
    assert len(list((tmp_path / "cache" / "z2p").iterdir())) == 1
