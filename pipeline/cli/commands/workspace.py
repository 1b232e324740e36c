"""`z2p status`, `verify`, `gc`, `adopt`, `scheduler`: each passes its arguments on to ``python -m workflows``.

Wrong arguments and --help are answered here, so that they need no luigi.
"""

from __future__ import annotations

import sys
from typing import Any

import click

from z2p_renderer.pipeline.child_process import child_environment
from z2p_renderer.pipeline.cli.commands.train_pipeline import check_luigi, run_process
from z2p_renderer.pipeline.cli.options.workspace import build_command

_ARGUMENTS_KEY = "z2p.words"
"""Key in click's context of the arguments as they were typed."""


class ForwardedCommand(click.Command):
    """A command that keeps its arguments as they were typed."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        ctx.meta[_ARGUMENTS_KEY] = list(args)
        return super().parse_args(ctx, args)


def _forwarded(name: str) -> click.Command:
    @click.pass_context
    def forward(ctx: click.Context, /, **_: Any) -> None:
        check_luigi()
        arguments = [sys.executable, "-m", "workflows", name, *ctx.meta[_ARGUMENTS_KEY]]
        ctx.exit(run_process(arguments, child_environment()))

    return build_command(name, forward, ForwardedCommand)


status, verify, gc, adopt, scheduler = map(_forwarded, ("status", "verify", "gc", "adopt", "scheduler"))
