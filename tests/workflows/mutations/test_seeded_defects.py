"""The mutation matrix is complete: leaving any one field out of the fingerprints makes at least one row of it fail."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any

import pytest
from editing import edited
from test_plan import AFTER_SHARDS, EFFECTS, EVERYTHING, RENDERS, SAMPLES, SHARDS, before, stale

import z2p_renderer.storage.results.store
import z2p_renderer.workflows.plan
from z2p_core.config import PipelineConfig
from z2p_renderer.storage.results import fingerprints
from z2p_renderer.storage.results.fingerprints import fingerprint
from z2p_renderer.storage.results.stage_dependencies import PACKAGES, STAGE_CODE
from z2p_renderer.workflows.plan import Plan, make_plan

BEE = {"sample/bee", "render/bee/0-10", "render/bee/10-12", "shard/bee"}
STAGES = {
    "sample": SAMPLES | SHARDS | AFTER_SHARDS, "render": RENDERS | SHARDS | AFTER_SHARDS,
    "shard": SHARDS | AFTER_SHARDS, "train": AFTER_SHARDS, "evaluate": {"evaluate"},
}  # fmt: skip


def rows(config: PipelineConfig, meshes: Any) -> Iterator[tuple[str, Callable[[pytest.MonkeyPatch], Plan], set[str]]]:
    """Name, how the plan after a change is made, and the steps that must be stale then."""
    for path, (value, expected) in EFFECTS.items():
        if before(config, path) == config:
            yield path, lambda patch, path=path, value=value: make_plan(edited(config, path, value)), expected
    for stage, expected in STAGES.items():
        yield f"{stage} version", set_item(config, fingerprints.STAGE_VERSIONS, stage, 99), expected
        for table, added in ((STAGE_CODE, "z2p_core.testing"), (PACKAGES, "luigi")):
            yield f"{stage} code", set_item(config, table, stage, (*table[stage], added)), expected
    yield "schema", lambda patch: (patch.setattr(fingerprints, "SCHEMA", 99), make_plan(config))[1], EVERYTHING
    for key in ("version", "code"):
        yield f"a control's {key}", other_plugin(config, "color", key), RENDERS | SHARDS | AFTER_SHARDS
        yield f"a z-buffer's {key}", other_plugin(config, "splats", key), AFTER_SHARDS
    yield "a mesh", other_mesh(config, meshes / "meshes" / "bee.obj"), BEE | AFTER_SHARDS
    yield "a mesh kept aside", other_mesh(config, meshes / "kept" / "cow.ply"), {"evaluate"}


def set_item(config: PipelineConfig, table: dict[str, Any], key: str, value: Any) -> Callable[..., Plan]:
    return lambda patch: (patch.setitem(table, key, value), make_plan(config))[1]


def other_plugin(config: PipelineConfig, name: str, key: str) -> Callable[..., Plan]:
    fields = z2p_renderer.workflows.plan.plugin_fields

    def changed(plugin: type[Any]) -> dict[str, str]:
        return fields(plugin) | ({key: "other"} if plugin.name == name else {})

    return lambda patch: (patch.setattr(z2p_renderer.workflows.plan, "plugin_fields", changed), make_plan(config))[1]


def other_mesh(config: PipelineConfig, path: Any) -> Callable[..., Plan]:
    def plan(patch: pytest.MonkeyPatch) -> Plan:
        text = path.read_text()
        path.write_text(text + ", but larger")
        try:
            return make_plan(config)
        finally:
            path.write_text(text)

    return plan


def wrong_rows(config: PipelineConfig, meshes: Any, likely: str = "") -> Iterator[str]:
    """Names of the rows that are not right; those with `likely` in their names come first."""
    first = make_plan(config)
    for name, change, expected in sorted(rows(config, meshes), key=lambda row: likely not in row[0]):
        with pytest.MonkeyPatch.context() as patch:
            if stale(first, change(patch)) != expected:
                yield name
    for path, (value, expected) in EFFECTS.items():
        other = before(config, path)
        if other != config and stale(make_plan(other), make_plan(edited(other, path, value))) != expected:
            yield path


def without(value: Any, path: tuple[str, ...]) -> Any:
    """The fields with one of them left out, wherever it stands."""
    if isinstance(value, Mapping):
        head, rest = path[0], path[1:]
        kept = {key: one for key, one in value.items() if key != head or rest}
        return {key: without(one, rest) if key == head else one for key, one in kept.items()}
    return [without(one, path) for one in value] if isinstance(value, list) else value


def defects(plan: Plan) -> set[tuple[str, ...]]:
    """Path of every field in any fingerprint of a plan; a plugin's in a list of plugins as in one alone."""

    def paths(value: Any) -> Iterator[tuple[str, ...]]:
        for key, one in value.items():
            plugins = [one] if isinstance(one, Mapping) else one if isinstance(one, list) else []
            inner = [part for part in plugins if isinstance(part, Mapping) and key not in ("code", "packages")]
            yield from ((key, *path) for part in inner for path in paths(part))
            if not inner:
                yield (key,)

    return {path for step in plan.steps.values() for path in paths(step.entry.fields)}


def test_without_a_defect_every_row_is_right(config, meshes):
    assert list(wrong_rows(config, meshes)) == []


@pytest.mark.slow  # many plans
def test_each_field_left_out_makes_a_row_wrong(config, meshes, monkeypatch):
    """But for `stage`, which the result's folder tells as well, and names where the code says the same."""
    config = replace(config, train=replace(config.train, start="regular"))
    found = defects(make_plan(config))
    assert len(found) > 45 and {("mesh",), ("parameters", "controls", "version"), ("code",)} <= found
    redundant = {("stage",)} | {path for path in found if path[-1] == "name"}
    caught = set()
    for path in sorted(found - redundant):
        with monkeypatch.context() as patch:
            defective = lambda fields, path=path: fingerprint(without(dict(fields), path))  # noqa: E731
            patch.setattr(z2p_renderer.storage.results.store, "fingerprint", defective)
            patch.setattr(z2p_renderer.workflows.plan, "fingerprint", defective)
            if next(wrong_rows(config, meshes, path[-1]), None):
                caught.add(path)
    assert found - redundant - caught == set()
