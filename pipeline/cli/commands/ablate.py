"""`z2p ablate`: runs luigi in a process of its own, as `z2p pipeline` does."""

from __future__ import annotations

from typing import Any

import click

from z2p_renderer.pipeline.cli.commands.train_pipeline import pipeline_options, run_task


@click.command()
@pipeline_options("A base and its variants. The default is a file of the clone: name it if z2p was installed "
                  "without --editable.", "configs/ablations.toml")
def ablate(**options: Any) -> None:
    """Train variants of a config for the same budget, and compare them in a table.

    Runs `luigi --module workflows Ablations --local-scheduler` and ends with its exit status. Renders and shards are
    those of `z2p pipeline`; only variants whose inputs have changed run again.
    """
    run_task("Ablations", **options)
