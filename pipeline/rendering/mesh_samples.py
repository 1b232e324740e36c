"""Points on meshes: the pool that training draws its clouds from, and single clouds for evaluation."""

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
    """``out/pool.npy``: points (P, 3) float32 on the mesh, in the unit sphere (the mesh's bounding sphere, scaled).

    One render and this pool give endless clouds, where the paper's training has ten fixed ones a render. The points
    follow from the mesh's bytes, the config and the seed, not from the file's name or from other meshes.

    Raises:
        ScanError: the mesh cannot be read, or fewer than 1 point is asked for.
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
    """Cloud (count, 3) float32 on the mesh, normalised by the mesh's own `sphere`, then noisy.

    A cloud's own sphere would shift it by pixels against the render. The noise's scale is in units of the radius.

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
