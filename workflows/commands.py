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
from z2p_renderer.pipeline.cli.options.workspace import command
from z2p_renderer.storage.files.disk_errors import TEMPORARY_FAILURE, disk_error_message
from z2p_renderer.storage.results.adoption import adopt as take_over
from z2p_renderer.storage.results.adoption import find_candidates
from z2p_renderer.storage.results.fingerprints import STAGE_VERSIONS
from z2p_renderer.storage.results.manifests import find_faults
from z2p_renderer.storage.results.store import Store, StoreError
from z2p_renderer.workflows import apply_settings
from z2p_renderer.workflows.ablation.plan import AblationPlan, ablation_source, is_ablations, load_ablation_plan
from z2p_renderer.workflows.plan import USERS_ERRORS, Plan
from z2p_renderer.workflows.report.plan import ReportPlan, is_report, load_report_plan, report_source
from z2p_renderer.workflows.status import as_json, states, table
from z2p_renderer.workflows.tasks import load_plan, source_of
from z2p_renderer.workflows.upkeep.adopt_ground_truth import truth_candidates
from z2p_renderer.workflows.upkeep.garbage_collection import Unneeded, sweep, unneeded
from z2p_renderer.workflows.upkeep.runs_in_use import keep, kept_names

TRUTH = "truth"
"""Folder of a workspace that is a store of its own, for ground truth."""


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
def main() -> None:
    """Look at a workspace and keep it in order."""


def status(workspace: Path, in_json: bool, only_stale: bool, **where: Any) -> None:
    """List every step as fresh, stale or missing, with the reason."""
    found = states(_plan(_source(**where)), Store(workspace.absolute()))
    if in_json:
        click.echo(as_json([one for one in found if not only_stale or one.state != "fresh"]))
    else:
        click.echo("\n".join(table(found, every=not only_stale)))


def verify(workspace: Path) -> None:
    """Compare every result with its digests, and put damaged ones aside."""
    if not workspace.is_dir():
        raise click.UsageError(f"--workspace {workspace}: expected a folder that z2p pipeline wrote, got none")
    checked, damaged = 0, 0
    for store in (Store(workspace.absolute()), Store(workspace.absolute() / TRUTH)):
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
    found = sweep(store, drop) if yes else unneeded(store, drop)
    for folder, fault in store.damaged():
        if folder not in {one.path for one in found}:
            click.echo(f"DAMAGED {fault}\n        z2p verify, or the next run that needs it, puts it aside")
    for one in found:
        click.echo(f"{one.size / 1e6:9.1f} MB  {one.name:30}  {one.path.relative_to(store.root)}")
    click.echo(_told(found, yes))


def adopt(stages: tuple[str, ...], workspace: Path, because: str, in_json: bool, **where: Any) -> None:
    """Vouch for results that older code made."""
    unknown = [stage for stage in stages if stage not in STAGE_VERSIONS]
    if unknown:
        raise click.UsageError(f"unknown stage {unknown[0]!r}; stages: {', '.join(STAGE_VERSIONS)}")
    source = _source(**where)
    store, plan = Store(workspace.absolute()), _plan(source)
    wanted = stages or tuple(STAGE_VERSIONS)
    found = find_candidates(store, [step.entry for step in plan.steps.values()], wanted)
    truth = Store(store.root / TRUTH)
    measured = plan.plans[BASE] if isinstance(plan, AblationPlan) else plan  # all variants on the same pictures
    pictures = truth_candidates(measured, store, truth) if isinstance(measured, Plan) and "reference" in wanted else []
    for candidate in found if because else ():
        take_over(store, candidate, because)
    for candidate in pictures if because else ():
        take_over(truth, candidate, because)
    found += pictures
    if because and found:
        keep(store, plan, source)
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


for _work in (status, verify, gc, adopt, scheduler):
    main.add_command(command(_work.__name__, _work))


def _source(config: str, meshes: str, evaluate_meshes: str, report: bool, **of_report: str) -> str:
    """Where config and meshes come from, of a pipeline, of ablations or of a report."""
    if not (report or any(of_report.values()) or is_report(config)):
        kind = ablation_source if is_ablations(config) else source_of
        return kind(config, meshes, evaluate_meshes)
    if evaluate_meshes:
        raise click.UsageError("--evaluate-meshes is no option of a report; its meshes are those of --meshes")
    return report_source(config, meshes, **of_report)


def _plan(source: str) -> Plan | AblationPlan | ReportPlan:
    where = json.loads(source)
    try:
        if "ablations" in where:
            return load_ablation_plan(source)
        return load_report_plan(source) if "report" in where else load_plan(source)
    except USERS_ERRORS as error:
        raise click.UsageError(str(error)) from error


def _told(found: list[Unneeded], removed: bool) -> str:
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
