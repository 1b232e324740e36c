"""Samples points on meshes: the pool that training draws clouds from, and single clouds for evaluation."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from z2p_core import registry
from z2p_core.config import SampleConfig
from z2p_core.interfaces import Sampler, ScanError
from z2p_core.meshes.synthetic_noise import add_noise
from z2p_core.placement.bounding_sphere import Sphere, bounding_sphere
from z2p_renderer.storage.meshes import Mesh, read_mesh
from z2p_renderer.storage.results.fingerprints import file_digest


def sample_pool(mesh_path: Path, config: SampleConfig, seed: int, out: Path) -> Path:
    """Writes ``out/pool.npy``: points (P, 3) float32 on the mesh, whose bounding sphere is scaled to the unit sphere.

    The pool gives a new random cloud for every sample, where the paper trains on ten fixed clouds per render. The
    points depend on the mesh's bytes, the config and the seed, not on the file's name or on other meshes.

    Raises:
        ScanError: the mesh cannot be read, or `config.points` is below 1.
        PluginError: the sampler is unknown or broken.
    """
    rng = np.random.default_rng([seed, int(file_digest(mesh_path)[:16], 16)])
    mesh = read_mesh(mesh_path)
    pool = sample_cloud(mesh, bounding_sphere(mesh.vertices), config.sampler, config.points, "none", 0.0, rng)
    out.mkdir(parents=True, exist_ok=True)
    np.save(out / "pool.npy", pool, allow_pickle=False)
    return out / "pool.npy"


def sample_cloud(
    mesh: Mesh,
    sphere: Sphere,
    sampler_name: str,
    count: int,
    noise_kind: str,
    noise_scale: float,
    rng: np.random.Generator,
) -> np.ndarray:
    """Cloud (count, 3) float32 sampled on the mesh, normalised by the mesh's bounding `sphere`, plus noise.

    The cloud's own bounding sphere would shift it by pixels against the render. `noise_scale` is in radii.

    Raises:
        ScanError: the mesh has no area, or `count` is below 1.
        PluginError: the sampler is unknown or broken.
        ValueError: an unknown kind of noise.
    """
    sampler: Sampler = registry.load("samplers", sampler_name)()
    if count < 1:
        raise ScanError(f"points: expected at least 1, got {count}")
    points = sampler.sample(mesh.vertices, mesh.faces, count, rng)
    if points.shape != (count, 3) or not np.isfinite(points).all():
        raise registry.PluginError(
            f"sampler {sampler_name!r}: expected {count} finite points ({count}, 3), got {points.shape}"
        )
    return add_noise(sphere.normalise(points), noise_kind, noise_scale, rng)
