"""The differences between the fields of two fingerprints, described for users."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from z2p_renderer.storage.results.fingerprints import PLUGIN_KEYS

CODE_FIELDS = frozenset({"schema", "stage_version", "code", "packages"})
"""Top-level fields that depend on code alone, not on the config or the input files."""

UPSTREAM_FIELDS = frozenset({"sample", "renders", "shards", "train", "upstream"})
"""Top-level fields that hold fingerprints of other results."""


@dataclass(frozen=True)
class Difference:
    """One field that differs; the old or new value is None where there was none."""

    path: tuple[str, ...]
    old: Any
    new: Any

    @property
    def upstream(self) -> bool:
        """Whether the field refers to an upstream result."""
        return self.path[0] in UPSTREAM_FIELDS

    def __str__(self) -> str:
        head, last = self.path[0], self.path[-1]
        if head == "code":
            return "its code was not yet recorded" if self.old is None and last == "code" else f"code of {last} changed"
        if head == "packages":
            return f"package {last} {_format_value(self.old)} -> {_format_value(self.new)}"
        if head == "stage_version":
            return f"stage version {self.old} -> {self.new}"
        if head == "mesh":
            return "mesh contents changed"
        if head == "meshes":
            return f"meshes of the evaluation changed: {', '.join(_changed_meshes(self.old, self.new))}"
        if self.upstream:
            return f"upstream {head} changed"
        if last == "plugin version":
            return f"plugin {self.path[-2]} version {_format_value(self.old)} -> {_format_value(self.new)}"
        if last == "plugin code":
            return f"plugin {self.path[-2]} code changed"
        name = ".".join(part for part in self.path if part != "parameters")
        return f"{name} {_format_value(self.old)} -> {_format_value(self.new)}"


def compare_fields(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[Difference]:
    """Every difference between the fields of two results of one stage, in the new one's order."""
    old, new = (json.loads(json.dumps(fields)) for fields in (old, new))  # a tuple is a list in a manifest
    differences: list[Difference] = []
    for key in [*new, *(key for key in old if key not in new)]:
        if key not in old or key not in new:
            if key != "packages" or "code" in old:  # the same schema introduced both: report it once
                differences.append(Difference((key,), old.get(key), new.get(key)))
        else:
            differences += _compare_values((key,), old[key], new[key])
    without_schema = [difference for difference in differences if difference.path != ("schema",)]
    return without_schema or differences  # a new schema alone is reported, but adds nothing to other differences


def _compare_values(path: tuple[str, ...], old: Any, new: Any) -> Iterator[Difference]:
    if old == new:
        return
    if _is_plugin(old) and _is_plugin(new) and old["name"] == new["name"]:
        for key in ("version", "code"):
            if old[key] != new[key]:
                yield Difference((*path, old["name"], f"plugin {key}"), old[key], new[key])
    elif _is_plugin(old) and _is_plugin(new):
        yield Difference(path, old["name"], new["name"])
    elif isinstance(old, Mapping) and isinstance(new, Mapping):
        for key in [*new, *(key for key in old if key not in new)]:
            if key not in old or key not in new:
                yield Difference((*path, key), old.get(key), new.get(key))
            else:
                yield from _compare_values((*path, key), old[key], new[key])
    elif _are_plugins(old) and _are_plugins(new) and _plugin_names(old) == _plugin_names(new):
        for old_plugin, new_plugin in zip(old, new, strict=True):
            yield from _compare_values(path, old_plugin, new_plugin)
    else:
        yield Difference(path, old, new)


def _is_plugin(value: Any) -> bool:
    return isinstance(value, Mapping) and set(value) == PLUGIN_KEYS


def _are_plugins(value: Any) -> bool:
    return isinstance(value, list) and all(map(_is_plugin, value))


def _plugin_names(plugins: list[dict[str, str]]) -> list[str]:
    return [plugin["name"] for plugin in plugins]


def _changed_meshes(old: Any, new: Any) -> list[str]:
    before, after = (dict(_mesh_identities(meshes)) for meshes in (old, new))
    return sorted(name for name in {**before, **after} if before.get(name) != after.get(name))


def _mesh_identities(meshes: Any) -> Iterator[tuple[str, str]]:
    """(name, identity) of an evaluation's meshes; a report's page has names only."""
    for mesh in meshes or ():
        yield (mesh, "") if isinstance(mesh, str) else tuple(mesh)


def _format_value(value: Any) -> str:
    """A value in at most 60 characters, or a list of plugins by their names."""
    if value is None:
        return "none"
    if _are_plugins(value) and value:
        return ", ".join(_plugin_names(value))
    text = value if isinstance(value, str) else ", ".join(map(str, value)) if isinstance(value, list) else str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
