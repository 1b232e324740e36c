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
from z2p_renderer.plugins.readers.vertices import Vertices
paths = sorted(Path(sys.argv[1]).iterdir())
begin = threading.Barrier(len(paths))
sys.setswitchinterval(1e-5)

def read(path):
    begin.wait()
    return (Vertices() if path.suffix == ".off" else Meshes()).read(path)

with ThreadPoolExecutor(len(paths)) as pool:
    print([len(clouds[0]) if path.suffix == ".off" else len(clouds[0].points)
           for path, clouds in zip(paths, pool.map(read, paths))])
"""


def test_meshes_of_several_formats_are_read_at_once_in_a_fresh_process(tmp_path: Path) -> None:
    import trimesh

    for suffix in ("glb", "off", "stl"):
        trimesh.creation.box().export(tmp_path / f"box.{suffix}")
    for _ in range(3):  # when two threads enter the library at once is chance; without the lock, four of five times
        done = subprocess.run([sys.executable, "-c", READ_AT_ONCE, tmp_path], capture_output=True, text=True)
        assert done.stdout == "[8, 8, 8]\n", done.stderr


def test_a_library_that_is_not_there_is_no_fault_of_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from z2p_renderer.plugins.readers.meshes import Meshes
    from z2p_renderer.plugins.readers.vertices import Vertices

    stl, off = tmp_path / "a.stl", tmp_path / "a.off"
    stl.write_bytes(bytes(80) + b"\x01\0\0\0" + bytes(50))
    off.write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n")
    for name in ("trimesh", "trimesh.exchange.stl", "trimesh.exchange.off"):
        monkeypatch.setitem(sys.modules, name, None)
    for reader, path in ((Meshes(), stl), (Vertices(), off)):
        with pytest.raises(ImportError):
            reader.read(path)
