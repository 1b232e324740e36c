"""Free memory: the least that anybody tells, and nothing rather than a guess."""

from __future__ import annotations

from pathlib import Path

import pytest

from z2p_renderer.storage.scans import memory_limit


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Folder that stands for the system's own files."""
    monkeypatch.setattr(memory_limit, "CGROUP", tmp_path)
    monkeypatch.setattr(memory_limit, "MEMINFO", tmp_path / "meminfo")
    return tmp_path


def test_free_memory_of_this_machine_is_plausible() -> None:
    free = memory_limit.free_memory()
    assert free is None or 10**7 < free < 10**14


def test_available_memory_counts_rather_than_free_memory(machine: Path) -> None:
    (machine / "meminfo").write_text("MemTotal: 9000 kB\nMemFree: 100 kB\nMemAvailable: 5000 kB\n")
    assert memory_limit.free_memory() == 5000 * 1024


def test_the_limit_of_a_container_counts(machine: Path) -> None:
    (machine / "meminfo").write_text("MemAvailable: 5000 kB\n")
    (machine / "memory.current").write_text("1000000\n")
    for limit, free in (("1500000", 500_000), ("900000", 0), ("max", 5000 * 1024), ("99999999999", 5000 * 1024)):
        (machine / "memory.max").write_text(f"{limit}\n")
        assert memory_limit.free_memory() == free


def test_the_file_cache_of_a_container_counts_as_free(machine: Path) -> None:
    (machine / "meminfo").write_text("MemAvailable: 5000 kB\n")
    (machine / "memory.max").write_text("1500000\n")
    (machine / "memory.current").write_text("1400000\n")
    (machine / "memory.stat").write_text("anon 1000\ninactive_file 900000\nactive_file 7\n")
    assert memory_limit.free_memory() == 1_000_000


def test_other_systems_report_total_memory_or_none(machine: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory_limit.os, "sysconf", lambda name: {"SC_PHYS_PAGES": 1000, "SC_PAGE_SIZE": 4096}[name])
    assert memory_limit.free_memory() == 4_096_000
    (machine / "meminfo").write_text("nothing of the kind\n")
    assert memory_limit.free_memory() == 4_096_000

    def refuse(name: str) -> int:
        raise ValueError(name)

    monkeypatch.setattr(memory_limit.os, "sysconf", refuse)
    assert memory_limit.free_memory() is None
