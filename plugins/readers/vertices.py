"""Vertices of OBJ and OFF files, those that no face uses included."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np

from z2p_core.interfaces import MEMORY_A_CHARACTER, Reader, ScanError
from z2p_renderer.plugins.readers.late import late


class Vertices(Reader):
    """Wavefront OBJ and OFF; faces, textures and colours are left out."""

    name = "vertices"
    version = "1"
    packages = ("trimesh",)
    suffixes = (".obj", ".off")

    def memory(self, path: Path) -> int:
        """Text is read as a whole."""
        return MEMORY_A_CHARACTER * path.stat().st_size

    def read(self, path: Path) -> list[np.ndarray]:
        """The file's vertices, one cloud (N, 3) float64.

        Raises:
            ScanError: no file of its format, or not the vertices that its first line promises (OFF).
        """
        blob = path.read_bytes()
        return [_obj(blob) if path.suffix.lower() == ".obj" else _off(blob)]


def _obj(blob: bytes) -> np.ndarray:
    """Points of the ``v`` lines; trimesh would drop vertices without a face and double those on texture seams."""
    whole = blob.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ")  # a line goes on after a backslash
    rows = [line.split()[1:4] for line in whole.splitlines() if line.lstrip()[:2] in (b"v ", b"v\t")]
    if not rows and blob.strip():
        raise ScanError("expected OBJ vertices (lines 'v x y z'), found none; this is another format under that name, "
                        "or it holds no points")
    try:
        return np.array(rows, dtype=np.float64).reshape(len(rows), 3)
    except ValueError as error:
        raise ScanError(f"expected three numbers on each OBJ line 'v x y z': {_first_line(error)}; "
                        "export it again") from error


def _off(blob: bytes) -> np.ndarray:
    """Points of an OFF file; trimesh checks them against the promised count."""
    if b"OFF" not in blob[:1024]:
        raise ScanError("expected an OFF file, which begins with 'OFF'; this is another format under that name")
    load_off = late("trimesh.exchange.off").load_off
    try:
        return np.asarray(load_off(io.BytesIO(blob))["vertices"], dtype=np.float64).reshape(-1, 3)
    except Exception as error:  # the library raises whatever its parsing stumbles over
        raise ScanError(f"the OFF vertices cannot be read ({_first_line(error)}); export the file again") from error


def _first_line(error: Exception) -> str:
    return str(error).partition("\n")[0][:160]
