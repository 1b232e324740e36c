"""Advice on what to install names this project and existing extras."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

from z2p_core.errors.install_advice import ENGINE_EXTRAS, install_advice

ROOT = Path(__file__).resolve().parents[3]
CODE = [path for folder in ("z2p_core", "pipeline", "storage", "workflows", "plugins", "z2p_renderer", "shims")
        for path in (ROOT / folder).rglob("*.py")]  # fmt: skip
EXTRAS = set(tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"])


def test_the_advised_command_works_in_a_clone() -> None:
    assert install_advice("video").endswith('pip install -c constraints.txt ".[video]"')
    assert install_advice().endswith('pip install -c constraints.txt "."')
    assert (ROOT / "constraints.txt").exists() and ENGINE_EXTRAS <= EXTRAS


@pytest.mark.parametrize("path", CODE, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_advice_names_only_existing_extras(path: Path) -> None:
    code = path.read_text()
    assert not re.search(r"pip install [^.\n]*\bz2p\b(?!-renderer)", code) and "z2p[" not in code
    named = set(re.findall(r"install_advice\(\s*['\"](\w+)['\"]", code))
    assert named <= EXTRAS
