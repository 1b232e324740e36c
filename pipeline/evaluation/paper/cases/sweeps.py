"""The report's parameter sweeps: the cases (cloud, scene, true mesh) of each level of each sweep."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from PIL import ImageColor

from z2p_core.camera import turn
from z2p_core.config import EvaluateConfig
from z2p_core.config.report import ReportConfig
from z2p_core.interfaces import Value
from z2p_core.placement.bounding_sphere import Sphere, bounding_sphere
from z2p_core.scene import SceneDescription
from z2p_renderer.pipeline.evaluation.evaluate import sample_views
from z2p_renderer.pipeline.evaluation.paper.cases import synthetic_shapes
from z2p_renderer.pipeline.evaluation.paper.cases.synthetic_scans import inner_points, non_uniform, single_view
from z2p_renderer.pipeline.rendering.mesh_samples import sample_cloud
from z2p_renderer.pipeline.rendering.textures import SeededTexture, mesh_texture
from z2p_renderer.pipeline.rendering.views import View, describe, load_controls
from z2p_renderer.storage.meshes import Mesh, read_mesh
from z2p_renderer.storage.results.fingerprints import file_digest

VIEW_CONTROLS = ("color", "light", "elevation")
"""Controls that are sampled for views: those that all weights have."""
UNIT_SPHERE = Sphere((0.0, 0.0, 0.0), 1.0)
SYNTHETIC_SETTINGS: dict[str, Value] = {"color": (0.3, 0.45, 0.65), "light": (3.75, -40.0, 50.0), "elevation": (20.0,)}
SYNTHETIC_SWEEPS = ("sheet", "scene", "bumps", "gap")
"""Sweeps over synthetic shapes instead of the meshes."""
NO_TEXTURE = "none"
"""Level of the sweep over textures at which the object has one color."""
MAX_SCENE_POINTS_FACTOR = 4
"""The cloud of several objects has at most so many times the points of a single object's."""


@dataclass(frozen=True)
class TrueMesh:
    """A true mesh in the unit sphere; `path` and `identity` (sha256) are those of its file."""

    name: str
    mesh: Mesh
    identity: str = ""
    path: Path | None = None


@dataclass(frozen=True)
class Case:
    """One picture that every method draws, with the true mesh and scene."""

    level: str
    view: int
    cloud: np.ndarray
    """(N, 3) float32 in the true mesh's axes, before the scene rotates and lifts both."""
    scene: SceneDescription
    values: Mapping[str, Value]
    """Control -> value, of every control applied to the scene."""
    truth: Mesh
    """The true mesh, in the cloud's axes."""
    subject: TrueMesh | None = None
    """Set if the truth is the unchanged mesh of a file: its renders are shared with `z2p evaluate`."""
    required_controls: tuple[str, ...] = ()
    """Controls that weights need to draw it."""
    reference: str = ""
    """Level of the plain case that this one modifies, where the contrast of the change is measured; else empty."""
    points: int = 0
    """Number of points on the surface; they come first in the cloud."""
    texture: SeededTexture | None = None
    """Colors of the true mesh and of the cloud's points, in place of the scene's base color."""

    @property
    def albedo(self) -> np.ndarray | None:
        """Linear base colors (N, 3) float32 of the cloud's points, if the case has a texture."""
        return None if self.texture is None else self.texture.albedo(self.cloud)

    @property
    def x(self) -> float | None:
        """The level as a number."""
        try:
            return float(self.level)
        except ValueError:
            return None


def read_true_mesh(name: str, path: Path) -> TrueMesh:
    """The mesh of a file, in the unit sphere.

    Raises:
        ScanError: it cannot be read.
    """
    mesh = read_mesh(path)
    vertices = bounding_sphere(mesh.vertices).normalise(mesh.vertices).astype(np.float64)
    return TrueMesh(name, Mesh(vertices, mesh.faces, mesh.smooth), file_digest(path), path)


def sweep_cases(name: str, subject: TrueMesh | None, config: ReportConfig) -> list[Case]:
    """The cases of a sweep, by level and then by view; `subject` is None for sweeps over synthetic shapes."""
    levels: Sequence[Any] = config.sweeps()[name].levels
    if name in SYNTHETIC_SWEEPS or subject is None:
        return [case for level in levels for case in _SYNTHETIC_CASES[name](level, config)]
    cases = []
    for level in levels:
        for index, view in enumerate(base_views(subject, config)):
            case = _MESH_CASES[name](level, _BaseCase(subject, view, index, config))
            cases.append(replace(case, level=_level_name(level), points=case.points or len(case.cloud)))
    return cases


def base_views(subject: TrueMesh, config: ReportConfig) -> list[View]:
    """The subject's views: those of `z2p evaluate` for the same seed, at 20 degrees."""
    renderer = SimpleNamespace(controls=load_controls(VIEW_CONTROLS), fixed_elevation=None)
    return sample_views(renderer, subject.identity, EvaluateConfig(views=config.views, seed=config.seed))  # type: ignore[arg-type]


@dataclass(frozen=True)
class _BaseCase:
    """The unmodified case of a view, from which each level of a sweep derives its own."""

    subject: TrueMesh
    view: View
    index: int
    config: ReportConfig

    def rng(self, stream: int = 0) -> np.random.Generator:
        """The same random numbers for every level, so that only the varied parameter differs."""
        return np.random.default_rng([self.config.seed, int(self.subject.identity[:16], 16), self.index, 3, stream])

    def cloud(self, count: int = 0, sampler: str = "uniform", noise: float = 0.0) -> np.ndarray:
        """Cloud (N, 3) float32 sampled on the subject."""
        kind = "gaussian" if noise else "none"
        count = count or self.config.points
        return sample_cloud(self.subject.mesh, UNIT_SPHERE, sampler, count, kind, noise, self.rng())

    def case(self, cloud: np.ndarray, **changes: Any) -> Case:
        """The base case with another cloud and other `changes`."""
        case = Case("", self.index, cloud.astype(np.float32), self.view.scene, self.view.values, self.subject.mesh,
                    self.subject)  # fmt: skip
        return replace(case, **changes)

    def with_controls(
        self, required_controls: tuple[str, ...] = (), rotation: np.ndarray | None = None, **values: Value
    ) -> Case:
        """The base cloud with other values of controls, or another rotation."""
        controls = load_controls((*VIEW_CONTROLS, *required_controls))
        rotation = np.array(self.view.scene.rotation) if rotation is None else rotation
        all_values = {**self.view.values, **values}
        return self.case(
            self.cloud(),
            scene=describe(controls, all_values, rotation),
            values=all_values,
            required_controls=required_controls,
        )


def _vary_sampler(level: str, base: _BaseCase) -> Case:
    if level == "non-uniform":
        return base.case(non_uniform(base.subject.mesh, base.config.points, base.rng()))
    return base.case(base.cloud(sampler=level))


def _vary_inner_points(level: float, base: _BaseCase) -> Case:
    count = round(level * base.config.points)
    surface = base.cloud()[: base.config.points - count]
    inner = inner_points(base.subject.mesh, count, base.rng(1))
    return base.case(np.concatenate([surface, inner.astype(np.float32)]), points=len(surface))


def _vary_scale(level: float, base: _BaseCase) -> Case:
    mesh = base.subject.mesh
    smaller = Mesh(mesh.vertices * level, mesh.faces, mesh.smooth)
    return base.case(base.cloud() * level, truth=smaller, subject=base.subject if level == 1 else None)


def _vary_depth_camera(level: str, base: _BaseCase) -> Case:
    scene = base.view.scene
    cloud = single_view(base.subject.mesh, np.array(scene.rotation), scene.elevation, level, base.config.points,
                        base.rng(1))  # fmt: skip
    return base.case(cloud)


def _vary_light(level: float, base: _BaseCase) -> Case:
    radius, _, elevation = base.view.values["light"]
    return base.with_controls(light=(radius, level, elevation))


def _vary_material(level: str, base: _BaseCase) -> Case:
    metallic, roughness = (float(part) for part in level.split(","))
    return base.with_controls(("metallic", "roughness"), metallic=(metallic,), roughness=(roughness,))


def _vary_texture(level: str, base: _BaseCase) -> Case:
    if level == NO_TEXTURE:
        return base.case(base.cloud())
    reference = NO_TEXTURE if NO_TEXTURE in base.config.texture.levels else ""
    texture = mesh_texture(level, base.subject.identity, base.config.seed)
    return base.case(base.cloud(), texture=texture, reference=reference)


_MESH_CASES: dict[str, Callable[[Any, _BaseCase], Case]] = {
    "base": lambda level, base: base.case(base.cloud()),
    "noise": lambda level, base: base.case(base.cloud(noise=level)),
    "density": lambda level, base: base.case(base.cloud(round(level))),
    "sampling": _vary_sampler,
    "inner": _vary_inner_points,
    "scale": _vary_scale,
    "single": _vary_depth_camera,
    "lift": lambda level, base: base.case(base.cloud(), scene=replace(base.view.scene, lift=level)),
    "light": _vary_light,
    "color": lambda level, base: base.with_controls(color=_color(level)),
    "turning": lambda level, base: base.with_controls(rotation=turn(level) @ np.array(base.view.scene.rotation)),
    "material": _vary_material,
    "texture": _vary_texture,
}


def _color(text: str) -> Value:
    red, green, blue = ImageColor.getrgb(text)[:3]
    return red / 255, green / 255, blue / 255


def _synthetic_case(level: str, mesh: Mesh, count: int, seed: int, azimuth: float = 0.0, reference: str = "") -> Case:
    scene = describe(load_controls(VIEW_CONTROLS), SYNTHETIC_SETTINGS, turn(azimuth))
    rng = np.random.default_rng([seed, 4])
    cloud = sample_cloud(mesh, UNIT_SPHERE, "uniform", count, "none", 0.0, rng)
    return Case(level, 0, cloud, scene, SYNTHETIC_SETTINGS, mesh, reference=reference, points=len(cloud))


def _vary_bumps(level: float, config: ReportConfig) -> list[Case]:
    plain = []
    if level == config.bumps.levels[0]:
        plain = [_synthetic_case("0", synthetic_shapes.harmonic_ball(0), config.points, config.seed)]
    return [
        *plain,
        _synthetic_case(
            _level_name(level), synthetic_shapes.harmonic_ball(level), config.points, config.seed, reference="0"
        ),
    ]


def _vary_gap(level: float, config: ReportConfig) -> list[Case]:
    name = _level_name(level)
    solid = f"solid {name}"
    return [
        _synthetic_case(solid, synthetic_shapes.parallel_plates(level, solid=True), config.points, config.seed),
        _synthetic_case(name, synthetic_shapes.parallel_plates(level), config.points, config.seed, reference=solid),
    ]


_SYNTHETIC_CASES: dict[str, Callable[[Any, ReportConfig], list[Case]]] = {
    "sheet": lambda level, config: [
        _synthetic_case(_level_name(level), synthetic_shapes.tilted_sheet(level), config.points, config.seed, 25.0)
    ],
    "scene": lambda level, config: [
        _synthetic_case(
            _level_name(level),
            synthetic_shapes.objects_on_floor(level),
            round(min(level, MAX_SCENE_POINTS_FACTOR) * config.points),
            config.seed,
            20.0,
        )
    ],
    "bumps": _vary_bumps,
    "gap": _vary_gap,
}


def _level_name(level: Any) -> str:
    return level if isinstance(level, str) else f"{level:g}"
