"""`z2p info`: what made a picture, as its record says; or what a scan holds beside its points."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from z2p_renderer.pipeline.cli.errors import ExitStatus
from z2p_renderer.pipeline.cli.options.pictures import parse_columns


@click.command()
@click.argument("files", nargs=-1, required=True, metavar="FILE...", type=click.Path(path_type=Path))
@click.option("--columns", metavar="NAMES", help="Names of the columns of text files and .bin, as for z2p render.")
@click.option("--json", "as_json", is_flag=True,
              help="One JSON line for each file: a picture's whole record, or all about a scan's fields.")
def info(files: tuple[Path, ...], as_json: bool, **options: Any) -> None:
    """Show what made a picture, or what a scan holds.

    Of a picture: its scan, camera, controls, weights and version. Of a scan: its points, and the fields that
    `z2p render --color-by` takes, with their ranges, and the points of each class.

    \b
    z2p info fig.png
    z2p info scan.las
    z2p info fig.png --json
    """
    from z2p_core.interfaces import ScanError
    from z2p_renderer.storage.images.image_files import PictureError

    columns, failed = parse_columns(options), False
    for file in files:
        try:
            click.echo(_picture_text(file, as_json) if _is_picture(file) else _scan_text(file, columns, as_json))
        except (PictureError, ScanError) as error:
            failed = True
            click.echo(f"failed: {error}", err=True)
    if failed:
        click.get_current_context().exit(ExitStatus.SOME_FAILED)


def _is_picture(file: Path) -> bool:
    """Whether a file is to be read as a picture: by its suffix, as scans have others."""
    from z2p_renderer.storage.images.animations import ANIMATION_SUFFIXES
    from z2p_renderer.storage.images.image_files import FORMATS
    from z2p_renderer.storage.scans.clouds import format_suffix, readable_suffixes

    suffix = file.suffix.lower()
    return suffix in FORMATS or suffix in ANIMATION_SUFFIXES or format_suffix(file) not in readable_suffixes()


def _picture_text(figure: Path, as_json: bool) -> str:
    """A picture's record: JSON, or the table that people read.

    Raises:
        PictureError: the file cannot be read, or holds no record.
    """
    from z2p_renderer.storage.files.printable_names import printable
    from z2p_renderer.storage.images.image_files import read_record

    record = read_record(figure, complete=not as_json)
    if as_json:
        return json.dumps({"figure": str(figure), **record})
    return "\n".join([printable(figure), *(f"  {key:<11} {text}" for key, text in _record_rows(record))])


def _scan_text(file: Path, columns: tuple[str, ...] | None, as_json: bool) -> str:
    """What a scan holds: JSON, or the table that people read.

    Raises:
        ScanError: the file cannot be read.
    """
    from z2p_renderer.pipeline.coloring.field_summary import summarize_scan, summary_rows
    from z2p_renderer.storage.files.printable_names import printable
    from z2p_renderer.storage.scans.clouds import read_clouds

    clouds = [summarize_scan(scan) for scan in read_clouds(file, columns, wanted=None)]
    if as_json:
        return json.dumps({"scan": str(file), "clouds": clouds})
    lines = [printable(file)]
    for cloud in clouds:
        lines += [f"  {cloud['label']}"] if cloud["label"] else []
        lines += [f"  {key:<20} {text}" for key, text in summary_rows(cloud)]
    return "\n".join(lines)


def _record_rows(record: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The table that people read: (name, text) for each part of a complete record."""
    from z2p_renderer.pipeline.outputs.gallery import color_rows, placement_rows

    source, stance, weights = record["input"], record["stance"], record["weights"]
    rows = [("scan", f"{source.get('name') or 'an array in Python'}  sha256 {source['sha256'][:16]}")]
    if source["cloud"]:
        rows.append(("cloud", f"number {source['cloud'] + 1} of the file"))
    rows += color_rows(record)
    rows += [(name, ", ".join(f"{number:g}" for number in value)) for name, value in record["controls"].items()]
    rows += [
        ("up", f"{stance['up']}: {stance['up_reason']}"),
        ("view", stance["view_reason"] if "pinhole" in record else
         f"azimuth {stance['azimuth']:g}, {stance['view_reason']}"),
        *_pinhole_rows(record),
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


def _pinhole_rows(record: Mapping[str, Any]) -> list[tuple[str, str]]:
    """What a record says of a camera in the data's units; nothing without one."""
    from z2p_core.pinhole import camera_from_json

    if "pinhole" not in record:
        return []
    camera = camera_from_json(record["pinhole"])
    unit = "pixels a unit" if camera.orthographic else "pixels"
    place = ", ".join(f"{number:.6g}" for number in camera.position.tolist())
    ahead = ", ".join(f"{number:.4g}" for number in camera.rotation[2])
    return [("seen from", f"{place}; looking along {ahead}; focal length {camera.focal[0]:.6g}, {camera.focal[1]:.6g} "
             f"{unit}")]
