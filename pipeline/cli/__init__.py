"""The `z2p` command. Only click is imported here: each subcommand's module is imported when that one is called."""

from __future__ import annotations

import errno
import importlib
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

import click

from z2p_core import __version__
from z2p_renderer.pipeline.cli.errors import CommandError, ExitStatus, TemporaryError, error_line, is_debugging

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: its threads would spin; see z2p_core/linalg.py

COMMANDS = {
    "render": ("render:render", "Render point clouds to pictures."),
    "run-inference": ("render:render", "The same as render, by its older name."),
    "view": ("view:view", "Look around scans in the browser."),
    "animate": ("animate:animate", "Make turntables and light sweeps of point clouds."),
    "figure": ("figure:figure", "Draw a table of clouds and methods as one figure."),
    "film": ("film:film", "Turn a series of point clouds into one film."),
    "rerender": ("rerender:rerender", "Draw a picture again with something changed."),
    "info": ("info:info", "Show what made a picture."),
    "evaluate": ("evaluate:evaluate", "Measure weights against Blender renders of meshes."),
    "report-paper": ("paper_report:report_paper", "Make the paper's evaluation, as one page."),
    "pipeline": ("train_pipeline:pipeline", "Make weights: sample, render, train, evaluate."),
    "ablate": ("ablate:ablate", "Train variants of a config and compare them."),
    "status": ("workspace:status", "Say which stages are fresh, stale or missing, and why."),
    "verify": ("workspace:verify", "Compare every stored result with its digests."),
    "gc": ("workspace:gc", "Remove results that no kept configuration needs."),
    "adopt": ("workspace:adopt", "Vouch for results that older code made."),
    "scheduler": ("workspace:scheduler", "Share the work among pipelines on several machines."),
    "plugins": ("list_plugins:plugins", "List the installed plugins."),
    "formats": ("list_plugins:formats", "List the readable file formats."),
    "report": ("bug_report:report", "Print what a bug report needs."),
    "completion": ("completion:completion", "Print the script for Tab completion in a shell."),
}
"""Subcommand -> (module:attribute in `cli.commands`, short help): as text, so that `z2p --help` imports none."""


class LazyGroup(click.Group):
    """Group whose subcommands are imported only when called, and whose errors are one line."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            return None
        module, _, attribute = COMMANDS[cmd_name][0].partition(":")
        command: click.Command = getattr(
            importlib.import_module(f"z2p_renderer.pipeline.cli.commands.{module}"), attribute
        )
        return command

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        try:
            return super().parse_args(ctx, args)
        except click.NoSuchOption as error:
            from z2p_renderer.pipeline.cli.unknown_words import misplaced_option_error

            raise misplaced_option_error(error) from None

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if args[0] not in COMMANDS and not ctx.resilient_parsing:
            from z2p_renderer.pipeline.cli.unknown_words import unknown_command_message

            raise click.UsageError(unknown_command_message(args, COMMANDS), ctx)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, help_text) for name, (_, help_text) in COMMANDS.items()])

    def invoke(self, ctx: click.Context) -> Any:
        """Runs the subcommand. All errors become one line and an exit status, unless the user is debugging."""
        _open_closed_streams()
        try:
            with _graceful_first_interrupt():
                return super().invoke(ctx)
        except KeyboardInterrupt:
            click.echo("Interrupted.", err=True)
            ctx.exit(ExitStatus.INTERRUPTED)
        except click.NoSuchOption as error:
            from z2p_renderer.pipeline.cli.unknown_words import unknown_option_error

            raise unknown_option_error(error) from None
        except (click.ClickException, click.Abort, click.exceptions.Exit):
            raise
        except Exception as error:
            is_broken_pipe = isinstance(error, OSError) and error.errno == errno.EPIPE  # click exits quietly on it
            if is_debugging() or is_broken_pipe:
                raise
            from z2p_renderer.storage.files.disk_errors import disk_error_message

            if refusal := disk_error_message(error):
                raise TemporaryError(refusal) from None
            raise CommandError(error_line(error)) from None


def _open_closed_streams() -> None:
    """Opens standard streams that the shell has closed (``2>&-``) as the null device.

    Otherwise the next file to be opened would get the stream's number, and would receive what libraries write to it.
    """
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):  # the lowest free number is given first
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode))  # noqa: SIM115, PTH123 - until the process ends


@contextmanager
def _graceful_first_interrupt() -> Iterator[None]:
    """The first Ctrl-C raises KeyboardInterrupt, so that work ends in good order; the second ends the process at once.

    A file that is being written at the second one is not there afterwards, as after a kill.
    """
    handler_before = signal.getsignal(signal.SIGINT)
    if handler_before is not signal.default_int_handler or threading.current_thread() is not threading.main_thread():
        yield  # interrupts are ignored, as in background jobs, or are handled by the calling program
        return

    def on_first_interrupt(number: int, frame: FrameType | None) -> None:
        signal.signal(signal.SIGINT, lambda number, frame: os._exit(ExitStatus.INTERRUPTED))
        raise KeyboardInterrupt

    signal.signal(signal.SIGINT, on_first_interrupt)
    try:
        yield
    except KeyboardInterrupt:
        raise  # the process is ending: the second interrupt's handler stays
    except BaseException:
        signal.signal(signal.SIGINT, handler_before)
        raise
    signal.signal(signal.SIGINT, handler_before)


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="z2p", message="%(prog)s %(version)s")
def main() -> None:
    """Point clouds in, studio-quality pictures out, on a plain CPU.

    Set Z2P_DEBUG=1 to see tracebacks and the messages of libraries.
    """
    import logging

    if is_debugging():
        logging.basicConfig(level=logging.INFO)
    else:
        logging.getLogger().addHandler(logging.NullHandler())  # without it Python prints libraries' warnings
