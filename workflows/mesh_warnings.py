"""Warnings about defects of a mesh that do not prevent its use."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from z2p_renderer.storage.meshes import read_mesh


def mesh_warnings(path: Path) -> list[str]:
    """Warnings about the mesh in a file; an empty list for a manifold mesh.

    Raises:
        ScanError: the mesh cannot be read.
    """
    count = count_non_manifold_edges(read_mesh(path).faces)
    if not count:
        return []
    return [f"{path.name}: not manifold, {count} edges belong to more than two faces; its inside is undefined there"]


def count_non_manifold_edges(faces: np.ndarray) -> int:
    """Number of edges that belong to more than two of the triangles `faces` (M, 3) int."""
    ends = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    _, counts = np.unique(ends, axis=0, return_counts=True)
    return int((counts > 2).sum())
