"""Calibration inputs for int8 quantisation: random clouds and views of the built-in shapes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from z2p_core.meshes.synthetic_noise import add_noise
from z2p_core.meshes.triangle_sampling import sample_uniform
from z2p_core.placement.bounding_sphere import bounding_sphere
from z2p_renderer.pipeline.export.graph_rewrite import EngineInputs
from z2p_renderer.pipeline.inference.renderer import Renderer
from z2p_renderer.pipeline.rendering.views import place_in_scene, sample_view
from z2p_renderer.pipeline.shapes import SUZANNE, TRAINING_SHAPES, shape

POINT_RANGE = 1_000, 20_000
"""Fewest and most points of a cloud, log-uniform."""
IMAGE_SIDE = 256
"""Side of the images, pixels; onnxruntime needs one size for all."""
NOISY_SHARE = 1 / 3
"""Share of the clouds that get noise, as real scans have it."""
MAX_NOISE = 0.02
"""Largest standard deviation of the noise, in units of the shape's radius."""


def calibration_inputs(renderer: Renderer, count: int, rng: np.random.Generator) -> Iterator[EngineInputs]:
    """Engine inputs for `count` random views of the built-in shapes; controls are sampled as for training."""
    names = [name for name in TRAINING_SHAPES if name != SUZANNE]  # Suzanne would need Blender
    for index in range(count):
        view = sample_view(renderer.controls, rng, upright=0.5)
        if renderer.fixed_elevation is not None:
            view.scene.elevation = renderer.fixed_elevation
        vertices, faces = shape(names[index % len(names)])
        points = round(np.exp(rng.uniform(*np.log(POINT_RANGE))))
        cloud = bounding_sphere(vertices).normalise(sample_uniform(vertices, faces, points, rng))
        noisy = add_noise(cloud, "gaussian", rng.uniform(0, MAX_NOISE) if rng.random() < NOISY_SHARE else 0.0, rng)
        yield renderer.inputs(place_in_scene(noisy, view.scene), view.values, IMAGE_SIDE, IMAGE_SIDE)
