"""How much memory is free for reading a scan."""

from __future__ import annotations

import os
from pathlib import Path

CGROUP = Path("/sys/fs/cgroup")
MEMINFO = Path("/proc/meminfo")


def free_memory() -> int | None:
    """Bytes that can be allocated without swapping: the minimum over the system and the container.

    None if neither is known.
    """
    known = [size for size in (_system_free(), _container_free()) if size is not None]
    return min(known) if known else None


def _system_free() -> int | None:
    try:
        lines = MEMINFO.read_text().splitlines()
    except OSError:  # not Linux
        return _physical_memory()
    kilobytes = [line.split()[1] for line in lines if line.startswith("MemAvailable:")]
    return int(kilobytes[0]) * 1024 if kilobytes else _physical_memory()


def _physical_memory() -> int | None:
    """The total physical memory, which is all that other systems report without a library."""
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, OSError, ValueError):
        return None


def _container_free() -> int | None:
    try:
        limit = (CGROUP / "memory.max").read_text().strip()
        if limit == "max":
            return None
        used = int((CGROUP / "memory.current").read_text())
        return max(0, int(limit) - used + _reclaimable())
    except (OSError, ValueError):  # no limit, or an older kind of container
        return None


def _reclaimable() -> int:
    """Bytes of the file cache, which the container counts as used although the system frees them on demand."""
    try:
        statistics = dict(line.split() for line in (CGROUP / "memory.stat").read_text().splitlines())
        return int(statistics["inactive_file"])
    except (OSError, ValueError, KeyError):
        return 0
