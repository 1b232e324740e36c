"""Digests of sources, kept from one process to the next in the user's cache folder: parsing takes a second each time.

A digest is kept under the sha256 of the source that it was computed from, so it can be missing but not out of date.
"""

from __future__ import annotations

import atexit
import hashlib
import json
import sys
from collections.abc import Callable
from functools import cached_property
from pathlib import Path

from z2p_renderer.storage.models.engine_cache import BlobCache, user_cache

MAX_ENTRIES = 4000
"""Digests that are kept; with more, only those that this process asked for stay. One has about 140 bytes."""


class KeptDigests:
    """Digests by the sources that they are of. Several processes may share the cache: the last one's digests stay.

    Args:
        computed_by: files of the code that computes the digests; with other code, or another Python, none counts.
        find_cache: gives the cache when a digest is first asked for.
    """

    def __init__(self, *computed_by: str, find_cache: Callable[[], BlobCache] = user_cache) -> None:
        self._computed_by = computed_by
        self._find_cache = find_cache
        self._asked: dict[str, str] = {}
        self._is_new = False

    def get(self, part: str, source: str, compute: Callable[[], str]) -> str:
        """The digest of a part of a source, such as ``C`` or ``Python render``, computed if it is not kept."""
        key = hashlib.sha256(f"{part}\0{source}".encode()).hexdigest()
        digest = self._asked.get(key) or self._kept.get(key)
        if digest is None:
            digest = compute()
            if not self._is_new:
                atexit.register(self.save)
            self._is_new = True
        self._asked[key] = digest
        return digest

    def save(self) -> None:
        """Keep what was asked for, beside what is kept already."""
        both = {**self._kept, **self._asked}
        self._cache.put(self._key, json.dumps(self._asked if len(both) > MAX_ENTRIES else both).encode())

    @cached_property
    def _cache(self) -> BlobCache:
        return self._find_cache()

    @cached_property
    def _key(self) -> str:
        code = b"".join(Path(file).read_bytes() for file in (__file__, *self._computed_by))
        return f"digests of sources, by Python {sys.version} and {hashlib.sha256(code).hexdigest()}"

    @cached_property
    def _kept(self) -> dict[str, str]:
        content = self._cache.get(self._key)
        return {} if content is None else json.loads(content)
