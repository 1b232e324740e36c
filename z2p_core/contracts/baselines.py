"""Checks of `Baseline` and `Painter` plugins."""

from __future__ import annotations

import copy

import numpy as np

from z2p_core.camera import Camera
from z2p_core.contracts.assertions import check_array, check_class, expect, refuses, same
from z2p_core.interfaces import Baseline, Painter, ScanError
from z2p_core.scene import SceneDescription

RED = np.array([0.7, 0.1, 0.1], np.float32)
"""Linear color of points that methods are tried on."""
BLUE = np.array([0.1, 0.1, 0.7], np.float32)


def check_baseline(baseline_class: type[Baseline]) -> None:
    """None when the class keeps what `Baseline` promises: a mesh where the cloud is, the same one every time.

    Raises:
        AssertionError: it does not; the message says what was expected and what came.
    """
    check_class("baselines", baseline_class, Baseline)
    baseline, name = baseline_class(), baseline_class.name
    cloud = _sphere(800)
    given = cloud.copy()
    vertices, faces = baseline.reconstruct(cloud, np.random.default_rng(1))
    check_array(vertices, (len(vertices), 3), np.float64, f"{name}: vertices")
    whole = isinstance(faces, np.ndarray) and np.issubdtype(faces.dtype, np.integer)
    expect(whole and faces.ndim == 2 and faces.shape[1] == 3 and len(faces) > 0,
           f"{name}: expected triangles (M, 3) int, M >= 1, got {faces!r}")  # fmt: skip
    known = faces.min() >= 0 and faces.max() < len(vertices)
    expect(bool(known), f"{name}: triangles use vertices {faces.min()} to {faces.max()}, there are {len(vertices)}")
    off = np.abs(np.linalg.norm(vertices[faces.ravel()], axis=1) - 0.9).max()
    expect(off < 0.2, f"{name}: a vertex lies {off:.2g} off the sphere that the cloud is on")
    seen = baseline.reconstruct_for(cloud, Camera(1, 1).position, np.random.default_rng(1))
    expect(len(seen[1]) > 0, f"{name}: reconstruct_for gives no triangle")
    again = baseline.reconstruct(cloud, np.random.default_rng(1))
    same(again[0], vertices, f"{name}: the same cloud and rng, vertices")
    same(again[1], faces, f"{name}: the same cloud and rng, triangles")
    same(cloud, given, f"{name}: the cloud given to reconstruct")
    _check_vertex_colors(baseline, cloud)
    refuses(lambda: baseline.reconstruct(cloud[:0], np.random.default_rng(1)), ScanError, f"{name}: an empty cloud")


def check_painter(painter_class: type[Painter]) -> None:
    """None when the class keeps what `Painter` promises: the object where the cloud is, the same picture every time.

    Raises:
        AssertionError: it does not; the message says what was expected and what came.
    """
    check_class("painters", painter_class, Painter)
    painter, name, scene = painter_class(), painter_class.name, SceneDescription()
    cloud, camera, described = _sphere(2000).astype(np.float32), Camera(80, 64), copy.deepcopy(scene)
    given = cloud.copy()
    picture = painter.paint(cloud, camera, scene)
    check_array(picture, (64, 80, 4), np.float32, f"{name}: paint")
    expect(bool(picture.min() >= 0 and picture.max() <= 1), f"{name}: expected values in [0, 1]")
    expect(bool(picture[32, 40, 3] > 0.5), f"{name}: expected the sphere in the middle, got alpha {picture[32, 40, 3]}")
    expect(bool(picture[:4, :4, 3].max() < 0.1), f"{name}: expected nothing in the corner above the object")
    same(painter_class().paint(cloud, camera, scene), picture, f"{name}: the same cloud painted twice")
    same(cloud, given, f"{name}: the cloud given to paint")
    colored = painter.paint_colored(cloud, np.tile(RED, (len(cloud), 1)), camera, scene)
    check_array(colored, (64, 80, 4), np.float32, f"{name}: paint_colored")
    red, green, _ = colored[32, 40, :3]
    expect(bool(red > green), f"{name}: expected a red sphere from red points, got {colored[32, 40]}")
    same(colored[..., 3], picture[..., 3], f"{name}: the same cloud with colors, alpha")
    expect(scene == described, f"{name}: paint changes the scene given to it")
    refuses(lambda: painter.paint(cloud[:0], camera, scene), ScanError, f"{name}: an empty cloud")


def _check_vertex_colors(baseline: Baseline, cloud: np.ndarray) -> None:
    """None when a cloud that is red on top and blue below gives a mesh with the same colors there."""
    name, viewer = baseline.name, Camera(1, 1).position
    albedo = np.where(cloud[:, 2:] > 0, RED, BLUE)
    vertices, faces, colors = baseline.reconstruct_colored(cloud, albedo, viewer, np.random.default_rng(1))
    plain = baseline.reconstruct_for(cloud, viewer, np.random.default_rng(1))
    same(vertices, plain[0], f"{name}: the same cloud with colors, vertices")
    same(faces, plain[1], f"{name}: the same cloud with colors, triangles")
    check_array(colors, vertices.shape, np.float32, f"{name}: reconstruct_colored")
    expect(bool(colors.min() >= 0 and colors.max() <= 1), f"{name}: expected colors in [0, 1]")
    for color, is_there in ((RED, vertices[:, 2] > 0.3), (BLUE, vertices[:, 2] < -0.3)):
        off = np.abs(colors[is_there] - color).max() if is_there.any() else 0.0
        expect(bool(off < 0.1), f"{name}: a vertex far inside points of one color has another one, off by {off:.2g}")


def _sphere(count: int) -> np.ndarray:
    """Points (count, 3) float64 on a sphere of radius 0.9."""
    directions = np.random.default_rng(0).normal(size=(count, 3))
    return 0.9 * directions / np.linalg.norm(directions, axis=1, keepdims=True)
