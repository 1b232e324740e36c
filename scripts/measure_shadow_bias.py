"""Measures the shadow bias of renders with few samples: how much they darken faint shadows on the floor.

    python scripts/measure_shadow_bias.py [--mesh FILE] [--samples 16] [--denoise fast] [--bounces 3] [--views 4]

Needs the pipeline extra, and minutes. Compares with renders of many samples, and prints the error of alpha for several
ranges of alpha, before and after the correction with `train.haze` (`pipeline.training.shadow_debias`).
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np
import torch

from z2p_core.images import bytes_from_unit, unit_from_bytes
from z2p_core.placement.bounding_sphere import bounding_sphere
from z2p_renderer.pipeline.render import RenderSettings, export_suzanne, read_render, render_mesh
from z2p_renderer.pipeline.rendering.views import load_controls, sample_view
from z2p_renderer.pipeline.training.make_shard import downsample_images
from z2p_renderer.pipeline.training.shadow_debias import remove_shadow_bias
from z2p_renderer.storage.meshes import Mesh, read_mesh

ALPHA_EDGES = (0.0, 0.0015, 0.0045, 0.0065, 0.01, 0.02, 0.03, 0.05, 0.08, 0.12, 0.3, 1.0)


def main() -> None:
    """Renders the views with few and many samples, and prints the errors of the former."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mesh", type=Path, help="a mesh file; Blender's monkey without it")
    parser.add_argument("--samples", type=int, default=16)
    parser.add_argument("--denoise", default="fast")
    parser.add_argument("--bounces", type=int, default=3)
    parser.add_argument("--resolution", type=int, default=512, help="of the noisy renders; others are half as large")
    parser.add_argument("--views", type=int, default=4)
    parser.add_argument("--many", type=int, default=1024, help="samples of the renders that they are compared with")
    parser.add_argument("--haze", type=float, default=0.0025)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        noisy, clean = _floor_alphas(options, Path(folder))
    picture = torch.from_numpy(noisy).expand(1, 4, 1, -1)
    remaining = remove_shadow_bias(picture, torch.zeros(1, 1, 1, len(noisy)), options.haze)[0, 3, 0].numpy() - clean
    print(f"{'alpha':>14}{'share':>8}{'too dark by':>13}{'without haze':>14}")
    for low, high in zip((-1.0, *ALPHA_EDGES), ALPHA_EDGES, strict=False):
        in_range = (noisy > low) & (noisy <= high)
        if in_range.any():
            print(
                f"{max(low, 0):7.4f}-{high:6.4f}{in_range.mean():8.3f}{(noisy - clean)[in_range].mean():+13.5f}"
                f"{remaining[in_range].mean():+14.5f}"
            )
    print(f"{'all':>14}{1:8.3f}{(noisy - clean).mean():+13.5f}{remaining.mean():+14.5f}")


def _floor_alphas(options: argparse.Namespace, folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Alphas (N,) of the floor's pixels in the noisy renders, downsampled, and in those of many samples."""
    controls, rng = load_controls(("color", "light", "elevation")), np.random.default_rng(0)
    scenes = [(f"view_{number}", sample_view(controls, rng, upright=0.5).scene) for number in range(options.views)]
    side = options.resolution
    few = RenderSettings((side, side), options.samples, options.denoise, options.bounces)
    many = RenderSettings((side // 2, side // 2), options.many, "off", options.bounces)
    mesh = read_mesh(options.mesh) if options.mesh else _suzanne(folder)
    placed = Mesh(bounding_sphere(mesh.vertices).normalise(mesh.vertices), mesh.faces, mesh.smooth)
    pairs = []
    for name, settings in (("few", few), ("many", many)):
        render_mesh(placed, scenes, folder / name, settings)
        alphas = [_alphas(folder / name / f"{stem}.png", settings, side // 2) for stem, _ in scenes]
        pairs.append(np.concatenate(alphas))
    on_floor = (pairs[0][:, 1] == 0) & (pairs[1][:, 1] == 0)
    return pairs[0][on_floor, 0], pairs[1][on_floor, 0]


def _alphas(path: Path, settings: RenderSettings, side: int) -> np.ndarray:
    """Alpha and coverage (side * side, 2) of a downsampled render."""
    shape = settings.resolution[::-1]
    rgba, coverage = read_render(path, (*shape, 4)), read_render(path.with_suffix(".coverage.png"), shape)
    rgba, coverage = downsample_images(bytes_from_unit(rgba), bytes_from_unit(coverage), shape[0] // side)
    return unit_from_bytes(np.stack([rgba[..., 3], coverage], axis=-1)).reshape(-1, 2)


def _suzanne(folder: Path) -> Mesh:
    export_suzanne(folder / "suzanne.npz")
    with np.load(folder / "suzanne.npz") as arrays:
        vertices, faces = arrays["vertices"].astype(float), arrays["faces"]
    return Mesh(vertices, faces, smooth=True)


if __name__ == "__main__":
    main()
