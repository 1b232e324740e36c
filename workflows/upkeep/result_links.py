"""Symbolic links from ``<workspace>/<config name>/`` into the store, replaced atomically."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path


def link_results(results: Mapping[Path, Path]) -> None:
    """Make each key of `results` a link to its file in the store, replacing older links."""
    for link, target in results.items():
        link.parent.mkdir(parents=True, exist_ok=True)
        temporary = link.with_name(f".{link.name}.{os.getpid()}")
        temporary.unlink(missing_ok=True)
        temporary.symlink_to(os.path.relpath(target, link.parent))
        temporary.replace(link)


def are_linked(results: Mapping[Path, Path]) -> bool:
    """Whether each key of `results` is a link to its file already."""
    return all(link.is_symlink() and link.resolve() == target.resolve() for link, target in results.items())
