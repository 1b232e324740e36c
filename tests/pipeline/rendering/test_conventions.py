"""The conventions that every render depends on; a failure here invalidates all existing renders."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from z2p_core.camera import Camera, light_position, turn
from z2p_core.images import linear_from_srgb, unit_from_bytes
from z2p_core.scene import SceneDescription
from z2p_renderer.pipeline.render import RenderSettings, render_scenes
from z2p_renderer.storage.meshes import write_mesh

pytestmark = pytest.mark.slow

BALLS = {(-1.0, 0.0, 0.0): 0.03, (1.0, 0.0, 0.0): 0.03, (0.05, -0.3, 0.6): 0.03, (-0.4, 0.5, -0.35): 0.03}
"""Centre -> radius; the two on the X axis make the bounding sphere that of radius 1 about the origin, nearly."""
GREY = {"Base Color": (0.2, 0.2, 0.2, 1.0)}
QUIET = RenderSettings((256, 256), samples=64, denoise="off", bounces=0, threads=2)
"""No bounces: the floor would light the ball from below."""


def ball(centre: tuple[float, float, float], radius: float, rings: int = 24) -> tuple[np.ndarray, np.ndarray]:
    theta, phi = np.meshgrid(np.linspace(0, math.pi, rings + 1), np.linspace(0, 2 * math.pi, 2 * rings, endpoint=False))
    vertices = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1).reshape(-1, 3)
    faces = []
    for j in range(2 * rings):
        for i in range(rings):
            a, b = j * (rings + 1) + i, (j + 1) % (2 * rings) * (rings + 1) + i
            faces += [(a, a + 1, b), (b, a + 1, b + 1)]
    return vertices * radius + centre, np.array(faces)


def write_balls(path: Path, balls: dict[tuple[float, float, float], float]) -> Path:
    vertices, faces, count = [], [], 0
    for centre, radius in balls.items():
        v, f = ball(centre, radius)
        vertices.append(v)
        faces.append(f + count)
        count += len(v)
    write_mesh(path, np.concatenate(vertices), np.concatenate(faces))
    return path


def picture(folder: Path, stem: str) -> tuple[np.ndarray, np.ndarray]:
    rgba = unit_from_bytes(np.asarray(Image.open(folder / f"{stem}.png")))
    return rgba, unit_from_bytes(np.asarray(Image.open(folder / f"{stem}.coverage.png")))


@pytest.mark.parametrize("resolution", [(256, 256), (300, 200), (160, 240)])
def test_blender_and_projection_agree_within_a_tenth_of_a_pixel(tmp_path: Path, resolution: tuple[int, int]) -> None:
    mesh = write_balls(tmp_path / "balls.ply", BALLS)
    rotation = turn(30.0)
    scenes = [
        (f"e{elevation}", SceneDescription(elevation=elevation, rotation=tuple(map(tuple, rotation.tolist()))))
        for elevation in (20.0, 65.0)
    ]
    render_scenes(mesh, scenes, tmp_path, replace(QUIET, resolution=resolution))
    scale = 1 / 1.03  # the outer balls' far sides touch the bounding sphere
    centres = np.array(list(BALLS)) * scale @ rotation.T
    for stem, scene in scenes:
        rgba, coverage = picture(tmp_path, stem)
        camera = Camera(*resolution, scene.elevation)
        expected, _ = camera.project(centres)
        rows, columns = np.mgrid[: resolution[1], : resolution[0]] + 0.5
        for x, y in expected:
            near = coverage * (np.hypot(columns - x, rows - y) < 0.06 * camera.focal / 2.5)
            centroid = np.array([(near * columns).sum(), (near * rows).sum()]) / near.sum()
            assert np.abs(centroid - (x, y)).max() < 0.1, (stem, x, y, centroid)
        assert rgba[coverage == 1.0][:, 3].min() == 1.0


def lambert_direction(rgba: np.ndarray, coverage: np.ndarray, camera: Camera, radius: float) -> np.ndarray:
    """Direction of the light, fitted as radiance = a + b (n . l) on the lit side of a grey ball at the origin.

    Its albedo is 0.2.
    The floor hides half the sky from below, so the ambient light of 0.35 reaches a normal n by (1 + n_z) / 2.
    """
    rows, columns = np.mgrid[: camera.height, : camera.width] + 0.5
    inverse = np.linalg.inv(camera.intrinsics)
    rays = np.stack([columns, rows, np.ones_like(rows)], -1) @ inverse.T @ camera.rotation
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    offset = camera.position
    b = rays @ offset
    root = b**2 - (offset @ offset - radius**2)
    hit = (root > 0) & (coverage == 1.0)
    distance = -b - np.sqrt(np.maximum(root, 0))
    normals = (camera.position + distance[..., None] * rays) / radius
    radiance = linear_from_srgb(rgba[..., 0]) - 0.2 * 0.35 * (1 + normals[..., 2]) / 2
    lit = hit & (radiance > np.median(radiance[hit]))
    fitted = np.linalg.lstsq(np.c_[normals[lit], np.ones(lit.sum())], radiance[lit], rcond=None)[0][:3]
    return fitted / np.linalg.norm(fitted)


@pytest.mark.parametrize("light", [(4.0, 0.0, 45.0), (4.0, 70.0, 40.0), (3.5, -60.0, 65.0)])
def test_light_comes_from_its_azimuth_and_elevation(tmp_path: Path, light: tuple[float, float, float]) -> None:
    radius = 0.25
    mesh = write_balls(tmp_path / "ball.ply", {(0.0, 0.0, 0.0): radius, (-0.999, 0, 0): 0.001, (0.999, 0, 0): 0.001})
    render_scenes(mesh, [("lit", SceneDescription(light=light, material=GREY))], tmp_path, QUIET)
    rgba, coverage = picture(tmp_path, "lit")
    fitted = lambert_direction(rgba, coverage, Camera(256, 256), radius)
    expected = light_position(light) / light[0]
    assert math.degrees(math.acos(min(1.0, float(fitted @ expected)))) < 2.0
    if light[1]:  # the shadow falls away from the light
        shadow = np.where(coverage == 0, rgba[..., 3], 0)
        columns = np.arange(256) + 0.5 - 128
        assert np.sign((shadow * columns).sum()) == -np.sign(light[1])


def test_radiance_is_that_of_the_stated_light_and_ambient(tmp_path: Path) -> None:
    corners = np.array([(-0.7, -0.7, 0), (0.7, -0.7, 0), (0.7, 0.7, 0), (-0.7, 0.7, 0)])
    write_mesh(tmp_path / "plate.ply", corners, np.array([(0, 1, 2), (0, 2, 3)]))
    light = (4.0, 0.0, 60.0)
    scene = SceneDescription(elevation=60.0, light=light, material=GREY, lift=0.05)
    render_scenes(tmp_path / "plate.ply", [("plate", scene)], tmp_path, QUIET)
    rgba, _ = picture(tmp_path, "plate")
    measured = linear_from_srgb(rgba[120:136, 120:136, :3]).mean()
    # irradiance of the 1.6 wide emitter of radiance 18 at the origin, by midpoints over its surface
    position = light_position(light)
    forward = -position / light[0]
    right = np.array([1.0, 0.0, 0.0])
    grid = (np.arange(16) + 0.5) / 16 * 1.6 - 0.8
    x, y = np.meshgrid(grid, grid)
    points = position + x[..., None] * right + y[..., None] * np.cross(right, forward)
    distance = np.linalg.norm(points, axis=-1)
    cosines = (points[..., 2] / distance) * (-points @ forward / distance)
    irradiance = 18.0 * (cosines / distance**2).sum() * (0.1**2)
    assert measured == pytest.approx(0.2 * (irradiance / math.pi + 0.35), rel=0.02)


def test_rendered_colours_match_the_configured_ones(tmp_path: Path) -> None:
    mesh = write_balls(tmp_path / "ball.ply", {(0.0, 0.0, 0.0): 1.0})
    srgb = np.array([0.85, 0.2, 0.45])
    colour = tuple(linear_from_srgb(srgb).tolist())
    dim = (4.5, 60.0, 30.0)  # so that nothing clips
    scenes = [
        ("grey", SceneDescription(light=dim, material={"Base Color": (0.3, 0.3, 0.3, 1.0)})),
        ("pink", SceneDescription(light=dim, material={"Base Color": (*colour, 1.0)})),
    ]
    render_scenes(mesh, scenes, tmp_path, RenderSettings((128, 128), samples=128, denoise="off", bounces=0, threads=2))
    grey, coverage = picture(tmp_path, "grey")
    pink, _ = picture(tmp_path, "pink")
    fair = (coverage == 1.0) & (grey[..., 0] > 0.3) & (pink[..., :3].max(-1) < 0.98)
    ratio = np.median(linear_from_srgb(pink[fair][:, :3]) / linear_from_srgb(grey[fair][:, :3]), axis=0) * 0.3
    assert fair.sum() > 500
    np.testing.assert_allclose(ratio, colour, rtol=0.05)


def test_floor_is_at_the_lowest_point_and_lift_raises_the_mesh(tmp_path: Path) -> None:
    mesh = write_balls(tmp_path / "ball.ply", {(0.0, 0.0, 0.0): 1.0})
    scenes = [("down", SceneDescription()), ("up", SceneDescription(lift=0.3))]
    render_scenes(mesh, scenes, tmp_path, RenderSettings((128, 128), samples=16, denoise="off", threads=2))
    (down, covered), (up, covered_up) = picture(tmp_path, "down"), picture(tmp_path, "up")
    rows = np.arange(128)[:, None]
    rise = (covered * rows).sum() / covered.sum() - (covered_up * rows).sum() / covered_up.sum()
    assert 10 < rise < 30
    contact = np.argmax(np.where(covered.max(1) > 0.5, np.arange(128), 0))
    # under a ball that rests on the floor the shadow begins at once; under a lifted one it is softer
    assert down[contact + 2, 60:68, 3].mean() > up[contact + 2, 60:68, 3].mean()


def test_existing_renders_are_kept_and_seeds_repeat(tmp_path: Path) -> None:
    mesh = write_balls(tmp_path / "ball.ply", {(0.0, 0.0, 0.0): 1.0})
    tiny = RenderSettings((32, 32), samples=1, denoise="off", passes=("depth", "normal", "shadow"), threads=1)
    both = [("a", SceneDescription()), ("b", SceneDescription(elevation=40.0))]
    render_scenes(mesh, both[:1], tmp_path / "x", tiny)
    kept = (tmp_path / "x" / "a.png").stat().st_mtime_ns
    render_scenes(mesh, both, tmp_path / "x", tiny)
    assert (tmp_path / "x" / "a.png").stat().st_mtime_ns == kept
    render_scenes(mesh, both, tmp_path / "y", tiny)
    for name in ("a.png", "b.png", "a.coverage.png", "b.coverage.png"):
        assert (tmp_path / "x" / name).read_bytes() == (tmp_path / "y" / name).read_bytes()
    with np.load(tmp_path / "x" / "a.passes.npz") as passes:
        coverage = unit_from_bytes(np.asarray(Image.open(tmp_path / "x" / "a.coverage.png")))
        assert passes["depth"].shape == (32, 32) and passes["shadow"].shape == (32, 32, 3)
        inside = coverage == 1.0
        assert 2.5 < passes["depth"][inside].min() < 2.8
        np.testing.assert_allclose(np.linalg.norm(passes["normal"][inside].astype(float), axis=-1), 1, atol=0.1)
    assert not list(tmp_path.glob("x/.*"))


def test_a_sheet_that_lies_on_the_floor_is_lit(tmp_path: Path) -> None:
    corners = np.array([(-0.7, -0.7, 0), (0.7, -0.7, 0), (0.7, 0.7, 0), (-0.7, 0.7, 0)])
    write_mesh(tmp_path / "sheet.ply", corners, np.array([(0, 1, 2), (0, 2, 3)]))
    scene = SceneDescription(elevation=50.0, material=GREY)
    render_scenes(tmp_path / "sheet.ply", [("sheet", scene)], tmp_path, RenderSettings((64, 64), 8, "off", threads=1))
    rgba, coverage = picture(tmp_path, "sheet")
    assert rgba[coverage == 1.0][:, :3].min() > 0.3


def test_a_material_input_does_not_linger_in_the_next_scene(tmp_path: Path) -> None:
    mesh = write_balls(tmp_path / "ball.ply", {(0.0, 0.0, 0.0): 1.0})
    plain, glowing = SceneDescription(), SceneDescription(material={"Emission Strength": 5.0})
    tiny = RenderSettings((32, 32), samples=4, denoise="off", threads=1)
    render_scenes(mesh, [("glowing", glowing), ("plain", plain)], tmp_path / "after", tiny)
    render_scenes(mesh, [("plain", plain)], tmp_path / "alone", tiny)
    assert (tmp_path / "after" / "plain.png").read_bytes() == (tmp_path / "alone" / "plain.png").read_bytes()
    glow, coverage = picture(tmp_path / "after", "glowing")
    dull, _ = picture(tmp_path / "alone", "plain")
    assert glow[coverage == 1.0].mean() > dull[coverage == 1.0].mean() + 0.05
