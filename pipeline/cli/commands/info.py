"""`z2p info`: what made a picture, as its record says."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from z2p_renderer.pipeline.cli.errors import ExitStatus


@click.command()
@click.argument("figures", nargs=-1, required=True, metavar="FIGURE...", type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="Print the whole record, one JSON line for each figure.")
def info(figures: tuple[Path, ...], as_json: bool) -> None:
    """Show what made a picture: its scan, camera, controls, weights and version.

    \b
    z2p info fig.png
    z2p info fig.png --json
    """
    from z2p_renderer.storage.files.printable_names import printable
    from z2p_renderer.storage.images.image_files import PictureError, read_record

    failed = False
    for figure in figures:
        try:
            record = read_record(figure, complete=not as_json)
        except PictureError as error:
            failed = True
            click.echo(f"failed: {error}", err=True)
            continue
        if as_json:
            click.echo(json.dumps({"figure": str(figure), **record}))
        else:
            click.echo("\n".join([printable(figure), *(f"  {key:<11} {text}" for key, text in _record_rows(record))]))
    if failed:
        click.get_current_context().exit(ExitStatus.SOME_FAILED)


def _record_rows(record: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The table that people read: (name, text) for each part of a complete record."""
    from z2p_renderer.pipeline.outputs.gallery import placement_rows

    source, stance, weights = record["input"], record["stance"], record["weights"]
    rows = [("scan", f"{source.get('name') or 'an array in Python'}  sha256 {source['sha256'][:16]}")]
    if source["cloud"]:
        rows.append(("cloud", f"number {source['cloud'] + 1} of the file"))
    rows += [(name, ", ".join(f"{number:g}" for number in value)) for name, value in record["controls"].items()]
    rows += [
        ("up", f"{stance['up']}: {stance['up_reason']}"),
        ("view", f"azimuth {stance['azimuth']:g}, {stance['view_reason']}"),
        ("camera", f"centre {', '.join(f'{number:.6g}' for number in record['camera']['centre'])}; "
                   f"radius {record['camera']['radius']:.6g}; elevation {record['camera']['elevation']:g}"),
        ("left out", f"outliers: {stance['outliers']}, points far behind: {stance['background']}"),
        *placement_rows(record),
        ("smooth", f"over {stance['smooth']:.2g} of the frame's radius" if stance.get("smooth") else "as it is"),
        ("size", f"{record['resolution'][0]} x {record['resolution'][1]}, supersample {record['supersample']}, "
                 f"fit {record['fit']}"),
        ("background", record["background"] if isinstance(record["background"], str) else
         ", ".join(f"{number:g}" for number in record["background"])),
        ("weights", f"{weights['name']}  sha256 {weights['sha256'][:16]}"),
        ("z2p", record["version"]),
    ]  # fmt: skip
    return rows
