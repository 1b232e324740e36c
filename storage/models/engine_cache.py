"""What engines work out for a network, kept from one process to the next in the user's cache folder.

All of it can be made again: whatever is missing, damaged or cannot be written is as though it had never been kept.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from contextlib import suppress
from pathlib import Path

CACHE_VARIABLE = "Z2P_CACHE"
"""Environment variable that names another folder, or, where empty, keeps nothing."""
MAX_FILES = 8
"""Files that are kept; of more, those that nobody asked for the longest are dropped. One has about 9 MB."""
_DIGEST = hashlib.sha256().digest_size


class BlobCache:
    """Bytes by key, in a folder. Several processes may share it, and be killed at any moment."""

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder

    def get(self, key: str) -> bytes | None:
        """What was kept under a key, whole; None where there is none."""
        if self._folder is None:
            return None
        path = self._path(key)
        try:
            whole = path.read_bytes()
        except OSError:
            return None
        with suppress(OSError):  # a folder that was filled beforehand may be read-only
            os.utime(path)  # it was asked for
        digest, content = whole[:_DIGEST], whole[_DIGEST:]
        return content if hashlib.sha256(content).digest() == digest else None

    def put(self, key: str, content: bytes) -> None:
        """Keeps it, in one step, as far as the disk lets it."""
        if self._folder is None:
            return
        with suppress(OSError):
            self._folder.mkdir(parents=True, exist_ok=True)
            handle, name = tempfile.mkstemp(dir=self._folder, suffix=".part")
            try:
                with os.fdopen(handle, "wb") as file:
                    file.write(hashlib.sha256(content).digest() + content)
                Path(name).replace(self._path(key))
            finally:
                Path(name).unlink(missing_ok=True)
            self._drop_oldest()

    def _path(self, key: str) -> Path:
        assert self._folder is not None
        return self._folder / f"{hashlib.sha256(key.encode()).hexdigest()}.kept"

    def _drop_oldest(self) -> None:
        """Also parts of files whose writers were killed, once they are old."""
        assert self._folder is not None
        files = [path for path in self._folder.iterdir() if path.suffix in (".kept", ".part")]
        for path in sorted(files, key=lambda path: path.stat().st_mtime, reverse=True)[MAX_FILES:]:
            path.unlink(missing_ok=True)


def user_cache() -> BlobCache:
    """That of the user's cache folder (Linux: ``~/.cache/z2p``), or where ``Z2P_CACHE`` says."""
    named = os.environ.get(CACHE_VARIABLE)
    if named is not None:
        return BlobCache(Path(named) if named else None)
    from platformdirs import user_cache_path  # late: most engines keep nothing

    return BlobCache(user_cache_path("z2p", appauthor=False))
