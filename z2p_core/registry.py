"""Finds and loads plugins, built-in or of other packages, through entry points."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint, EntryPoints, entry_points
from typing import Any

GROUPS = {
    "controls": "Control",
    "zbuffers": "ZBuffer",
    "gbuffers": "GBuffer",
    "conditions": "Condition",
    "encoders": "PositionalEncoder",
    "engines": "Engine",
    "samplers": "Sampler",
    "textures": "Texture",
    "readers": "Reader",
    "baselines": "Baseline",
    "painters": "Painter",
}
"""Short group name -> interface class in `z2p_core.interfaces`. The entry-point group is ``z2p.<short name>``."""


class PluginError(LookupError):
    """A plugin that is unknown, ambiguous or broken; the message names it and what is installed."""


@dataclass(frozen=True)
class Plugin:
    """A plugin's entry point, read without importing the plugin."""

    group: str
    name: str
    origin: str
    """Distribution and its version, e.g. ``z2p-renderer 0.1.0``."""
    target: str
    """The plugin class as ``module:name``."""


def names(group: str) -> list[str]:
    """Installed plugin names of a group, sorted; broken ones included."""
    return sorted(_entries(group))


def installed(group: str) -> list[Plugin]:
    """Every installed plugin of a group with where it comes from; nothing is imported."""
    return [
        Plugin(group, name, _origin(entry), entry.value)
        for name, entries in sorted(_entries(group).items())
        for entry in entries
    ]


def is_builtin(group: str, name: str) -> bool:
    """Whether the plugin of that name comes from z2p and from no other package; nothing is imported."""
    entries = _entries(group).get(name, ())
    return bool(entries) and all(entry.value.startswith("z2p_renderer.plugins.") for entry in entries)


def load(group: str, name: str) -> type[Any]:
    """The plugin class registered as `name` in `group` (a key of `GROUPS`).

    Raises:
        PluginError: no such plugin, two packages claim the name, or its import fails.
    """
    entries = _entries(group).get(name, ())
    if not entries:
        known = ", ".join(names(group)) or "none"
        raise PluginError(f"unknown {group[:-1]} {name!r}; installed: {known}")
    if len(entries) > 1:
        origins = " and ".join(_origin(entry) for entry in entries)
        raise PluginError(f"{group[:-1]} {name!r} is claimed by {origins}; uninstall one of them")
    return _load_entry(group, name, entries[0])


def _load_entry(group: str, name: str, entry: EntryPoint) -> type[Any]:
    try:
        plugin = entry.load()
    except Exception as error:  # a plugin's import may raise anything; the message names the plugin
        raise PluginError(
            f"{group[:-1]} {name!r} from {_origin(entry)} fails to load ({entry.value}): "
            f"{type(error).__name__}: {error}; repair or uninstall that package"
        ) from error
    from z2p_core import interfaces  # late: names() and installed() stay free of numpy

    expected = getattr(interfaces, GROUPS[group])
    if not (isinstance(plugin, type) and issubclass(plugin, expected)):
        raise PluginError(f"{group[:-1]} {name!r} from {_origin(entry)}: expected a subclass of {expected.__name__}, "
                          f"got {plugin!r}")
    return plugin


def _origin(entry: EntryPoint) -> str:
    if entry.dist is None:
        return "an unnamed package"
    metadata = entry.dist.metadata  # parsed anew at each access
    return f"{metadata['Name']} {metadata['Version']}"


@cache
def _all_entry_points(path: tuple[str, ...]) -> EntryPoints:
    """The entry points of all packages on the path, read once for all groups."""
    return entry_points()  # type: ignore[return-value]  # up to 3.11 a subclass of dict, which selects as well


@cache
def _entries(group: str) -> dict[str, tuple[EntryPoint, ...]]:
    if group not in GROUPS:
        raise PluginError(f"unknown plugin group {group!r}; groups: {', '.join(GROUPS)}")
    by_name: dict[str, list[EntryPoint]] = {}
    for entry in _all_entry_points(tuple(sys.path)).select(group=f"z2p.{group}"):
        by_name.setdefault(entry.name, []).append(entry)
    origins: dict[int, str] = {}
    return {name: _without_duplicates(entries, origins) for name, entries in by_name.items()}


def _without_duplicates(entries: list[EntryPoint], origins: dict[int, str]) -> tuple[EntryPoint, ...]:
    """The entries of one name, each once: an editable install beside its build folder lists the same one twice.

    `origins` caches the packages' origins, whose metadata takes milliseconds to parse.
    """
    if len(entries) == 1:
        return (entries[0],)
    unique = {}
    for entry in entries:
        if id(entry.dist) not in origins:
            origins[id(entry.dist)] = _origin(entry)
        unique[origins[id(entry.dist)], entry.value] = entry
    return tuple(unique.values())
