"""The commands `z2p status`, `verify`, `gc`, `adopt` and `scheduler`, which inspect and maintain a workspace.

`z2p` runs them in a process of their own, as ``python -m z2p_renderer.workflows COMMAND``, because only this package
imports luigi.
"""

from __future__ import annotations

import atexit
import json
import os
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

import click
import luigi.cmdline

from z2p_core.config.ablation import BASE
from z2p_renderer.pipeline.cli.options.workspace import build_command
from z2p_renderer.storage.files.disk_errors import TEMPORARY_FAILURE, disk_error_message
from z2p_renderer.storage.results.adoption import Candidate, adopt_result, find_candidates
from z2p_renderer.storage.results.fingerprints import STAGE_VERSIONS
from z2p_renderer.storage.results.manifests import find_faults
from z2p_renderer.storage.results.store import Store, StoreError
from z2p_renderer.workflows import apply_settings
from z2p_renderer.workflows.ablation.plan import AblationPlan
from z2p_renderer.workflows.plan import USER_ERRORS, Plan
from z2p_renderer.workflows.plan_loading import load_plan
from z2p_renderer.workflows.report.plan import ReportPlan
from z2p_renderer.workflows.sources import (
    ablation_source,
    is_ablation_config,
    is_report_config,
    pipeline_source,
    report_source,
)
from z2p_renderer.workflows.status import format_table, statuses_to_json, step_statuses, steps_to_run
from z2p_renderer.workflows.upkeep.adopt_ground_truth import find_truth_candidates
from z2p_renderer.workflows.upkeep.garbage_collection import Garbage, collect_garbage, find_garbage
from z2p_renderer.workflows.upkeep.runs_in_use import keep_results, kept_names

TRUTH_FOLDER = "truth"
"""Subfolder of a workspace; the store of the ground truth, which all evaluations share."""


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
def main() -> None:
    """Inspect and maintain a workspace."""


def status(workspace: Path, in_json: bool, only_stale: bool, **inputs: Any) -> None:
    """List every step as fresh, stale or missing, with the reason."""
    statuses = step_statuses(_load_plan(_plan_source(**inputs)), Store(workspace.absolute()))
    if in_json:
        click.echo(statuses_to_json(steps_to_run(statuses) if only_stale else statuses))
    else:
        click.echo("\n".join(format_table(statuses, with_fresh=not only_stale)))


def verify(workspace: Path) -> None:
    """Compare the files of every result with their digests, and quarantine damaged results."""
    if not workspace.is_dir():
        raise click.UsageError(f"--workspace {workspace}: expected a folder that z2p pipeline wrote, got none")
    checked, damaged = 0, 0
    for store in (Store(workspace.absolute()), Store(workspace.absolute() / TRUTH_FOLDER)):
        for folder in (folder for stage in store.stages() for folder in store.folders(stage)):
            checked += 1
            faults = find_faults(folder, verify_digests=True)
            if faults and os.path.lexists(folder) and not store.is_locked(folder.parent.name, folder.name):
                damaged += 1
                click.echo(f"DAMAGED {faults[0]}\n        put aside in {store.quarantine(folder)}")
    click.echo(f"{checked} results read, {damaged} damaged")
    sys.exit(1 if damaged else 0)


def gc(workspace: Path, drop: tuple[str, ...], yes: bool) -> None:
    """List the results that no configuration needs, or remove them with `yes`."""
    store = Store(workspace.absolute())
    known = kept_names(store)
    unknown = sorted(name for name in drop if name not in known and not (store.root / name).is_dir())
    if unknown:
        raise click.ClickException(f"--drop: unknown configuration {unknown[0]!r}; kept: {', '.join(known)}")
    garbage = collect_garbage(store, drop) if yes else find_garbage(store, drop)
    for folder, fault in store.damaged():
        if folder not in {item.path for item in garbage}:
            click.echo(f"DAMAGED {fault}\n        z2p verify, or the next run that needs it, puts it aside")
    for item in garbage:
        click.echo(f"{item.size / 1e6:9.1f} MB  {item.name:30}  {item.path.relative_to(store.root)}")
    click.echo(_garbage_summary(garbage, yes))


def adopt(stages: tuple[str, ...], workspace: Path, because: str, in_json: bool, **inputs: Any) -> None:
    """List the results of older code that can be adopted, or adopt them if a reason is given in `because`."""
    unknown = [stage for stage in stages if stage not in STAGE_VERSIONS]
    if unknown:
        raise click.UsageError(f"unknown stage {unknown[0]!r}; stages: {', '.join(STAGE_VERSIONS)}")
    source = _plan_source(**inputs)
    store, plan = Store(workspace.absolute()), _load_plan(source)
    wanted_stages = stages or tuple(STAGE_VERSIONS)
    results = find_candidates(store, [step.entry for step in plan.steps.values()], wanted_stages)
    truth_store = Store(store.root / TRUTH_FOLDER)
    evaluated = plan.plans[BASE] if isinstance(plan, AblationPlan) else plan  # all variants share the ground truth
    truths: list[Candidate] = []
    if isinstance(evaluated, Plan) and "reference" in wanted_stages:
        truths = find_truth_candidates(evaluated, store, truth_store)
    if because:
        for candidate in results:
            adopt_result(store, candidate, because)
        for candidate in truths:
            adopt_result(truth_store, candidate, because)
        if results or truths:
            keep_results(store, plan, source)
    _print_candidates([*results, *truths], in_json, adopted=bool(because))


def _print_candidates(candidates: list[Candidate], in_json: bool, *, adopted: bool) -> None:
    if in_json:
        rows = [{"step": one.entry.name, "fingerprint": one.entry.fingerprint, "from": one.old_fingerprint,
                 "differences": one.differences} for one in candidates]  # fmt: skip
        click.echo(json.dumps(rows, indent=1))
        return
    width = max((len(one.entry.name) for one in candidates), default=0)
    for one in candidates:
        prefix = "unfinished: " if one.unfinished else ""
        click.echo(f"{one.entry.name:{width}}  {one.folder.name}  {prefix}{'; '.join(one.differences)}")
    outcome = "taken over" if adopted else "could be taken over with --because REASON"
    click.echo(f"{len(candidates)} results {outcome}")


def scheduler(address: str, port: int) -> None:
    """Start luigi's central scheduler."""
    apply_settings("luigid.cfg")
    folder = tempfile.mkdtemp(prefix="z2p-scheduler-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)  # after luigid has written its state at exit
    luigi.cmdline.luigid(["--address", address, "--port", str(port), "--state-path", f"{folder}/state"])


for _command in (status, verify, gc, adopt, scheduler):
    main.add_command(build_command(_command.__name__, _command))


def _plan_source(config: str, meshes: str, evaluate_meshes: str, report: bool, **report_options: str) -> str:
    """Source of the plan of a pipeline, of ablations or of a report, whichever the options describe."""
    if not (report or any(report_options.values()) or is_report_config(config)):
        make_source = ablation_source if is_ablation_config(config) else pipeline_source
        return make_source(config, meshes, evaluate_meshes)
    if evaluate_meshes:
        raise click.UsageError("--evaluate-meshes is no option of a report; its meshes are those of --meshes")
    return report_source(config, meshes, **report_options)


def _load_plan(source: str) -> Plan | AblationPlan | ReportPlan:
    try:
        return load_plan(source)
    except USER_ERRORS as error:
        raise click.UsageError(str(error)) from error


def _garbage_summary(garbage: list[Garbage], removed: bool) -> str:
    megabytes = sum(item.size for item in garbage) / 1e6
    outcome = "removed" if removed else "not needed; remove them with --yes" if garbage else "not needed"
    return f"{len(garbage)} of {megabytes:.1f} MB {outcome}"


def run() -> None:
    """Run the command line; a damaged store or an error of the disk is reported in one line."""
    try:
        main(prog_name="z2p")
    except StoreError as error:
        click.echo(f"Error: {error}", err=True)
        sys.exit(1)
    except OSError as error:
        message = disk_error_message(error, Path(str(error.filename)).parent if error.filename else None)
        if message is None:
            raise
        click.echo(f"Error: {message}", err=True)
        sys.exit(TEMPORARY_FAILURE)
