"""`z2p status`, `verify`, `gc`, `adopt` and `scheduler`: a workspace looked at and kept in order, and shared.

`z2p` starts these as ``python -m z2p_renderer.workflows COMMAND``, as it starts luigi: nothing but this package
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
from z2p_renderer.storage.results.adoption import adopt as take_over
from z2p_renderer.storage.results.adoption import find_candidates
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
from z2p_renderer.workflows.status import format_table, statuses_to_json, step_statuses
from z2p_renderer.workflows.upkeep.adopt_ground_truth import find_truth_candidates
from z2p_renderer.workflows.upkeep.garbage_collection import Garbage, collect_garbage, find_garbage
from z2p_renderer.workflows.upkeep.runs_in_use import keep_results, kept_names

TRUTH_FOLDER = "truth"
"""Folder of a workspace that is a store of its own, for ground truth."""


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
def main() -> None:
    """Look at a workspace and keep it in order."""


def status(workspace: Path, in_json: bool, only_stale: bool, **where: Any) -> None:
    """List every step as fresh, stale or missing, with the reason."""
    found = step_statuses(_load_plan(_plan_source(**where)), Store(workspace.absolute()))
    if in_json:
        click.echo(statuses_to_json([one for one in found if not only_stale or one.state != "fresh"]))
    else:
        click.echo("\n".join(format_table(found, every=not only_stale)))


def verify(workspace: Path) -> None:
    """Compare every result with its digests, and put damaged ones aside."""
    if not workspace.is_dir():
        raise click.UsageError(f"--workspace {workspace}: expected a folder that z2p pipeline wrote, got none")
    checked, damaged = 0, 0
    for store in (Store(workspace.absolute()), Store(workspace.absolute() / TRUTH_FOLDER)):
        for folder in (folder for stage in store.stages() for folder in store.folders(stage)):
            checked += 1
            found = find_faults(folder, verify_digests=True)
            if found and os.path.lexists(folder) and not store.is_locked(folder.parent.name, folder.name):
                damaged += 1
                click.echo(f"DAMAGED {found[0]}\n        put aside in {store.quarantine(folder)}")
    click.echo(f"{checked} results read, {damaged} damaged")
    sys.exit(1 if damaged else 0)


def gc(workspace: Path, drop: tuple[str, ...], yes: bool) -> None:
    """List or remove what nothing needs."""
    store = Store(workspace.absolute())
    known = kept_names(store)
    unknown = sorted(name for name in drop if name not in known and not (store.root / name).is_dir())
    if unknown:
        raise click.ClickException(f"--drop: unknown configuration {unknown[0]!r}; kept: {', '.join(known)}")
    found = collect_garbage(store, drop) if yes else find_garbage(store, drop)
    for folder, fault in store.damaged():
        if folder not in {one.path for one in found}:
            click.echo(f"DAMAGED {fault}\n        z2p verify, or the next run that needs it, puts it aside")
    for one in found:
        click.echo(f"{one.size / 1e6:9.1f} MB  {one.name:30}  {one.path.relative_to(store.root)}")
    click.echo(_summary(found, yes))


def adopt(stages: tuple[str, ...], workspace: Path, because: str, in_json: bool, **where: Any) -> None:
    """Vouch for results that older code made."""
    unknown = [stage for stage in stages if stage not in STAGE_VERSIONS]
    if unknown:
        raise click.UsageError(f"unknown stage {unknown[0]!r}; stages: {', '.join(STAGE_VERSIONS)}")
    source = _plan_source(**where)
    store, plan = Store(workspace.absolute()), _load_plan(source)
    wanted = stages or tuple(STAGE_VERSIONS)
    found = find_candidates(store, [step.entry for step in plan.steps.values()], wanted)
    truth = Store(store.root / TRUTH_FOLDER)
    measured = plan.plans[BASE] if isinstance(plan, AblationPlan) else plan  # all variants on the same pictures
    pictures = find_truth_candidates(measured, store, truth) if isinstance(measured, Plan) and "reference" in wanted else []
    for candidate in found if because else ():
        take_over(store, candidate, because)
    for candidate in pictures if because else ():
        take_over(truth, candidate, because)
    found += pictures
    if because and found:
        keep_results(store, plan, source)
    if in_json:
        rows = [{"step": one.entry.name, "fingerprint": one.entry.fingerprint, "from": one.old_fingerprint,
                 "differences": one.differences} for one in found]  # fmt: skip
        click.echo(json.dumps(rows, indent=1))
        return
    width = max((len(one.entry.name) for one in found), default=0)
    for one in found:
        what = "unfinished: " if one.unfinished else ""
        click.echo(f"{one.entry.name:{width}}  {one.folder.name}  {what}{'; '.join(one.differences)}")
    click.echo(f"{len(found)} results {'taken over' if because else 'could be taken over with --because REASON'}")


def scheduler(address: str, port: int) -> None:
    """Start luigi's central scheduler."""
    apply_settings("luigid.cfg")
    folder = tempfile.mkdtemp(prefix="z2p-scheduler-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)  # after luigid's own last words
    luigi.cmdline.luigid(["--address", address, "--port", str(port), "--state-path", f"{folder}/state"])


for _command in (status, verify, gc, adopt, scheduler):
    main.add_command(build_command(_command.__name__, _command))


def _plan_source(config: str, meshes: str, evaluate_meshes: str, report: bool, **of_report: str) -> str:
    """Where config and meshes come from, of a pipeline, of ablations or of a report."""
    if not (report or any(of_report.values()) or is_report_config(config)):
        kind = ablation_source if is_ablation_config(config) else pipeline_source
        return kind(config, meshes, evaluate_meshes)
    if evaluate_meshes:
        raise click.UsageError("--evaluate-meshes is no option of a report; its meshes are those of --meshes")
    return report_source(config, meshes, **of_report)


def _load_plan(source: str) -> Plan | AblationPlan | ReportPlan:
    try:
        return load_plan(source)
    except USER_ERRORS as error:
        raise click.UsageError(str(error)) from error


def _summary(found: list[Garbage], removed: bool) -> str:
    size = sum(one.size for one in found) / 1e6
    end = "removed" if removed else "not needed; remove them with --yes" if found else "not needed"
    return f"{len(found)} of {size:.1f} MB {end}"


def run() -> None:
    """Run the command line; what a user can mend is told in one line."""
    try:
        main(prog_name="z2p")
    except StoreError as error:
        click.echo(f"Error: {error}", err=True)
        sys.exit(1)
    except OSError as error:
        refused = disk_error_message(error, Path(str(error.filename)).parent if error.filename else None)
        if refused is None:
            raise
        click.echo(f"Error: {refused}", err=True)
        sys.exit(TEMPORARY_FAILURE)
