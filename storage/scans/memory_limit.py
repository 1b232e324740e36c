"""How much memory is left for reading a scan, where the system tells."""

from __future__ import annotations

import os
from pathlib import Path

CGROUP = Path("/sys/fs/cgroup")
MEMINFO = Path("/proc/meminfo")


def free_memory() -> int | None:
    """Bytes that can still be taken without swapping: the system's, or the container's where that is less.

    None where no system tells.
    """
    known = [size for size in (_system(), _container()) if size is not None]
    return min(known) if known else None


def _system() -> int | None:
    try:
        lines = MEMINFO.read_text().splitlines()
    except OSError:  # not Linux
        return _physical()
    kilobytes = [line.split()[1] for line in lines if line.startswith("MemAvailable:")]
    return int(kilobytes[0]) * 1024 if kilobytes else _physical()


def _physical() -> int | None:
    """All memory there is: the best that other systems tell without a library."""
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, OSError, ValueError):
        return None


def _container() -> int | None:
    try:
        limit = (CGROUP / "memory.max").read_text().strip()
        if limit == "max":
            return None
        used = int((CGROUP / "memory.current").read_text())
        return max(0, int(limit) - used + _reclaimable())
    except (OSError, ValueError):  # no limit, or an older kind of container
        return None


def _reclaimable() -> int:
    """Bytes that a container counts as used for files that were read: the system lets go of them when asked."""
    try:
        told = dict(line.split() for line in (CGROUP / "memory.stat").read_text().splitlines())
        return int(told["inactive_file"])
    except (OSError, ValueError, KeyError):
        return 0
