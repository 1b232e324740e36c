"""A store filled as a run of a plan would fill it, with files of no meaning."""

from pathlib import Path

from z2p_renderer.storage.results.store import Store
from z2p_renderer.workflows.plan import Plan


def fill(store: Store, plan: Plan, *names: str) -> None:
    """Make the named steps' results, by default all of them."""
    for name, step in plan.steps.items():
        if not names or name in names:
            store.produce(step.entry, lambda folder, name=name: (folder / "result.bin").write_text(name))


def link(store: Store, plan: Plan) -> None:
    """Show the weights as `FullPipeline` does."""
    shown = store.root / plan.config.name / "weights.safetensors"
    shown.parent.mkdir(parents=True, exist_ok=True)
    shown.symlink_to(store.folder(plan.steps["train"].entry) / "result.bin")


def listing(root: Path) -> dict[str, int]:
    """Every path under a folder, with when it was changed."""
    return {str(path): path.lstat().st_mtime_ns for path in sorted(root.rglob("*"))}
