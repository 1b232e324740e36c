"""Digests of sources outlive a process; damage to what is kept costs time only."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from z2p_renderer.storage.models.engine_cache import BlobCache
from z2p_renderer.storage.results.kept_digests import KeptDigests


@pytest.fixture
def process(tmp_path: Path) -> Callable[..., KeptDigests]:
    """Function that gives what a new process has, for digests that some files of code compute."""
    return lambda *files: KeptDigests(*map(str, files), find_cache=lambda: BlobCache(tmp_path / "cache"))


def unexpected() -> str:
    raise AssertionError("computed again")


def test_a_digest_is_computed_once(process: Callable[..., KeptDigests]) -> None:
    first = process()
    assert [first.get("C", "int a;", lambda: "12") for _ in range(2)] == ["12", "12"]
    first.save()
    second = process()
    assert second.get("C", "int a;", unexpected) == "12"
    assert second.get("Python", "int a;", lambda: "34") == "34" and second.get("C", "int b;", lambda: "56") == "56"
    second.save()
    assert process().get("C", "int a;", unexpected) == "12" and process().get("C", "int b;", unexpected) == "56"


def test_other_code_computes_other_digests(process: Callable[..., KeptDigests], tmp_path: Path) -> None:
    code = tmp_path / "code.py"
    code.write_text("VERSION = 1")
    first = process(code)
    first.get("C", "int a;", lambda: "12")
    first.save()
    assert process(code).get("C", "int a;", unexpected) == "12"
    code.write_text("VERSION = 2")
    assert process(code).get("C", "int a;", lambda: "78") == "78"


def test_damage_is_as_though_nothing_were_kept(process: Callable[..., KeptDigests], tmp_path: Path) -> None:
    first = process()
    first.get("C", "int a;", lambda: "12")
    first.save()
    [file] = (tmp_path / "cache").iterdir()
    file.write_bytes(file.read_bytes()[:-3])
    assert process().get("C", "int a;", lambda: "12") == "12"
