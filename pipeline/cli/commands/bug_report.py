"""`z2p report`: what a bug report needs."""

from __future__ import annotations

import json
import os
import platform
import sys
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import click

from z2p_core import __version__, registry
from z2p_core.errors.messages import error_reason

PACKAGES = ("numpy", "onnxruntime", "openvino", "torch", "onnx",
            "pillow", "click", "safetensors", "trimesh", "pypcd4", "laspy", "lazrs", "jinja2", "cmap", "matplotlib",
            "pye57", "imageio-ffmpeg", "luigi", "bpy", "open3d", "open3d-cpu", "h5py", "kornia")  # fmt: skip


@click.command()
@click.option("--json", "as_json", is_flag=True, help="Print JSON instead of text.")
def report(as_json: bool) -> None:
    """Print what a bug report needs: versions, machine, weights and plugins. It holds no user name and no path."""
    facts = _collect_facts()
    if as_json:
        click.echo(json.dumps(facts, indent=2))
        return
    for title, rows in facts.items():
        click.echo(title)
        for name, value in rows.items():
            click.echo(f"  {name:<18} {value}")


def _collect_facts() -> dict[str, dict[str, Any]]:
    """Section -> {name: value}; nothing in them identifies the user."""
    from z2p_renderer.storage.models.checkpoints import shipped_weights
    from z2p_renderer.storage.results.fingerprints import file_digest
    from z2p_renderer.storage.scans.memory_limit import free_memory

    free = free_memory()
    machine = {
        "system": f"{platform.system()} {platform.release()}",
        "processor": f"{platform.machine()}, {os.cpu_count()} cores",
        "free memory": "unknown" if free is None else f"{free / 1e9:.1f} GB",
        "python": platform.python_version(),
        "encoding": f"{sys.getfilesystemencoding()}, terminal {getattr(sys.stdout, 'encoding', None)}",
    }
    weights = {name: f"sha256 {file_digest(path)[:16]}" for name, path in shipped_weights().items()}
    return {
        "z2p": {"version": __version__},
        "machine": machine,
        "packages": {name: _version(name) for name in PACKAGES},
        "weights": weights,
        "plugins": _plugin_lines(),
    }


def _plugin_lines() -> dict[str, str]:
    """Group -> names of its plugins, each with its package if it is not z2p's, and with why it is broken if it is."""
    groups: dict[str, str] = {}
    for group in registry.GROUPS:
        names = []
        for plugin in registry.installed(group):
            try:
                registry.load(group, plugin.name)
                broken = ""
            except registry.PluginError as error:
                broken = f" BROKEN: {error_reason(error)}"
            origin = "" if plugin.origin.startswith("z2p-renderer ") else f" ({plugin.origin})"
            names.append(f"{plugin.name}{origin}{broken}")
        groups[group] = ", ".join(names)
    return groups


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "-"
