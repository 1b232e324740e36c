"""`z2p status`, `verify`, `gc`, `adopt`, `scheduler`: each hands its words to a process.

That is ``python -m z2p_renderer.workflows``.
"""

from __future__ import annotations

import subprocess
import sys

import click

from z2p_renderer.pipeline.children import child_environment
from z2p_renderer.pipeline.commands.full_pipeline import check_luigi, run_process


class HandedOn(click.Command):
    """A command whose words are another program's to understand."""

    ignore_unknown_options = True
    allow_extra_args = True


def _handed_on(name: str) -> click.Command:
    @click.command(name, cls=HandedOn, add_help_option=False)
    @click.pass_context
    def command(ctx: click.Context) -> None:
        check_luigi()
        words = [sys.executable, "-m", "workflows", name, *ctx.args]
        if {"-h", "--help"} & set(ctx.args):
            click.echo(subprocess.run(words, env=child_environment(), capture_output=True, text=True).stdout, nl=False)
        else:
            ctx.exit(run_process(words, child_environment()))

    return command


status, verify, gc, adopt, scheduler = map(_handed_on, ("status", "verify", "gc", "adopt", "scheduler"))
