"""The report's sweeps: what each varies, and the cases (cloud, scene, true mesh) that each of its levels stands for."""

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
from z2p_renderer.pipeline.evaluation.evaluate import draw_views
from z2p_renderer.pipeline.evaluation.paper.cases import synthetic_shapes
from z2p_renderer.pipeline.evaluation.paper.cases.synthetic_scans import inner_points, non_uniform, single_view
from z2p_renderer.pipeline.rendering.mesh_samples import draw_cloud
from z2p_renderer.pipeline.rendering.views import View, describe, load_controls
from z2p_renderer.storage.meshes import Mesh, read_mesh
from z2p_renderer.storage.results.fingerprints import file_digest

CONTROLS = ("color", "light", "elevation")
"""What views are drawn with: those of every training but the materials'."""
UNIT = Sphere((0.0, 0.0, 0.0), 1.0)
MADE_LOOK: dict[str, Value] = {"color": (0.3, 0.45, 0.65), "light": (3.75, -40.0, 50.0), "elevation": (20.0,)}
OWN_SHAPES = ("sheet", "scene", "bumps", "gap")
"""Sweeps over shapes made for them, whatever the meshes."""
MOST_IN_SCENE = 4
"""Clouds of scenes have so many times the points, at the most, that a single object has."""


@dataclass(frozen=True)
class Subject:
    """A true mesh in the unit sphere; `path` and `identity` (sha256) are those of its file, empty for a made one."""

    name: str
    mesh: Mesh
    identity: str = ""
    path: Path | None = None


@dataclass(frozen=True)
class Case:
    """One picture that every method is asked for, and what it should show."""

    level: str
    view: int
    cloud: np.ndarray
    """(N, 3) float32 in the true mesh's axes, before the scene turns and lifts both."""
    scene: SceneDescription
    values: Mapping[str, Value]
    """Control -> value, of every control that shaped the scene."""
    truth: Mesh
    """The true mesh, placed as the cloud is."""
    subject: Subject | None = None
    """Where the truth is the very mesh of a file: its renders are shared with `z2p evaluate`."""
    needs: tuple[str, ...] = ()
    """Controls without which weights cannot draw it."""
    reference: str = ""
    """Level of the case that this one is a change of, where what is measured is how much of the change is kept."""
    points: int = 0
    """Points of the cloud that are on the surface, the first ones."""

    @property
    def x(self) -> float | None:
        """The level as a number."""
        try:
            return float(self.level)
        except ValueError:
            return None


def read_subject(name: str, path: Path) -> Subject:
    """The mesh of a file, in the unit sphere.

    Raises:
        ScanError: it cannot be read.
    """
    mesh = read_mesh(path)
    vertices = bounding_sphere(mesh.vertices).normalise(mesh.vertices).astype(np.float64)
    return Subject(name, Mesh(vertices, mesh.faces, mesh.smooth), file_digest(path), path)


def sweep_cases(name: str, subject: Subject | None, config: ReportConfig) -> list[Case]:
    """The cases of a sweep, level by level and in each view by view; `subject` is None where it has its own shapes."""
    levels: Sequence[Any] = config.sweeps()[name].levels
    if name in OWN_SHAPES or subject is None:
        return [case for level in levels for case in _MADE[name](level, config)]
    cases = []
    for level in levels:
        for index, view in enumerate(base_views(subject, config)):
            case = _VARIED[name](level, _Start(subject, view, index, config))
            cases.append(replace(case, level=_told(level), points=case.points or len(case.cloud)))
    return cases


def base_views(subject: Subject, config: ReportConfig) -> list[View]:
    """The subject's views: those that `z2p evaluate` draws with the same seed at 20 degrees."""
    drawing = SimpleNamespace(controls=load_controls(CONTROLS), fixed_elevation=None)
    return draw_views(drawing, subject.identity, EvaluateConfig(views=config.views, seed=config.seed))  # type: ignore[arg-type]


@dataclass(frozen=True)
class _Start:
    """The plain case that a level changes something of."""

    subject: Subject
    view: View
    index: int
    config: ReportConfig

    def rng(self, what: int = 0) -> np.random.Generator:
        """The same for every level, so that only what is varied differs."""
        return np.random.default_rng([self.config.seed, int(self.subject.identity[:16], 16), self.index, 3, what])

    def cloud(self, count: int = 0, sampler: str = "uniform", noise: float = 0.0) -> np.ndarray:
        """(N, 3) float32."""
        kind = "gaussian" if noise else "none"
        count = count or self.config.points
        return draw_cloud(self.subject.mesh, UNIT, sampler, count, kind, noise, self.rng())

    def case(self, cloud: np.ndarray, **changes: Any) -> Case:
        """The plain case of a cloud, with changes."""
        case = Case("", self.index, cloud.astype(np.float32), self.view.scene, self.view.values, self.subject.mesh,
                    self.subject)  # fmt: skip
        return replace(case, **changes)

    def seen(self, needs: tuple[str, ...] = (), rotation: np.ndarray | None = None, **values: Value) -> Case:
        """The plain cloud with controls set anew, or turned."""
        controls = load_controls((*CONTROLS, *needs))
        rotation = np.array(self.view.scene.rotation) if rotation is None else rotation
        chosen = {**self.view.values, **values}
        return self.case(self.cloud(), scene=describe(controls, chosen, rotation), values=chosen, needs=needs)


def _sampled(level: str, start: _Start) -> Case:
    if level == "non-uniform":
        return start.case(non_uniform(start.subject.mesh, start.config.points, start.rng()))
    return start.case(start.cloud(sampler=level))


def _with_inner(level: float, start: _Start) -> Case:
    count = round(level * start.config.points)
    surface = start.cloud()[: start.config.points - count]
    inner = inner_points(start.subject.mesh, count, start.rng(1))
    return start.case(np.concatenate([surface, inner.astype(np.float32)]), points=len(surface))


def _scaled(level: float, start: _Start) -> Case:
    mesh = start.subject.mesh
    smaller = Mesh(mesh.vertices * level, mesh.faces, mesh.smooth)
    return start.case(start.cloud() * level, truth=smaller, subject=start.subject if level == 1 else None)


def _from_one_side(level: str, start: _Start) -> Case:
    scene = start.view.scene
    cloud = single_view(start.subject.mesh, np.array(scene.rotation), scene.elevation, level, start.config.points,
                        start.rng(1))  # fmt: skip
    return start.case(cloud)


def _lit(level: float, start: _Start) -> Case:
    radius, _, elevation = start.view.values["light"]
    return start.seen(light=(radius, level, elevation))


def _of_material(level: str, start: _Start) -> Case:
    metallic, roughness = (float(part) for part in level.split(","))
    return start.seen(("metallic", "roughness"), metallic=(metallic,), roughness=(roughness,))


_VARIED: dict[str, Callable[[Any, _Start], Case]] = {
    "base": lambda level, start: start.case(start.cloud()),
    "noise": lambda level, start: start.case(start.cloud(noise=level)),
    "density": lambda level, start: start.case(start.cloud(round(level))),
    "sampling": _sampled,
    "inner": _with_inner,
    "scale": _scaled,
    "single": _from_one_side,
    "lift": lambda level, start: start.case(start.cloud(), scene=replace(start.view.scene, lift=level)),
    "light": _lit,
    "color": lambda level, start: start.seen(color=_color(level)),
    "turning": lambda level, start: start.seen(rotation=turn(level) @ np.array(start.view.scene.rotation)),
    "material": _of_material,
}


def _color(text: str) -> Value:
    red, green, blue = ImageColor.getrgb(text)[:3]
    return red / 255, green / 255, blue / 255


def _made(level: str, mesh: Mesh, count: int, seed: int, azimuth: float = 0.0, reference: str = "") -> Case:
    scene = describe(load_controls(CONTROLS), MADE_LOOK, turn(azimuth))
    rng = np.random.default_rng([seed, 4])
    cloud = draw_cloud(mesh, UNIT, "uniform", count, "none", 0.0, rng)
    return Case(level, 0, cloud, scene, MADE_LOOK, mesh, reference=reference, points=len(cloud))


def _bumps(level: float, config: ReportConfig) -> list[Case]:
    ball = [_made("0", synthetic_shapes.bumpy(0), config.points, config.seed)] if level == config.bumps.levels[0] else []
    return [*ball, _made(_told(level), synthetic_shapes.bumpy(level), config.points, config.seed, reference="0")]


def _gap(level: float, config: ReportConfig) -> list[Case]:
    solid, told = f"solid {_told(level)}", _told(level)
    return [_made(solid, synthetic_shapes.plates(level, solid=True), config.points, config.seed),
            _made(told, synthetic_shapes.plates(level), config.points, config.seed, reference=solid)]  # fmt: skip


_MADE: dict[str, Callable[[Any, ReportConfig], list[Case]]] = {
    "sheet": lambda level, config: [_made(_told(level), synthetic_shapes.sheet(level), config.points, config.seed, 25.0)],
    "scene": lambda level, config: [_made(_told(level), synthetic_shapes.scene(level),
                                          round(min(level, MOST_IN_SCENE) * config.points), config.seed, 20.0)],
    "bumps": _bumps,
    "gap": _gap,
}  # fmt: skip


def _told(level: Any) -> str:
    return level if isinstance(level, str) else f"{level:g}"
