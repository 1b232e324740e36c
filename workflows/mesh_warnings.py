"""What is odd about a mesh and yet no reason to refuse it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from z2p_renderer.storage.meshes import read_mesh


def mesh_warnings(path: Path) -> list[str]:
    """Sentences about a mesh, none for a usual one.

    Raises:
        ScanError: the mesh cannot be read.
    """
    crowded = count_non_manifold_edges(read_mesh(path).faces)
    if not crowded:
        return []
    return [f"{path.name}: not manifold, {crowded} edges belong to more than two faces; its inside is undefined there"]


def count_non_manifold_edges(faces: np.ndarray) -> int:
    """How many edges of triangles (M, 3) int belong to more than two of them."""
    ends = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    _, counts = np.unique(ends, axis=0, return_counts=True)
    return int((counts > 2).sum())
