"""Which reader takes a file: by its suffix, without importing the others."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from z2p_core import registry
from z2p_core.interfaces import Reader, ScanError
from z2p_renderer.storage.scans.reader_choice import BUILTIN_SUFFIXES, reader_for


def test_builtin_suffixes_match_those_of_the_readers() -> None:
    ours = [name for name in registry.names("readers") if registry.is_builtin("readers", name)]
    assert {name: set(registry.load("readers", name).suffixes) for name in ours} == {
        name: set(suffixes) for name, suffixes in BUILTIN_SUFFIXES.items()
    }


def test_one_file_needs_one_reader() -> None:
    code = ("import sys; from pathlib import Path; from z2p_renderer.storage.scans.reader_choice import reader_for\n"
            "reader_for(Path('a.off')); reader_for(Path('b.off.gz'))\n"
            "print(*(name for name in sys.modules if name.startswith('z2p_renderer.plugins.readers.')))")  # fmt: skip
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = {name.rpartition(".")[2] for name in done.stdout.split()}
    assert "vertices" in loaded and not {"ply", "las", "text", "pcd"} & loaded


def test_a_plugin_claiming_a_builtin_suffix_is_detected(monkeypatch: pytest.MonkeyPatch) -> None:
    class Theirs(Reader):
        suffixes = (".off", ".theirs")

    names, load = registry.names, registry.load
    monkeypatch.setattr(registry, "names", lambda group: sorted([*names(group), "theirs"]))
    monkeypatch.setattr(registry, "load", lambda group, name: Theirs if name == "theirs" else load(group, name))
    with pytest.raises(ScanError, match=r"\.off is claimed by the readers theirs and vertices"):
        reader_for(Path("a.off"))
    with pytest.raises(ScanError, match=r"no reader for '\.nobodys'; readable: .*\.theirs"):
        reader_for(Path("a.nobodys"))
    with pytest.raises(TypeError, match="Theirs"):  # found, though it is too abstract to be made
        reader_for(Path("a.theirs"))
