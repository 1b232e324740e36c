"""The cases of the report's sweeps: only what a level names is varied, and truth is shared with `z2p evaluate`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from z2p_core.camera import turn
from z2p_core.config import EvaluateConfig
from z2p_core.config.report import SWEEP_NAMES, NameSweep, NumberSweep, ReportConfig
from z2p_renderer.pipeline.evaluation.evaluate import sample_views
from z2p_renderer.pipeline.evaluation.paper.cases.sweeps import (
    SYNTHETIC_SWEEPS,
    Case,
    TrueMesh,
    read_true_mesh,
    sweep_cases,
)
from z2p_renderer.pipeline.evaluation.paper.measure import draw_points
from z2p_renderer.pipeline.evaluation.paper.page.captions import SWEEP_CAPTIONS
from z2p_renderer.pipeline.rendering.views import load_controls
from z2p_renderer.pipeline.shapes import shape
from z2p_renderer.storage.meshes import write_mesh

SMALL = ReportConfig(points=400, views=2, density=NumberSweep((100.0, 900.0)), scene=NumberSweep((1.0, 4.0)),
                     bumps=NumberSweep((4.0, 8.0)), gap=NumberSweep((0.4, 0.1)))  # fmt: skip


@pytest.fixture(scope="module")
def vase(tmp_path_factory: pytest.TempPathFactory) -> TrueMesh:
    path = tmp_path_factory.mktemp("meshes") / "vase.ply"
    write_mesh(path, *shape("vase"))
    return read_true_mesh("vase", Path(path))


def cases(name: str, subject: TrueMesh, config: ReportConfig = SMALL) -> list[Case]:
    return sweep_cases(name, None if name in SYNTHETIC_SWEEPS else subject, config)


@pytest.mark.parametrize("name", SWEEP_NAMES)
def test_every_sweep_has_cases_and_a_caption(name: str, vase: TrueMesh) -> None:
    by_level, sweep = cases(name, vase), SMALL.sweeps()[name]
    levels = [case.level for case in by_level if not case.level.startswith("solid")]
    if name not in SYNTHETIC_SWEEPS:
        assert len(by_level) == SMALL.views * len(sweep.levels)
    assert {str(level) if isinstance(level, str) else f"{level:g}" for level in sweep.levels} <= set(levels)
    assert SWEEP_CAPTIONS[name].title and SWEEP_CAPTIONS[name].description
    for case in by_level:
        assert case.cloud.dtype == np.float32 and np.isfinite(case.cloud).all() and len(case.cloud) <= 1600
        assert np.linalg.norm(case.cloud, axis=1).max() < 1.2
        assert (draw_points(case, 48)[..., 0] < 0.95).any()  # it is in the frame


@pytest.mark.slow
@pytest.mark.parametrize("name", ["noise", "sampling", "single", "inner", "bumps"])
def test_clouds_depend_on_the_seed_alone(name: str, vase: TrueMesh) -> None:
    first, again, other = (cases(name, vase, replace(SMALL, seed=seed)) for seed in (0, 0, 1))
    assert [case.cloud.tobytes() for case in first] == [case.cloud.tobytes() for case in again]
    assert first[-1].cloud.tobytes() != other[-1].cloud.tobytes()


def test_noise_moves_the_same_points_further(vase: TrueMesh) -> None:
    clean, *noisy = (case.cloud for case in cases("noise", vase) if case.view == 0)
    moved = [cloud - clean for cloud in noisy]
    levels = SMALL.noise.levels[1:]
    assert [part.std() for part in moved] == pytest.approx(levels, rel=0.1)
    assert np.corrcoef(moved[0].ravel(), moved[-1].ravel())[0, 1] > 0.99


def test_views_are_those_of_an_evaluation(vase: TrueMesh) -> None:
    """So that renders are by_level, and figures can be compared."""
    drawing = SimpleNamespace(controls=load_controls(("color", "light", "elevation")), fixed_elevation=None)
    theirs = sample_views(drawing, vase.identity, EvaluateConfig(views=2, seed=0))  # type: ignore[arg-type]
    ours = cases("base", vase)
    assert [case.scene for case in ours] == [view.scene for view in theirs]
    assert all(case.scene.elevation == 20 and case.subject is vase for case in ours)


def test_controls_change_the_scene_and_nothing_else(vase: TrueMesh) -> None:
    plain = cases("base", vase)[0]
    for name, changed in (("light", "light"), ("color", "material"), ("lift", "lift"), ("turning", "rotation")):
        for case in (case for case in cases(name, vase) if case.view == 0):
            assert case.cloud.tobytes() == plain.cloud.tobytes()
            kept = replace(case.scene, **{changed: getattr(plain.scene, changed)})
            assert kept == plain.scene, name
    turned = cases("turning", vase)[2]
    np.testing.assert_allclose(np.array(turned.scene.rotation), turn(30.0) @ np.array(plain.scene.rotation))


def test_textures_color_the_same_points_of_one_view(vase: TrueMesh) -> None:
    plain, smooth, *_ = (case for case in cases("texture", vase) if case.view == 1)
    assert plain.albedo is None and plain.reference == "" and smooth.reference == plain.level == "none"
    assert smooth.cloud.tobytes() == plain.cloud.tobytes() and smooth.scene == plain.scene
    assert smooth.albedo is not None and smooth.albedo.shape == (400, 3) and smooth.albedo.std(axis=0).min() > 0.02
    alone = cases("texture", vase, replace(SMALL, texture=NameSweep(("stripes",))))
    assert [case.reference for case in alone] == ["", ""]


def test_scaling_scales_cloud_and_truth_alike(vase: TrueMesh) -> None:
    small, *_, full = (case for case in cases("scale", vase) if case.view == 0)
    assert small.cloud == pytest.approx(0.4 * full.cloud, abs=1e-6) and small.subject is None
    assert small.truth.vertices == pytest.approx(0.4 * full.truth.vertices)
    assert full.subject is vase  # its truth is that of the file


def test_inner_points_replace_surface_points(vase: TrueMesh) -> None:
    none, _, most = (case for case in cases("inner", vase) if case.view == 0)
    assert len(none.cloud) == len(most.cloud) == 400 and most.points == 280
    assert most.cloud[:280].tobytes() == none.cloud[:280].tobytes()


def test_limit_cases_name_their_reference(vase: TrueMesh) -> None:
    for name in ("bumps", "gap"):
        by_level = {case.level: case for case in cases(name, vase)}
        changes = [case for case in by_level.values() if case.reference]
        assert len(changes) == 2 and all(not by_level[case.reference].reference for case in changes)
        assert all(case.scene == by_level[case.reference].scene for case in changes)


def test_material_needs_controls_that_not_all_weights_have(vase: TrueMesh) -> None:
    config = replace(SMALL, material=NameSweep(("1,0.3",)))
    (case, _) = cases("material", vase, config)
    assert case.required_controls == ("metallic", "roughness")
    assert case.scene.material["Metallic"] == 1 and case.scene.material["Roughness"] == 0.3
