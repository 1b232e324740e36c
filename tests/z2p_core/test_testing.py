"""The contract suite catches the faults it is there for: each broken plugin fails with a message that names it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from z2p_core.camera import Camera
from z2p_core.interfaces import (
    Baseline,
    Control,
    PositionalEncoder,
    RawCloud,
    Reader,
    Sampler,
    ScanError,
    Sensor,
    Slider,
    Texture,
    Value,
    ZBuffer,
)
from z2p_core.scene import SceneDescription
from z2p_core.testing import (
    check_baseline,
    check_control,
    check_encoder,
    check_reader,
    check_sampler,
    check_texture,
    check_zbuffer,
)


class Sheen(Control):
    name, version = "sheen", "1"
    slider = Slider(("sheen",), (0.0,), (1.0,), (0.0,), help="0 plain to 1 velvet")

    def apply(self, value: Value, scene: SceneDescription) -> None:
        scene.material["Sheen Weight"] = value[0]


class Dot(ZBuffer):
    name, version, channels = "dot", "1", 1

    def draw(self, cloud: np.ndarray, camera: Camera) -> np.ndarray:
        picture = np.zeros((1, camera.height, camera.width), dtype=np.float32)
        pixel, depth = camera.project(cloud)
        for (x, y), d in zip(pixel.astype(int), depth, strict=True):
            if 0 <= x < camera.width and 0 <= y < camera.height:
                picture[0, y, x] = self.merge(picture[0, y, x], np.float32(1 / d))
        return picture

    def merge(self, old: Any, new: Any) -> Any:
        return max(old, new)


class Ramp(PositionalEncoder):
    name, version, channels = "ramp", "1", 1

    def __init__(self, slope: float) -> None:
        self.slope = slope

    @classmethod
    def create(cls, rng: np.random.Generator) -> PositionalEncoder:
        return cls(rng.uniform())

    @classmethod
    def from_state(cls, state: dict[str, Any]) -> PositionalEncoder:
        return cls(state["slope"])

    @property
    def state(self) -> dict[str, Any]:
        return {"slope": self.slope}

    def encode(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        return (self.slope * u)[None].astype(np.float32)


class Tetrahedra(Baseline):
    name, version = "tetrahedra", "1"

    def reconstruct(self, cloud: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        if len(cloud) == 0:
            raise ScanError("expected points, got none")
        corners = 0.01 * np.array([(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)])
        faces = np.array([(0, 1, 2), (0, 2, 3), (0, 3, 1), (1, 3, 2)])
        first = 4 * np.arange(len(cloud))[:, None, None]
        return (cloud[:, None] + corners).reshape(-1, 3), (faces + first).reshape(-1, 3)


class Barycentric(Sampler):
    name, version = "barycentric", "1"

    def sample(self, vertices: np.ndarray, faces: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
        weights = rng.dirichlet((1, 1, 1), size=count)
        return (weights[:, :, None] * vertices[faces[rng.integers(len(faces), size=count)]]).sum(1)


class Fog(Texture):
    name, version = "fog", "1"

    def albedo(self, positions: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        waves = np.sin(positions / 0.3 + rng.uniform(0, 6, 3))
        return (0.5 + 0.5 * waves).astype(np.float32)


class Rows(Reader):
    name, version, suffixes = "rows", "1", (".rows",)

    def read(self, path: Path) -> list[np.ndarray]:
        try:
            return [np.loadtxt(path, ndmin=2)]
        except ValueError as error:
            raise ScanError(f"expected rows of numbers: {error}") from error


def variant(base: type[Any], **changes: Any) -> type[Any]:
    return type(f"Broken{base.__name__}", (base,), changes)


def sensed(rotation: np.ndarray) -> Any:
    return lambda self, path: [RawCloud(np.ones((2, 3)), Sensor(np.zeros(3), rotation))]


def colored(rgb: np.ndarray, **others: Any) -> Any:
    def read(self: Reader, path: Path) -> list[RawCloud]:
        fields = {"rgb": rgb} if self.wants("rgb") else {}
        return [RawCloud(np.ones((2, 3)), fields=fields, field_names=("rgb",), **others)]

    return read


def thinned(self: Reader, path: Path) -> list[np.ndarray]:
    return [np.ones((2 if self.wants("rgb") else 1, 3))]


def test_sound_plugins_pass(tmp_path: Path) -> None:
    check_control(Sheen)
    check_zbuffer(Dot)
    check_encoder(Ramp)
    check_sampler(Barycentric)
    check_texture(Fog)
    example, broken = tmp_path / "a.rows", tmp_path / "b.rows"
    example.write_text("0 0 1\n1 2 3\n")
    broken.write_text("rubbish\n")
    check_reader(Rows, example, broken)
    check_reader(variant(Rows, read=sensed(np.eye(3))), example)
    check_reader(variant(Rows, read=colored(np.array([[0, 0.5, 1], [np.nan] * 3]))), example)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"name": ""}, "name must be a text"),
        ({"version": 1}, "version must be a text"),
        ({"draw": lambda self, rng: (2.0,)}, "every time"),
        ({"draw": lambda self, rng: (float(rng.uniform(0, 2)),)}, "its own draw"),
        ({"draw": lambda self, rng: (float(np.random.default_rng().uniform()),)}, "same rng"),
        ({"draw": lambda self, rng: (np.float32(rng.uniform()),)}, "plain finite numbers"),
        ({"encode": lambda self, value: (value[0], 0.0)}, "size is 1"),
        ({"encode": lambda self, value: (float("nan"),)}, "encode gives"),
        ({"encode": lambda self, value: (0.5,)}, "nothing is steered"),
        ({"mirrored": lambda self, value: (-1.0 - value[0],)}, "what mirrored gives"),
        ({"mirrored": lambda self, value: (value[0] / 2,)}, "mirrored twice gives"),
        ({"parse": lambda self, text: (0.0,)}, "expected SettingError"),
        ({"parse": lambda self, text: (float(text),)}, "expected SettingError, got ValueError"),
        ({"apply": lambda self, value, scene: None}, "apply changes the scene for no value"),
        ({"apply": lambda self, value, scene: scene.material.update(Sheen=np.ones(1))}, "plain finite numbers"),
        ({"apply": Control.apply, "__abstractmethods__": frozenset({"apply"})}, "are missing: apply"),
    ],
)
def test_a_broken_control_fails(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(AssertionError, match=message):
        check_control(variant(Sheen, **changes))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"channels": 2}, "expected shape"),
        ({"merge": lambda self, old, new: new}, "another order|behind its nearest"),
        ({"merge": lambda self, old, new: min(old, new) if old else new}, "behind its nearest"),
        ({"merge": lambda self, old, new: old + new}, "behind its nearest|another order"),
        ({"draw": lambda self, cloud, camera: Dot.draw(self, cloud, camera).astype(np.float64)}, "expected float32"),
        ({"draw": lambda self, cloud, camera: Dot.draw(self, cloud, camera) + 1}, "expected 0"),
        ({"draw": lambda self, cloud, camera: Dot.draw(self, cloud, camera) * 0}, "empty picture"),
    ],
)
def test_a_broken_zbuffer_fails(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(AssertionError, match=message):
        check_zbuffer(variant(Dot, **changes))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"channels": 3}, "expected shape"),
        ({"create": classmethod(lambda cls, rng: cls(np.random.default_rng().uniform()))}, "same rng"),
        ({"state": property(lambda self: {"slope": np.float32(self.slope)})}, "plain finite numbers"),
        ({"from_state": classmethod(lambda cls, state: cls(0.0))}, "rebuilt from its state"),
        ({"encode": lambda self, u, v: (u - u.mean())[None].astype(np.float32)}, "a crop"),
    ],
)
def test_a_broken_encoder_fails(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(AssertionError, match=message):
        check_encoder(variant(Ramp, **changes))


@pytest.mark.parametrize(
    ("sample", "message"),
    [
        (lambda self, v, f, n, rng: Barycentric.sample(self, v, f, n - 1, rng), "expected shape"),
        (lambda self, v, f, n, rng: Barycentric.sample(self, v, f, n, np.random.default_rng()), "same rng"),
        (lambda self, v, f, n, rng: Barycentric.sample(self, v, f, n, rng) * 1.01, "off the surface"),
        (lambda self, v, f, n, rng: Barycentric.sample(self, v, f[:2], n, rng), "sides empty"),
        (lambda self, v, f, n, rng: Barycentric.sample(self, v, f, n, rng).astype(np.float32), "expected float64"),
    ],
)
def test_a_broken_sampler_fails(sample: Any, message: str) -> None:
    with pytest.raises(AssertionError, match=message):
        check_sampler(variant(Barycentric, sample=sample))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"albedo": lambda self, places, rng: 3 * Fog.albedo(self, places, rng)}, "colors in"),
        ({"albedo": lambda self, places, rng: Fog.albedo(self, places, np.random.default_rng())}, "same rng"),
        ({"albedo": lambda self, places, rng: Fog.albedo(self, places, np.random.default_rng(0))}, "another rng"),
        ({"albedo": lambda self, places, rng: Fog.albedo(self, places - places[:1], rng)}, "places alone"),
        ({"albedo": lambda self, places, rng: Fog.albedo(self, places, rng).astype(float)}, "expected float32"),
        ({"period": (0.0, 1.0)}, "longest period"),
    ],
)
def test_a_broken_texture_fails(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(AssertionError, match=message):
        check_texture(variant(Fog, **changes))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"suffixes": ("rows",)}, "lower-case suffix"),
        ({"suffixes": (".other",)}, "is none of"),
        ({"read": lambda self, path: []}, "list of clouds"),
        ({"read": lambda self, path: [np.loadtxt(path, dtype=np.float32)]}, "expected float64"),
        ({"read": lambda self, path: [np.ones((2, 3))]}, "expected ScanError"),
        ({"read": sensed(np.ones((3, 3)))}, "rotation is none"),
        ({"read": sensed(np.diag([1.0, 1.0, -1.0]))}, "rotation is none"),
        ({"read": sensed(np.eye(4))}, "expected shape"),
        ({"read": colored(np.ones((2, 4)))}, "has the shape"),
        ({"read": colored(np.ones((2, 3), int))}, "expected floats"),
        ({"read": colored(np.full((2, 3), 1.5))}, "leaves"),
        ({"read": lambda self, path: [RawCloud(np.ones((2, 3)), field_names=("time",))]}, "field_names lists 'time'"),
        ({"read": colored(np.ones((2, 3)), units={"time": "s"})}, "units of 'time'"),
        ({"read": thinned}, "points without and with fields"),
    ],
)
def test_a_broken_reader_fails(changes: dict[str, Any], message: str, tmp_path: Path) -> None:
    example, broken = tmp_path / "a.rows", tmp_path / "b.rows"
    example.write_text("0 0 1\n1 2 3\n")
    broken.write_text("rubbish\n")
    with pytest.raises(AssertionError, match=message):
        check_reader(variant(Rows, **changes), example, broken)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda vertices, faces: (vertices.astype(np.float32), faces), "expected float64"),
        (lambda vertices, faces: (vertices, faces.astype(float)), "expected triangles"),
        (lambda vertices, faces: (vertices, faces[:0]), "expected triangles"),
        (lambda vertices, faces: (vertices, faces + 1), "triangles use vertices 1 to"),
        (lambda vertices, faces: (2 * vertices, faces), "off the sphere"),
        (lambda vertices, faces: (vertices + np.random.default_rng().normal(scale=1e-6), faces), "same cloud and rng"),
    ],
)
def test_a_broken_baseline_fails(change: Any, message: str) -> None:
    def reconstruct(self: Any, cloud: np.ndarray, rng: np.random.Generator) -> Any:
        return change(*Tetrahedra.reconstruct(self, cloud, rng))

    with pytest.raises(AssertionError, match=message):
        check_baseline(variant(Tetrahedra, reconstruct=reconstruct))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda colors: colors[:, :2], "expected shape"),
        (lambda colors: colors + 0.5, "colors in"),
        (lambda colors: colors[:, ::-1].copy(), "far inside points of one color"),
    ],
)
def test_wrong_vertex_colors_fail(change: Any, message: str) -> None:
    def reconstruct_colored(self: Any, *arguments: Any) -> Any:
        vertices, faces, colors = Tetrahedra.reconstruct_colored(self, *arguments)
        return vertices, faces, change(colors)

    with pytest.raises(AssertionError, match=message):
        check_baseline(variant(Tetrahedra, reconstruct_colored=reconstruct_colored))


def test_a_baseline_must_refuse_an_empty_cloud() -> None:
    def reconstruct(self: Any, cloud: np.ndarray, rng: np.random.Generator) -> Any:
        return Tetrahedra.reconstruct(self, cloud, rng) if len(cloud) else (cloud, np.zeros((0, 3), int))

    check_baseline(Tetrahedra)
    with pytest.raises(AssertionError, match="an empty cloud: expected ScanError"):
        check_baseline(variant(Tetrahedra, reconstruct=reconstruct))
