"""`z2p plugins` and `z2p formats`: what is installed and where it comes from."""

from __future__ import annotations

import json
from typing import Any

import click

from z2p_core import registry
from z2p_core.registry import Plugin, PluginError


@click.command()
@click.option("--json", "as_json", is_flag=True, help="Print a JSON list instead of a table.")
def plugins(as_json: bool) -> None:
    """List the installed plugins with their package and version.

    Each plugin is loaded; one that fails to load is listed as broken, with the reason.
    """
    rows = [_plugin_row(plugin) for group in registry.GROUPS for plugin in registry.installed(group)]
    if as_json:
        click.echo(json.dumps(rows, indent=2))
        return
    _echo_table(
        ["group", "name", "version", "package", "status"],
        [[row["group"], row["name"], row["version"] or "-", row["origin"], row["error"] or "ok"] for row in rows],
    )


@click.command()
@click.option("--json", "as_json", is_flag=True, help="Print a JSON list instead of a table.")
def formats(as_json: bool) -> None:
    """List the readable point-cloud formats: suffix, reader and the reader's package."""
    rows = []
    for plugin in registry.installed("readers"):
        reader, error = _load_plugin(plugin)
        if reader is None:
            click.echo(f"Warning: {error}", err=True)
            continue
        rows += [{"suffix": suffix, "reader": plugin.name, "origin": plugin.origin} for suffix in reader.suffixes]
    rows.sort(key=lambda row: (row["suffix"], row["reader"]))
    if as_json:
        click.echo(json.dumps(rows, indent=2))
        return
    _echo_table(["suffix", "reader", "package"], [list(row.values()) for row in rows])


def _plugin_row(plugin: Plugin) -> dict[str, Any]:
    loaded, error = _load_plugin(plugin)
    distribution, _, distribution_version = plugin.origin.rpartition(" ")
    return {
        "group": plugin.group,
        "name": plugin.name,
        "version": None if loaded is None else str(getattr(loaded, "version", "")),
        "origin": plugin.origin,
        "distribution": distribution,
        "distribution_version": distribution_version,
        "target": plugin.target,
        "status": "broken" if error else "ok",
        "error": error,
    }


def _load_plugin(plugin: Plugin) -> tuple[Any, str | None]:
    """(class of the plugin, None), or (None, the reason why it fails to load)."""
    try:
        return registry.load(plugin.group, plugin.name), None
    except PluginError as error:
        return None, " ".join(f"broken: {error}".split())


def _echo_table(titles: list[str], rows: list[list[str]]) -> None:
    widths = [max(len(row[column]) for row in [titles, *rows]) for column in range(len(titles))]
    for row in [titles, *rows]:
        click.echo("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())
