"""Fingerprints: what a stage's result depends on, as one sha256. Equal fingerprints promise equal results.

A fingerprint covers parameters, upstream fingerprints, input bytes, plugin versions and code, but not workers, threads,
folders or log levels.
"""

from __future__ import annotations

import hashlib
import inspect
import json
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from z2p_core import registry
from z2p_renderer.storage.results.code_digest import code_digest, imported_modules, module_file
from z2p_renderer.storage.results.stage_dependencies import installed_version, stage_code, stage_packages

SCHEMA = 2
"""Raised when the meaning of the fields themselves changes; every result becomes stale."""

STAGE_VERSIONS: dict[str, int] = {
    "shapes": 1, "sample": 1, "render": 1, "shard": 2, "train": 2, "evaluate": 1, "reference": 1, "textured": 1,
    "textured_render": 1,
    "measure": 1, "scans": 1, "times": 1, "trust": 1, "report": 1,
    "compare": 1,
}  # fmt: skip
"""Raised by hand when a stage's code starts to give other results; the stage and all downstream become stale."""
RENDER_STAGE, TEXTURED_RENDER_STAGE = "render", "textured_render"
"""The stages whose results are chunks of views: of meshes in one color, and of meshes some of which have textures."""
RENDER_STAGES = (RENDER_STAGE, TEXTURED_RENDER_STAGE)
PACKAGE_FILE = "__init__.py"
PLUGIN_KEYS = {"name", "version", "code"}
"""Keys of `plugin_fields`, and of nothing else in an entry's fields."""


def fingerprint(fields: Mapping[str, Any]) -> str:
    """sha256 (64 hex digits) of the fields' canonical JSON: sorted keys, no spaces, tuples as lists.

    Raises:
        TypeError: a field that JSON cannot hold.
        ValueError: a float that is not finite.
    """
    return hashlib.sha256(canonical_json(fields).encode()).hexdigest()


def canonical_json(value: Any) -> str:
    """The one JSON text of a value: equal values give equal texts."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)


def stage_fields(stage: str) -> dict[str, Any]:
    """Fields that every entry of a built-in stage starts with: schema, stage, its version, its code and packages.

    Raises:
        KeyError: a stage without a version in `STAGE_VERSIONS`.
    """
    return {
        "schema": SCHEMA,
        "stage": stage,
        "stage_version": STAGE_VERSIONS[stage],
        "code": stage_code(stage),
        "packages": stage_packages(stage),
    }


def file_digest(path: Path) -> str:
    """sha256 (64 hex digits) of a file's bytes.

    Raises:
        OSError: the file cannot be read.
    """
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def plugin_fields(plugin: type[Any]) -> dict[str, str]:
    """Name, version and code digest of a plugin class; results that use the plugin depend on all three.

    The digest includes the modules of its own package that the plugin's module imports, directly or not, and the
    versions of the `packages` that the class declares.

    Raises:
        ValueError: the class does not come from a Python file.
    """
    source = inspect.getsourcefile(plugin)
    if source is None:
        raise ValueError(f"plugin {plugin!r}: expected a class from a Python file, found no source")
    digests = _package_digests(plugin.__module__, Path(source))
    code = digests[0] if len(digests) == 1 else fingerprint({"modules": digests})
    versions = {package: installed_version(package) for package in getattr(plugin, "packages", ())}
    if versions:
        code = fingerprint({"code": code, "packages": versions})
    return {"name": plugin.name, "version": plugin.version, "code": code}


def changed_plugins(fields: Mapping[str, Any]) -> list[str]:
    """Names of the plugins in an entry's fields whose code on the disk differs by now, or is gone."""
    plugins = _iter_plugin_fields(fields)
    return [plugin["name"] for plugin in plugins if dict(plugin) not in list(_installed_plugin_fields(plugin["name"]))]


def _iter_plugin_fields(value: Any) -> Iterator[Mapping[str, str]]:
    """Every `plugin_fields` in a nested value."""
    if isinstance(value, Mapping) and set(value) == PLUGIN_KEYS:
        yield value
    elif isinstance(value, Mapping | list | tuple):
        for one in value.values() if isinstance(value, Mapping) else value:
            yield from _iter_plugin_fields(one)


def _installed_plugin_fields(name: str) -> Iterator[dict[str, str]]:
    """`plugin_fields` of all installed plugins of that name; plugins of two groups may share a name."""
    for group in registry.GROUPS:
        if name in registry.names(group):
            with suppress(registry.PluginError, OSError):  # broken by an edit: no longer what it was
                yield plugin_fields(registry.load(group, name))


def _package_digests(module: str, path: Path) -> list[str]:
    """Digest of a module's code, then those of the modules that it imports, directly or not, from its own package."""
    package, *below = module.split(".")
    packaged = path.name == PACKAGE_FILE
    root = path.parents[min(len(below) + packaged, len(path.parents) - 1)]
    digests: dict[str, str] = {}
    waiting = {module: path}
    while waiting:
        name, source = waiting.popitem()
        text = source.read_text(encoding="utf-8")
        digests[name] = code_digest(text)
        if not (below or packaged):
            break  # a top-level module belongs to no package
        for imported in imported_modules(text, f"{name}.__init__" if source.name == PACKAGE_FILE else name):
            file = module_file(imported, root)
            if imported.split(".")[0] == package and imported not in digests and file.is_file():
                waiting[imported] = file
    return [digests.pop(module), *(digests[name] for name in sorted(digests))]
