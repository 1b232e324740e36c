"""Adoption of ground truth that older code rendered for a plan's evaluation, with or without a manifest."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

from z2p_core.camera import DEFAULT_ELEVATION
from z2p_renderer.storage.results.adoption import Candidate, find_candidates
from z2p_renderer.storage.results.store import Entry, Store
from z2p_renderer.workflows.plan import Plan


def find_truth_candidates(plan: Plan, store: Store, truth: Store) -> list[Candidate]:
    """Images in `truth`, the store of ground truth, that can be adopted for the plan's evaluation."""
    references = list(iter_references(plan, store))
    candidates = find_candidates(truth, [entry for entry, _ in references], ("reference",))
    known = {candidate.entry.fingerprint for candidate in candidates}
    for entry, legacy in references:
        coverage = legacy.with_suffix(".coverage.png")
        if entry.fingerprint not in known and not truth.complete(entry) and legacy.is_file() and coverage.is_file():
            files = {"picture.png": legacy, "picture.coverage.png": coverage}
            candidates.append(Candidate(entry, legacy.parent, legacy.parent.name, ("it had no manifest",), files))
    return candidates


def iter_references(plan: Plan, store: Store) -> Iterator[tuple[Entry, Path]]:
    """Each ground truth image that the plan's evaluation needs, and its path in stores from before manifests."""
    from z2p_renderer.pipeline.evaluation.evaluate import ground_truth_settings, sample_views, split_seeds
    from z2p_renderer.pipeline.rendering.ground_truth import legacy_picture_path, reference_entry
    from z2p_renderer.pipeline.rendering.views import load_controls
    from z2p_renderer.pipeline.shapes import shape_path
    from z2p_renderer.storage.results.fingerprints import file_digest

    controls = load_controls(plan.config.render.controls)
    # the only attributes of weights that `sample_views` reads
    weights = SimpleNamespace(controls=controls, fixed_elevation=None if "elevation" in controls else DEFAULT_ELEVATION)
    for mesh in plan.evaluation:
        path = mesh.path or shape_path(store.folder(plan.steps["shapes"].entry), mesh.name)
        if not path.is_file():
            continue
        identity = file_digest(path)
        for run in split_seeds(plan.config.evaluate):
            settings = ground_truth_settings(run)
            for view in sample_views(weights, identity, run):  # type: ignore[arg-type]
                entry = reference_entry(path.stem, identity, view.scene, settings)
                yield entry, legacy_picture_path(store.root / "truth", identity, view.scene, settings)
