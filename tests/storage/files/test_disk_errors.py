"""What a disk refuses is told by its kind and its place, however a library says it; other errors are none of it."""

import errno
import os
import subprocess

import pytest

from z2p_renderer.storage.files.disk_errors import disk_error_message, full_disk_message


@pytest.mark.parametrize("number, words", [
    (errno.ENOSPC, "no space left"), (errno.EDQUOT, "quota"), (errno.EROFS, "read-only"), (errno.EIO, "failed"),
    (errno.ESTALE, "network disk"), (errno.EMFILE, "ulimit -n"), (errno.ENFILE, "open files"),
])  # fmt: skip
def test_disk_errors_are_reported_with_their_path(number, words, tmp_path):
    told = disk_error_message(OSError(number, os.strerror(number), str(tmp_path / "shard.h5")))
    assert words in told and "shard.h5" in told
    unnamed = OSError(number, os.strerror(number))
    assert str(tmp_path) in disk_error_message(unnamed, tmp_path), "where the error names no file"


def test_disk_errors_in_library_messages_are_recognized(tmp_path):
    try:
        try:
            raise OSError(errno.ENOSPC, "No space left on device")
        except OSError as error:
            raise KeyError("coverage.X") from error
    except KeyError as error:
        assert "no space left" in disk_error_message(error)
    assert "no space left" in disk_error_message(RuntimeError("I/O error: No space left on device (os error 28)"))
    assert "no space left" in disk_error_message("Error: cannot write\nNo space left on device", tmp_path)


def test_other_errors_are_no_disk_errors(tmp_path):
    for error in (KeyError("coverage.X"), ValueError("no"), FileNotFoundError(errno.ENOENT, "gone", "a"),
                  OSError("200 requested and 100 written")):  # fmt: skip
        assert disk_error_message(error, tmp_path) is None


def test_denied_permissions_count_only_in_the_output_folder(tmp_path):
    denied = PermissionError(errno.EACCES, "Permission denied", str(tmp_path / "runs" / ".tmp"))
    assert "no permission" in disk_error_message(denied, tmp_path / "runs")
    assert disk_error_message(denied, tmp_path / "meshes") is None and disk_error_message(denied) is None


@pytest.mark.parametrize("options, words", [("size=64k", "no space left"), ("size=1m,nr_inodes=4", "no inodes left")])
def test_a_full_disk_is_reported(options, words, tmp_path):
    assert full_disk_message(tmp_path) is None
    disk = tmp_path / "disk"
    disk.mkdir()
    words_of_mount = ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(disk)]
    mounted = subprocess.run(words_of_mount, capture_output=True, text=True, check=False)
    if mounted.returncode:
        pytest.skip(f"a small filesystem cannot be mounted here: {mounted.stderr.strip()}")
    try:
        with pytest.raises(OSError) as refused:
            for number in range(100):
                (disk / f"{number}").write_bytes(bytes(4096))
        assert words in full_disk_message(disk)
        assert words in disk_error_message(refused.value, disk)
    finally:
        subprocess.run(["umount", "--lazy", str(disk)], check=True)


def test_an_unknown_disk_is_not_reported_full(tmp_path):
    assert full_disk_message(tmp_path / "none") is None
