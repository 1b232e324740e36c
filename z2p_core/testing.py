"""Contract suite for plugins: each `check_*` raises AssertionError, saying what is wrong, or returns None.

The built-in plugins pass it; run it on yours from any test runner:

    from z2p_core.testing import check_control

    def test_contract():
        check_control(MyControl)
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from z2p_core.camera import Camera
from z2p_core.contracts.assertions import check_array, check_class, expect, plain_json, refuses, same
from z2p_core.contracts.baseline_checks import check_baseline as check_baseline
from z2p_core.contracts.baseline_checks import check_painter as check_painter
from z2p_core.contracts.engine_checks import check_engine as check_engine
from z2p_core.interfaces import (
    Control,
    GBuffer,
    PositionalEncoder,
    RawCloud,
    Reader,
    Sampler,
    ScanError,
    Sensor,
    SettingError,
    Value,
    ZBuffer,
)
from z2p_core.scene import SceneDescription

DRAWS = 50
"""How many random values a control is tried on."""


def check_control(control_class: type[Control]) -> None:
    """None when the class keeps what `Control` promises.

    Raises:
        AssertionError: it does not; the message says what was expected and what came.
    """
    check_class("controls", control_class, Control)
    control = control_class()
    slider = control.slider
    for component, low, high in zip(slider.components, slider.low, slider.high, strict=True):
        expect(low < high, f"{control.name}: {component} needs a range, got low {low} and high {high}")
    _accepts(control, slider.default, "its default")
    values = _check_draws(control)
    ends = [slider.low, slider.high, slider.default]
    encodings = {_check_encoding(control, value) for value in [*values, *ends]}
    expect(len(encodings) > 1, f"{control.name}: encode gives {encodings} for every value, so nothing is steered")
    _check_parse(control)
    scenes = [_check_apply(control, value) for value in [*values, *ends]]
    expect(any(scene != scenes[0] for scene in scenes), f"{control.name}: apply changes the scene for no value")


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
    expect(scene == SceneDescription(), f"{name}: draw changes the scene given to it")


def check_encoder(encoder_class: type[PositionalEncoder]) -> None:
    """None when the class keeps what `PositionalEncoder` promises: its saved state rebuilds it, pixel by pixel.

    Raises:
        AssertionError: it does not; the message says what was expected and what came.
    """
    check_class("encoders", encoder_class, PositionalEncoder)
    name = encoder_class.name
    encoder = encoder_class.create(np.random.default_rng(0))
    u, v = Camera(48, 32).frame_coordinates()
    encoding = encoder.encode(u, v)
    check_array(encoding, (encoder.channels, *u.shape), np.float32, f"{name}: encode")
    same(encoder.encode(u, v), encoding, f"{name}: the same pixels encoded twice")
    twin = encoder_class.create(np.random.default_rng(0))
    expect(twin.state == encoder.state, f"{name}: create gives another state for the same rng")
    rebuilt = encoder_class.from_state(json.loads(plain_json(encoder.state, f"{name}: state")))
    same(rebuilt.encode(u, v), encoding, f"{name}: rebuilt from its state, encode")
    crop = (slice(5, 20), slice(7, 30))
    same(encoder.encode(u[crop], v[crop]), encoding[:, *crop], f"{name}: a crop, which must keep the frame's values")


def check_sampler(sampler_class: type[Sampler]) -> None:
    """None when the class keeps what `Sampler` promises: exactly that many points, on the surface, from the rng alone.

    Raises:
        AssertionError: it does not; the message says what was expected and what came.
    """
    check_class("samplers", sampler_class, Sampler)
    sampler, name = sampler_class(), sampler_class.name
    vertices, faces = _box(BOX)
    given = vertices.copy(), faces.copy()
    for count in (10, 257, 600):
        points = sampler.sample(vertices, faces, count, np.random.default_rng(count))
        check_array(points, (count, 3), np.float64, f"{name}: {count} points asked for, sample")
        off = np.abs((np.abs(points) / BOX).max(1) - 1).max()
        expect(off < 1e-5, f"{name}: a point lies {off:.2g} of the box's half side off the surface")
        again = sampler.sample(vertices, faces, count, np.random.default_rng(count))
        same(again, points, f"{name}: the same rng, sample")
    same(vertices, given[0], f"{name}: the vertices given to sample")
    same(faces, given[1], f"{name}: the faces given to sample")
    sides = {(axis, sign) for axis in range(3) for sign in (-1, 1) if (sign * points[:, axis] > BOX[axis] - 1e-4).any()}
    expect(len(sides) == 6, f"{name}: {count} points on a box leave {6 - len(sides)} of its sides empty")


def check_reader(reader_class: type[Reader], example_file: Path, broken_file: Path | None = None) -> None:
    """None when the class keeps what `Reader` promises on an example file, and refuses a broken one with ScanError.

    Raises:
        AssertionError: it does not; the message says what was expected and what came.
    """
    check_class("readers", reader_class, Reader)
    reader, name = reader_class(), reader_class.name
    expect(bool(reader.suffixes), f"{name}: suffixes is empty")
    for suffix in reader.suffixes:
        proper = suffix.startswith(".") and suffix == suffix.lower()
        expect(proper, f"{name}: expected a lower-case suffix with its dot, as '.ply', got {suffix!r}")
    found = example_file.suffix.lower()
    expect(found in reader.suffixes, f"{name}: {found!r} of the example file is none of {', '.join(reader.suffixes)}")
    clouds = reader.read(example_file)
    expect(isinstance(clouds, list) and len(clouds) > 0, f"{name}: expected a list of clouds, got {clouds!r}")
    for cloud, again in zip(map(_raw, clouds), map(_raw, reader.read(example_file)), strict=True):
        check_array(cloud.points, (len(cloud.points), 3), np.float64, f"{name}: read", finite=False)
        expect(len(cloud.points) > 0, f"{name}: read gives no point of the example file")
        same(again.points, cloud.points, f"{name}: the same file read twice")
        if cloud.sensor is not None:
            _check_sensor(cloud.sensor, name)
    if broken_file is not None:
        refuses(lambda: reader.read(broken_file), ScanError, f"{name}: read of the broken {broken_file.name}")


def _raw(cloud: Any) -> RawCloud:
    return cloud if isinstance(cloud, RawCloud) else RawCloud(cloud)


def _check_sensor(sensor: Sensor, name: str) -> None:
    check_array(sensor.position, (3,), np.float64, f"{name}: the sensor's position")
    check_array(sensor.rotation, (3, 3), np.float64, f"{name}: the sensor's rotation")
    proper = np.allclose(sensor.rotation @ sensor.rotation.T, np.eye(3), atol=1e-6)
    expect(proper and np.linalg.det(sensor.rotation) > 0, f"{name}: the sensor's rotation is none: {sensor.rotation}")


def _check_draws(control: Control) -> list[Value]:
    rng, twin = np.random.default_rng(7), np.random.default_rng(7)
    values = [control.draw(rng) for _ in range(DRAWS)]
    again = [control.draw(twin) for _ in range(DRAWS)]
    expect(values == again, f"{control.name}: draw gives other values for the same rng")
    expect(len(set(values)) > 1, f"{control.name}: draw gives {values[0]} every time")
    for value in values:
        _accepts(control, value, "its own draw")
        plain_json(value, f"{control.name}: draw")
    return values


def _check_encoding(control: Control, value: Value) -> tuple[float, ...]:
    encoding = tuple(control.encode(value))
    size = control.size
    expect(len(encoding) == size, f"{control.name}: size is {size}, but encode gives {encoding} for {value}")
    expect(bool(np.isfinite(encoding).all()), f"{control.name}: encode gives {encoding} for {value}")
    turned = control.mirrored(value)
    _accepts(control, turned, f"what mirrored gives for {value}")
    again = control.mirrored(turned)
    expect(bool(np.allclose(again, value)), f"{control.name}: mirrored twice gives {again} for {value}")
    return encoding


def _check_parse(control: Control) -> None:
    slider = control.slider
    text = ",".join(repr(float(number)) for number in slider.default)
    expect(control.parse(text) == slider.default, f"{control.name}: parse of its default {text!r} gives another value")
    for rubbish in ("", "rubbish!", ",".join(["nan"] * len(slider.components)), text + ",1,2,3,4"):
        refuses(lambda rubbish=rubbish: control.parse(rubbish), SettingError, f"{control.name}: parse of {rubbish!r}")
    for index, (low, high) in enumerate(zip(slider.low, slider.high, strict=True)):
        for outside in (low - 1.5 * (high - low), high + 1.5 * (high - low)):
            value = (*slider.default[:index], outside, *slider.default[index + 1 :])
            text = ",".join(map(repr, value))
            refuses(lambda text=text: control.parse(text), SettingError, f"{control.name}: parse of {text!r}")


def _check_apply(control: Control, value: Value) -> SceneDescription:
    scene, twin = SceneDescription(), SceneDescription()
    control.apply(value, scene)
    control.apply(value, twin)
    expect(scene == twin, f"{control.name}: apply of {value} to two equal scenes makes two different ones")
    written = json.loads(plain_json(scene.to_json(), f"{control.name}: the scene after apply"))
    expect(SceneDescription.from_json(written) == scene, f"{control.name}: the scene after apply is lost in JSON")
    return scene


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


BOX = np.array([1.0, 0.6, 0.35])
"""Half sides of the box that samplers are tried on."""


def _box(half: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (8, 3) float64 and triangles (12, 3) int64 of a box about the origin."""
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [triangle for a, b, c, d in quads for triangle in ((a, b, c), (a, c, d))]
    return corners * half, np.array(faces, dtype=np.int64)


def _accepts(control: Control, value: Value, which: str) -> None:
    try:
        control.check(value)
    except SettingError as error:
        raise AssertionError(f"{control.name}: {which} {value} is refused: {error}") from error
