"""Compiled kernels carry a note of the C files that they come from, by which outdated ones are recognized."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from z2p_core.native.source_digest import NOTE_NAME, are_kernels_outdated, source_digest

ROOT = Path(__file__).parents[3]


def test_kernels_of_other_sources_are_outdated(tmp_path):
    folder = tmp_path / "c" / "points"
    folder.mkdir(parents=True)
    (tmp_path / "build.py").write_text("FLAGS = []")
    (folder / "a.c").write_text("int a;")
    (folder / "a.h").write_text("int a;")
    assert not are_kernels_outdated(tmp_path)  # without a note nobody knows
    (tmp_path / NOTE_NAME).write_text(source_digest(tmp_path) + "\n")
    (tmp_path / "a.py").write_text("a = 1")
    assert not are_kernels_outdated(tmp_path)
    for change in ("int b;", "int  a;"):
        (folder / "a.h").write_text(change)
        assert are_kernels_outdated(tmp_path)
    (folder / "a.h").write_text("int a;")
    assert not are_kernels_outdated(tmp_path)
    (folder / "a.c").rename(folder / "b.c")
    assert are_kernels_outdated(tmp_path)
    (folder / "b.c").rename(folder / "a.c")
    (tmp_path / "build.py").write_text("FLAGS = ['-O0']")
    assert are_kernels_outdated(tmp_path)


@pytest.mark.slow  # compiles
def test_building_writes_the_note_of_its_sources(tmp_path):
    for path in ("pyproject.toml", "setup.py", "README.md", "LICENSE", "z2p_core"):
        copy = shutil.copytree if (ROOT / path).is_dir() else shutil.copy2
        copy(ROOT / path, tmp_path / path)
    for folder in ("pipeline", "plugins", "shims", "storage", "workflows", "z2p_renderer"):
        (tmp_path / folder).mkdir()
    (tmp_path / "z2p_core" / "native" / NOTE_NAME).unlink(missing_ok=True)
    command = [sys.executable, "setup.py", "-q", "build_ext", "--inplace"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    native_files = tmp_path / "z2p_core" / "native"
    assert (native_files / NOTE_NAME).read_text().strip() == source_digest(native_files)
    assert not are_kernels_outdated(native_files)
