"""The report: one self-contained HTML page, its numbers as JSON, and every row as CSV."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from z2p_core import __version__
from z2p_core.config import to_dict
from z2p_core.config.report import SWEEP_NAMES, ReportConfig
from z2p_renderer.pipeline.evaluation.paper.capability_table import CAPABILITIES
from z2p_renderer.pipeline.evaluation.paper.methods import BASELINE, TRUTH, WEIGHTS, Method
from z2p_renderer.pipeline.evaluation.paper.page.captions import SWEEP_CAPTIONS
from z2p_renderer.pipeline.evaluation.paper.page.color_fidelity import color_errors, color_table
from z2p_renderer.pipeline.evaluation.paper.page.plots import plot_sweep, thumbnail
from z2p_renderer.pipeline.evaluation.paper.page.results import CONTRAST_KEPT, METRICS, Results, read_results
from z2p_renderer.pipeline.evaluation.paper.page.summary import summarize
from z2p_renderer.pipeline.evaluation.paper.page.tables import (
    Table,
    capabilities_table,
    level_table,
    means_table,
    network_times_table,
    reconstruction_times_table,
    uncertainty_table,
)
from z2p_renderer.pipeline.evaluation.paper.timing import TIMES_FILE
from z2p_renderer.pipeline.evaluation.paper.uncertainty import UNCERTAINTY_FILE
from z2p_renderer.storage.files.atomic_write import atomic_write
from z2p_renderer.storage.models.checkpoints import find_weights, load_weights

CSV_COLUMNS = ("sweep", "mesh", "view", "level", "x", "method", "points", "psnr_white", "psnr_foreground", "ssim",
               "flip", "alpha_l1", "shadow_l1", "shadow_kept", "contrast_kept", "seconds", "error", "result",
               "picture")  # fmt: skip
MISSING_PARTS = (
    ("Ablation, AdaIN against input channels", "needs weights trained with the settings as input channels (z2p ablate "
     "trains and compares them); with them (--weights) they appear in the density sweep beside the others"),
    ("Ablation, positional encoding", "needs weights trained without it (z2p ablate); with them the lifted object "
     "shows it"),
    ("The paper's network", "needs the weights of configs/paper.toml; with them it is one more method everywhere"),
    ("Weights for noise", "the noise sweep's second row needs the weights of configs/denoise.toml"),
    ("Metallic and roughness", "the material sweep needs the weights of configs/material.toml"),
)  # fmt: skip
"""Parts of the paper's evaluation that need other weights, and which; see `_list_missing_parts`."""


@dataclass(frozen=True)
class Strip:
    """Rows of small pictures under common columns."""

    title: str
    columns: Sequence[str]
    rows: Sequence[tuple[str, Sequence[str]]]


@dataclass(frozen=True)
class Section:
    """A section of the page; its field names are used by the template."""

    key: str
    title: str
    text: str
    command: str
    plots: Sequence[str] = ()
    strips: Sequence[Strip] = ()
    tables: Sequence[Table] = field(default_factory=list)


def write_report(
    folders: Mapping[str, Path], methods: Sequence[Method], config: ReportConfig, command: str, out: Path
) -> list[Path]:
    """Writes ``report.html``, ``report.json`` and ``report.csv`` to `out` from the results' folders by step name.

    Raises:
        OSError: a result is missing.
    """
    results = read_results(folders, methods)
    times = json.loads((folders["times"] / TIMES_FILE).read_text(encoding="utf-8"))
    trust = [
        json.loads((folder / UNCERTAINTY_FILE).read_text(encoding="utf-8"))
        | dict(
            zip(("mesh", "method"), name.split("/")[1:], strict=True)
        )  # the step's names: meshes may have been renamed
        for name, folder in folders.items()
        if name.startswith("trust/")
    ]
    summary = summarize(results, list(config.sweeps()))
    table, verdicts = capabilities_table(results)
    colors = color_errors(results, folders, "color")
    sections = [_capabilities_section(table, command), _times_section(times, command)]
    further_tables = {"color": [color_table(colors)]}
    sections += [
        _sweep_section(results, folders, sweep, command, further_tables.get(sweep, [])) for sweep in config.sweeps()
    ]
    sections += _uncertainty_sections(trust, folders, command)
    sections += _scan_sections(results, folders, command)
    missing = _list_missing_parts(results, config)
    _write_page(out / "report.html", config, summary, sections, missing, results, command)
    content = {
        "version": __version__, "command": command, "lead": summary, "config": to_dict(config),
        "methods": [asdict(method) for method in methods], "absent": [list(one) for one in missing],
        "abilities": {name: {key: asdict(one) for key, one in own.items()} for name, own in verdicts.items()},
        "ability_tests": {one.key: one.test for one in CAPABILITIES}, "times": times, "trust": trust,
        "color_errors": {name: [asdict(one) for one in own] for name, own in colors.items()},
        "rows": list(results.every),
    }  # fmt: skip
    atomic_write((json.dumps(content, indent=1) + "\n").encode(), out / "report.json")
    atomic_write(_as_csv(results.every).encode(), out / "report.csv")
    return [out / name for name in ("report.html", "report.json", "report.csv")]


def _capabilities_section(table: Table, command: str) -> Section:
    text = "What each method can do, as in the paper's Table 1; every tick of a method that runs here was tested."
    return Section("abilities", "Table 1: what each method can do", text, command, tables=[table])


def _times_section(times: Mapping[str, Any], command: str) -> Section:
    tables = [network_times_table(times), reconstruction_times_table(times)]
    text = "Measured in one run, one after the other."
    return Section("times", "Tables 2 and 3: times", text, command, tables=tables)


def _sweep_section(
    results: Results, folders: Mapping[str, Path], sweep: str, command: str, further_tables: Sequence[Table]
) -> Section:
    """Section of a sweep: curves, tables (including `further_tables`) and strips of pictures."""
    caption = SWEEP_CAPTIONS[sweep]
    has_contrast = any(CONTRAST_KEPT in row for row in results.every if row["sweep"] == sweep)
    differences = ("psnr_foreground", "ssim", "flip") if not has_contrast or sweep == "texture" else ()
    metrics = (*((CONTRAST_KEPT,) if has_contrast else ()), *differences)
    has_levels = len(results.levels(sweep)) > 1
    plots = [plot_sweep(results, sweep, caption.axis, caption.is_log_scale, metrics)] if has_levels else []
    if sweep == "base":
        tables = [means_table(results, sweep, "Means over meshes and views")]
    else:
        tables = [
            level_table(results, sweep, one, "contrast kept" if one == CONTRAST_KEPT else METRICS[one][0])
            for one in metrics
        ]
    tables += further_tables
    meshes = [mesh for mesh in results.meshes(sweep) if mesh]
    text = caption.description + (f" Meshes: {', '.join(meshes)}." if meshes else " Shapes made for it.")
    text += f" In the paper: {caption.paper_reference}." if caption.paper_reference else ""
    strips = [
        _sweep_strip(results, folders, sweep, mesh) for mesh in results.meshes(sweep)[: 1 if has_levels else None]
    ]
    if not has_levels:
        strips = [_join_strips(strips)]
    return Section(sweep, caption.title, text, f"{_without_sweeps(command)} --sweeps {sweep}", plots, strips, tables)


def _sweep_strip(results: Results, folders: Mapping[str, Path], sweep: str, mesh: str) -> Strip:
    """Strip of a mesh's first view: rows for the points, each method and the ground truth."""
    title, rows = mesh or "shapes", []
    truth = [row for row in results.rows(sweep, TRUTH) if row["mesh"] == mesh and row["view"] == 0]
    folder = folders[f"measure/{sweep}/{title}/truth"]
    rows.append(("points", [thumbnail(folder / f"input_{row['picture']}") for row in truth]))
    for name in (*(method.name for method in results.methods), TRUTH):
        own = {row["level"]: row for row in results.rows(sweep, name) if row["mesh"] == mesh and row["view"] == 0}
        folder = folders[f"measure/{sweep}/{title}/{name}"]
        cells = [thumbnail(folder / own[row["level"]]["picture"]) if "picture" in own[row["level"]] else ""
                 for row in truth]  # fmt: skip
        rows.append((name, cells))
    return Strip(title, [row["level"] for row in truth], rows)


def _join_strips(strips: Sequence[Strip]) -> Strip:
    """Joins strips of one column each into one strip with a column per mesh."""
    names = [name for name, _ in strips[0].rows]
    cells = [[cell for strip in strips for cell in strip.rows[index][1]] for index in range(len(names))]
    columns = [strip.title for strip in strips for _ in strip.columns]
    return Strip("", columns, list(zip(names, cells, strict=True)))


def _uncertainty_sections(
    trust: Sequence[Mapping[str, Any]], folders: Mapping[str, Path], command: str
) -> list[Section]:
    if not trust:
        return []
    table, verdict = uncertainty_table(trust)
    text = (
        "Is there a map that says where the picture is invented? Disagreement is the spread of pictures that are "
        f"each drawn from half of the points. {verdict} Maps and errors are shown four times as bright."
    )
    strips = []
    for one in trust[:4]:
        folder = folders[f"trust/{one['mesh']}/{one['method']}"]
        names = ("picture", "error", "disagreement")
        cells = [thumbnail(folder / f"{name}.png") for name in names]
        strips.append(Strip(one["mesh"], names, [(one["method"], cells)]))
    return [Section("trust", "Trust", text, command, strips=strips, tables=[table])]


def _scan_sections(results: Results, folders: Mapping[str, Path], command: str) -> list[Section]:
    names = [method.name for method in results.methods if f"scans/{method.name}" in folders]
    if not names:
        return []
    columns = results.levels("scans")
    first = folders[f"scans/{names[0]}"]
    rows = [("points", [thumbnail(first / f"input_{row['picture']}") for row in results.rows("scans", names[0])])]
    rows += [(name, [thumbnail(folders[f"scans/{name}"] / row["picture"])
                     for row in results.rows("scans", name)]) for name in names]  # fmt: skip
    text = "Nobody knows the true surface, so there are no numbers; scans of more than 20,000 points are thinned."
    return [Section("scans", "Real scans", text, command, strips=[Strip("scans", columns, rows)])]


def _list_missing_parts(results: Results, config: ReportConfig) -> list[tuple[str, str]]:
    """(title, what it needs) of each part of the paper's evaluation that this report lacks."""
    weights = [method for method in results.methods if method.kind == WEIGHTS]
    cards = [load_weights(find_weights(method.source)).card for method in weights]  # names of weights are arbitrary
    is_paper = any(card["network"]["kind"] == "adain_unet" for card in cards)
    is_noisy = any(card["training"].get("noise", "none") != "none" for card in cards)
    has_material = any("psnr_white" in row for method in weights for row in results.rows("material", method.name))
    is_present = {MISSING_PARTS[2][0]: is_paper, MISSING_PARTS[3][0]: is_noisy, MISSING_PARTS[4][0]: has_material}
    missing = [(title, why) for title, why in MISSING_PARTS if not is_present.get(title)]
    missing += [(SWEEP_CAPTIONS[sweep].title, "left out by the config or by --sweeps") for sweep in SWEEP_NAMES
              if sweep not in config.sweeps()]  # fmt: skip
    if not config.scans:
        missing.append(("Real scans", "no folder of scans was given (--scans)"))
    missing.append(
        ("Point2Mesh, DSS, neural point rendering, ray tracing", "do not run here; Table 1 quotes the paper")
    )
    return missing


def _write_page(
    path: Path, config: ReportConfig, summary: str, sections: Sequence[Section], missing: Sequence[tuple[str, str]],
    results: Results, command: str,
) -> None:  # fmt: skip
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(loader=PackageLoader("z2p_renderer.pipeline"), autoescape=True, undefined=StrictUndefined)
    facts = [("Command", command), ("Meshes", ", ".join(mesh for mesh in results.meshes("base"))),
             ("Weights", ", ".join(results.named(WEIGHTS)) or "none"),
             ("Baselines", ", ".join(results.named(BASELINE)) or "none"),
             ("Points, views, seed", f"{config.points}, {config.views} a mesh, {config.seed}"),
             ("Truth and baselines' renders", f"Cycles, {config.resolution}x{config.resolution}, {config.samples} "
              f"samples, denoising {config.denoise}")]  # fmt: skip
    page = environment.get_template("report.html").render(
        title=config.name, version=__version__, summary=summary, facts=facts, sections=sections, missing=missing
    )
    atomic_write(page.encode(), path)


def _without_sweeps(command: str) -> str:
    words = command.split(" --sweeps ")
    return words[0]


def _as_csv(rows: Iterable[Mapping[str, Any]]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, CSV_COLUMNS, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    writer.writerows({key: "" if value is None else value for key, value in row.items()} for row in rows)
    return text.getvalue()
