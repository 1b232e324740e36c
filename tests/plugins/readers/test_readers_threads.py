"""Files read in several threads of a process that has read none before."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

READ_AT_ONCE = """
import sys, threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from z2p_renderer.plugins.readers.meshes import Meshes
paths = sorted(Path(sys.argv[1]).iterdir())
begin = threading.Barrier(len(paths))
sys.setswitchinterval(1e-5)

def read(path):
    begin.wait()
    return Meshes().read(path)

with ThreadPoolExecutor(len(paths)) as pool:
    print([len(clouds[0].points) for clouds in pool.map(read, paths)])
"""


def test_meshes_can_be_read_in_parallel_at_first_import(tmp_path: Path) -> None:
    import trimesh

    for name in ("a.glb", "b.glb", "c.stl"):
        trimesh.creation.box().export(tmp_path / name)
    for _ in range(3):  # when two threads enter the library at once is chance; without the lock, four of five times
        done = subprocess.run([sys.executable, "-c", READ_AT_ONCE, tmp_path], capture_output=True, text=True)
        assert done.stdout == "[8, 8, 8]\n", done.stderr


def test_a_missing_library_is_not_blamed_on_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from z2p_renderer.plugins.readers.meshes import Meshes

    stl = tmp_path / "a.stl"
    stl.write_bytes(bytes(80) + b"\x01\0\0\0" + bytes(50))
    for name in ("trimesh", "trimesh.exchange.stl"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(ImportError):
        Meshes().read(stl)
