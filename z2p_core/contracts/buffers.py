"""Checks of `ZBuffer` and `GBuffer` plugins."""

from __future__ import annotations

import numpy as np

from z2p_core.camera import Camera
from z2p_core.contracts.assertions import check_array, check_class, expect, same
from z2p_core.interfaces import GBuffer, PointColors, ZBuffer
from z2p_core.scene import SceneDescription


def check_zbuffer(zbuffer_class: type[ZBuffer]) -> None:
    """None when the class keeps what `ZBuffer` promises: the nearest point wins, in any order, on a 0 background.

    Raises:
        AssertionError: it does not; the message says what was expected and what came.
    """
    check_class("zbuffers", zbuffer_class, ZBuffer)
    zbuffer, name = zbuffer_class(), zbuffer_class.name
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(400, 3))
    cloud = (directions / np.linalg.norm(directions, axis=1, keepdims=True)).astype(np.float32)
    given = cloud.copy()
    for width, height in ((64, 64), (80, 48)):
        camera = Camera(width, height)
        picture = zbuffer.draw(cloud, camera)
        check_array(picture, (zbuffer.channels, height, width), np.float32, f"{name}: draw")
        expect(bool(picture.any()), f"{name}: draw gives an empty picture for a cloud of {len(cloud)} points")
        same(zbuffer.draw(cloud, camera), picture, f"{name}: the same cloud drawn twice")
        same(zbuffer.draw(cloud[rng.permutation(len(cloud))], camera), picture, f"{name}: points in another order")
        drawn = np.full_like(picture, np.nan)
        zbuffer.draw_into(drawn, cloud, camera)
        same(drawn, picture, f"{name}: draw_into, whatever was there before")
    same(cloud, given, f"{name}: the cloud given to draw")
    _check_nearest_wins(zbuffer)


def _check_nearest_wins(zbuffer: ZBuffer) -> None:
    """On one pixel's ray, what lies behind a point does not show; away from it nothing does."""
    camera, row, column = Camera(96, 96), 40, 52
    ray = camera.rotation.T @ np.linalg.inv(camera.intrinsics) @ np.array([column + 0.5, row + 0.5, 1.0])
    near, far = ((camera.position + depth * ray)[None].astype(np.float32) for depth in (3.0, 4.2))
    alone = zbuffer.draw(near, camera)
    name = zbuffer.name
    expect(bool(alone[:, row, column].any()), f"{name}: a point does not show in its own pixel")
    for both in ([near, far], [far, near]):
        pixel = zbuffer.draw(np.concatenate(both), camera)[:, row, column]
        same(pixel, alone[:, row, column], f"{name}: a pixel with a second point behind its nearest")
    for corner in ((0, 0), (0, -1), (-1, 0), (-1, -1)):
        expect(not alone[:, *corner].any(), f"{name}: expected 0 where no point is near, got {alone[:, *corner]}")
    outside = (camera.position + 3.0 * (camera.rotation[2] + 5 * camera.rotation[0]))[None].astype(np.float32)
    expect(not zbuffer.draw(outside, camera).any(), f"{name}: a point outside the picture shows in it")


def check_gbuffer(gbuffer_class: type[GBuffer]) -> None:
    """None when the class keeps what `GBuffer` promises: finite channels that do not depend on the points' order.

    Raises:
        AssertionError: it does not; the message says what was expected and what came.
    """
    check_class("gbuffers", gbuffer_class, GBuffer)
    gbuffer, name = gbuffer_class(), gbuffer_class.name
    rng, scene = np.random.default_rng(0), SceneDescription()
    directions = rng.normal(size=(400, 3))
    sphere = (directions / np.linalg.norm(directions, axis=1, keepdims=True)).astype(np.float32)
    clouds = {"no point": sphere[:0], "one point": sphere[:1], "a point twice": sphere[[0, 0]], "a sphere": sphere}
    given = {what: cloud.copy() for what, cloud in clouds.items()}
    for width, height in ((64, 64), (80, 48)):
        camera = Camera(width, height)
        for what, cloud in clouds.items():
            picture = gbuffer.draw(cloud, camera, scene)
            check_array(picture, (gbuffer.channels, height, width), np.float32, f"{name}: draw of {what}")
            same(gbuffer.draw(cloud, camera, scene), picture, f"{name}: {what} drawn twice")
            shuffled = cloud[rng.permutation(len(cloud))]
            same(gbuffer.draw(shuffled, camera, scene), picture, f"{name}: {what}, points in another order")
            drawn = np.full_like(picture, np.nan)
            gbuffer.draw_into(drawn, cloud, camera, scene)
            same(drawn, picture, f"{name}: draw_into of {what}, whatever was there before")
            if (beside := gbuffer.elsewhere(picture, 10_000)) is not None:
                check_array(beside[0], (height, width), np.float32, f"{name}: where to draw {what}")
                check_array(beside[1], (4, height, width), np.float32, f"{name}: picture elsewhere than {what}")
    for what, cloud in clouds.items():
        same(cloud, given[what], f"{name}: the cloud given to draw, {what}")
    if gbuffer.draws_textures:
        _check_textures(gbuffer, sphere, scene)
    expect(scene == SceneDescription(), f"{name}: draw changes the scene given to it")


def _check_textures(gbuffer: GBuffer, cloud: np.ndarray, scene: SceneDescription) -> None:
    """The features are those of the cloud in one color, and colors twice as dark send about half as much light."""
    camera, name = Camera(64, 64), gbuffer.name
    bright = np.full((len(cloud), 3), 0.6, np.float32)
    relative = []
    for albedo in (bright, bright / 2):
        features = np.full((gbuffer.channels, 64, 64), np.nan, np.float32)
        colors = PointColors(cloud, albedo)
        relative.append(gbuffer.draw_textured_into(features, cloud, colors, camera, scene))
        plain = gbuffer.draw(cloud, camera, scene)
        changed = [channel for channel in range(gbuffer.channels)
                   if not np.array_equal(features[channel], plain[channel])]  # fmt: skip
        expect(len(changed) <= 1, f"{name}: draw_textured_into writes other channels {changed} than draw, expected the "
                                  "same but for one of the floor's light")  # fmt: skip
        check_array(relative[-1], (4, 64, 64), np.float32, f"{name}: draw_textured_into")
    covered = relative[0][3] > 0.5
    expect(bool(covered.any()), f"{name}: draw_textured_into covers no pixel")
    ratio = float(np.median(relative[1][0, covered] / relative[0][0, covered]))
    expect(0.3 < ratio < 0.6, f"{name}: colors half as bright send {ratio:.2f} of the light, expected about a half")
