"""Results under the name of their config: links into the store that are exchanged whole."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path


def link_results(results: Mapping[Path, Path]) -> None:
    """Make each path of `results` a link to its file in the store, in place of an older one."""
    for shown, found in results.items():
        shown.parent.mkdir(parents=True, exist_ok=True)
        fresh = shown.with_name(f".{shown.name}.{os.getpid()}")
        fresh.unlink(missing_ok=True)
        fresh.symlink_to(os.path.relpath(found, shown.parent))
        fresh.replace(shown)


def are_linked(results: Mapping[Path, Path]) -> bool:
    """Whether each path of `results` is a link to its file already."""
    return all(shown.is_symlink() and shown.resolve() == found.resolve() for shown, found in results.items())
