"""The report: one page that holds everything, the same numbers as JSON, and every row as CSV."""

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
from z2p_renderer.pipeline.evaluation.paper.page.results import METRICS, CONTRAST_KEPT, Results, read_results
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
from z2p_renderer.storage.models.checkpoints import load_weights, find_weights

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
"""What the paper's evaluation has and only other weights can show, and what they are; `_list_missing_parts` leaves out what is."""


@dataclass(frozen=True)
class Strip:
    """Rows of small pictures under common columns."""

    title: str
    columns: Sequence[str]
    rows: Sequence[tuple[str, Sequence[str]]]


@dataclass(frozen=True)
class Section:
    """A part of the page."""

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
    """``report.html``, ``report.json`` and ``report.csv`` in `out`, of measured results' folders by steps' names.

    Raises:
        OSError: a result is missing.
    """
    findings = read_results(folders, methods)
    times = json.loads((folders["times"] / TIMES_FILE).read_text(encoding="utf-8"))
    trust = [json.loads((folder / UNCERTAINTY_FILE).read_text(encoding="utf-8"))
             | dict(zip(("mesh", "method"), name.split("/")[1:], strict=True))  # of today: files may be renamed
             for name, folder in folders.items() if name.startswith("trust/")]  # fmt: skip
    first = summarize(findings, list(config.sweeps()))
    table, verdicts = capabilities_table(findings)
    colors = color_errors(findings, folders, "color")
    sections = [_capabilities_section(table, command), _times_section(times, command)]
    further = {"color": [color_table(colors)]}
    sections += [_sweep_section(findings, folders, sweep, command, further.get(sweep, [])) for sweep in config.sweeps()]
    sections += _uncertainty_sections(trust, folders, command)
    sections += _scan_sections(findings, folders, command)
    absent = _list_missing_parts(findings, config)
    _write_page(out / "report.html", config, first, sections, absent, findings, command)
    told = {
        "version": __version__, "command": command, "lead": first, "config": to_dict(config),
        "methods": [asdict(method) for method in methods], "absent": [list(one) for one in absent],
        "abilities": {name: {key: asdict(one) for key, one in found.items()} for name, found in verdicts.items()},
        "ability_tests": {one.key: one.test for one in CAPABILITIES}, "times": times, "trust": trust,
        "color_errors": {name: [asdict(one) for one in found] for name, found in colors.items()},
        "rows": list(findings.every),
    }  # fmt: skip
    atomic_write((json.dumps(told, indent=1) + "\n").encode(), out / "report.json")
    atomic_write(_as_csv(findings.every).encode(), out / "report.csv")
    return [out / name for name in ("report.html", "report.json", "report.csv")]


def _capabilities_section(table: Table, command: str) -> Section:
    text = "What each method can do, as in the paper's Table 1; every tick of a method that runs here was tested."
    return Section("abilities", "Table 1: what each method can do", text, command, tables=[table])


def _times_section(times: Mapping[str, Any], command: str) -> Section:
    tables = [network_times_table(times), reconstruction_times_table(times)]
    text = "Measured in one run, one after the other."
    return Section("times", "Tables 2 and 3: times", text, command, tables=tables)


def _sweep_section(
    findings: Results, folders: Mapping[str, Path], sweep: str, command: str, further: Sequence[Table]
) -> Section:
    """A sweep's curves, tables, those further ones among them, and strips."""
    kind, kept = SWEEP_CAPTIONS[sweep], any(CONTRAST_KEPT in row for row in findings.every if row["sweep"] == sweep)
    figures = (CONTRAST_KEPT,) if kept else ("psnr_foreground", "ssim", "flip")
    several = len(findings.levels(sweep)) > 1
    plots = [plot_sweep(findings, sweep, kind.axis, kind.log, figures)] if several else []
    if sweep == "base":
        tables = [means_table(findings, sweep, "Means over meshes and views")]
    else:
        tables = [level_table(findings, sweep, figure, CONTRAST_KEPT.replace("_", " ") if kept else METRICS[figure][0])
                  for figure in figures]  # fmt: skip
    tables += further
    meshes = [mesh for mesh in findings.meshes(sweep) if mesh]
    text = kind.shows + (f" Meshes: {', '.join(meshes)}." if meshes else " Shapes made for it.")
    text += f" In the paper: {kind.figure}." if kind.figure else ""
    strips = [_sweep_strip(findings, folders, sweep, mesh) for mesh in findings.meshes(sweep)[:1 if several else None]]
    if not several:
        strips = [_join_strips(strips)]
    return Section(sweep, kind.title, text, f"{_without_sweeps(command)} --sweeps {sweep}", plots, strips, tables)


def _sweep_strip(findings: Results, folders: Mapping[str, Path], sweep: str, mesh: str) -> Strip:
    """The first view of a mesh: the points, each method, the truth."""
    of, rows = mesh or "shapes", []
    truth = [row for row in findings.rows(sweep, TRUTH) if row["mesh"] == mesh and row["view"] == 0]
    folder = folders[f"measure/{sweep}/{of}/truth"]
    rows.append(("points", [thumbnail(folder / f"input_{row['picture']}") for row in truth]))
    for name in (*(method.name for method in findings.methods), TRUTH):
        own = {row["level"]: row for row in findings.rows(sweep, name) if row["mesh"] == mesh and row["view"] == 0}
        folder = folders[f"measure/{sweep}/{of}/{name}"]
        cells = [thumbnail(folder / own[row["level"]]["picture"]) if "picture" in own[row["level"]] else ""
                 for row in truth]  # fmt: skip
        rows.append((name, cells))
    return Strip(of, [row["level"] for row in truth], rows)


def _join_strips(strips: Sequence[Strip]) -> Strip:
    """One strip with a column a mesh, of strips with one column each."""
    names = [name for name, _ in strips[0].rows]
    cells = [[cell for strip in strips for cell in strip.rows[index][1]] for index in range(len(names))]
    columns = [strip.title for strip in strips for _ in strip.columns]
    return Strip("", columns, list(zip(names, cells, strict=True)))


def _uncertainty_sections(trust: Sequence[Mapping[str, Any]], folders: Mapping[str, Path], command: str) -> list[Section]:
    if not trust:
        return []
    table, verdict = uncertainty_table(trust)
    text = ("Is there a map that says where the picture is invented? Disagreement is the spread of pictures that are "
            f"each drawn from half of the points. {verdict} Maps and errors are shown four times as bright.")
    strips = []
    for one in trust[:4]:
        folder = folders[f"trust/{one['mesh']}/{one['method']}"]
        names = ("picture", "error", "disagreement")
        cells = [thumbnail(folder / f"{name}.png") for name in names]
        strips.append(Strip(one["mesh"], names, [(one["method"], cells)]))
    return [Section("trust", "Trust", text, command, strips=strips, tables=[table])]


def _scan_sections(findings: Results, folders: Mapping[str, Path], command: str) -> list[Section]:
    names = [method.name for method in findings.methods if f"scans/{method.name}" in folders]
    if not names:
        return []
    columns = findings.levels("scans")
    first = folders[f"scans/{names[0]}"]
    rows = [("points", [thumbnail(first / f"input_{row['picture']}") for row in findings.rows("scans", names[0])])]
    rows += [(name, [thumbnail(folders[f"scans/{name}"] / row["picture"])
                     for row in findings.rows("scans", name)]) for name in names]  # fmt: skip
    text = "Nobody knows the true surface, so there are no numbers; scans of more than 20,000 points are thinned."
    return [Section("scans", "Real scans", text, command, strips=[Strip("scans", columns, rows)])]


def _list_missing_parts(findings: Results, config: ReportConfig) -> list[tuple[str, str]]:
    """What the paper's evaluation has and this report has not, and what it would take."""
    weights = [method for method in findings.methods if method.kind == WEIGHTS]
    cards = [load_weights(find_weights(method.source)).card for method in weights]  # a name tells nothing for sure
    papers = any(card["network"]["kind"] == "adain_unet" for card in cards)
    noise = any(card["training"].get("noise", "none") != "none" for card in cards)
    material = any("psnr_white" in row for method in weights for row in findings.rows("material", method.name))
    there = {MISSING_PARTS[2][0]: papers, MISSING_PARTS[3][0]: noise, MISSING_PARTS[4][0]: material}
    found = [(title, why) for title, why in MISSING_PARTS if not there.get(title)]
    found += [(SWEEP_CAPTIONS[sweep].title, "left out by the config or by --sweeps") for sweep in SWEEP_NAMES
              if sweep not in config.sweeps()]  # fmt: skip
    if not config.scans:
        found.append(("Real scans", "no folder of scans was given (--scans)"))
    found.append(("Point2Mesh, DSS, neural point rendering, ray tracing", "do not run here; Table 1 quotes the paper"))
    return found


def _write_page(
    path: Path, config: ReportConfig, first: str, sections: Sequence[Section], absent: Sequence[tuple[str, str]],
    findings: Results, command: str,
) -> None:  # fmt: skip
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(loader=PackageLoader("z2p_renderer.pipeline"), autoescape=True, undefined=StrictUndefined)
    facts = [("Command", command), ("Meshes", ", ".join(mesh for mesh in findings.meshes("base"))),
             ("Weights", ", ".join(findings.named(WEIGHTS)) or "none"),
             ("Baselines", ", ".join(findings.named(BASELINE)) or "none"),
             ("Points, views, seed", f"{config.points}, {config.views} a mesh, {config.seed}"),
             ("Truth and baselines' renders", f"Cycles, {config.resolution}x{config.resolution}, {config.samples} "
              f"samples, denoising {config.denoise}")]  # fmt: skip
    page = environment.get_template("report.html").render(
        title=config.name, version=__version__, lead=first, facts=facts, sections=sections, absent=absent
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
