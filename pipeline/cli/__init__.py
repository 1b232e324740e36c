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

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: its threads would spin; see z2p_core/linalg.py

COMMANDS = {
    "render": ("render:run_inference", "Render point clouds to pictures."),
    "run-inference": ("render:run_inference", "The same as render, by its older name."),
    "animate": ("animate:animate", "Make turntables and light sweeps of point clouds."),
    "rerender": ("info_and_rerender:rerender", "Draw a picture again with something changed."),
    "info": ("info_and_rerender:info", "Show what made a picture."),
    "evaluate": ("evaluate:evaluate", "Measure weights against Blender renders of meshes."),
    "report-paper": ("paper_report:report_paper", "Make the paper's evaluation, as one page."),
    "pipeline": ("train_pipeline:full_pipeline", "Make weights: sample, render, train, evaluate."),
    "ablate": ("ablate:ablate", "Train variants of a config and compare them."),
    "status": ("workspace:status", "Say which stages are fresh, stale or missing, and why."),
    "verify": ("workspace:verify", "Compare every stored result with its digests."),
    "gc": ("workspace:gc", "Remove results that no kept configuration needs."),
    "adopt": ("workspace:adopt", "Vouch for results that older code made."),
    "scheduler": ("workspace:scheduler", "Share the work among pipelines on several machines."),
    "plugins": ("list_plugins:plugins", "List the installed plugins."),
    "formats": ("list_plugins:formats", "List the readable file formats."),
    "report": ("bug_report:report", "Print what a bug report needs."),
    "completion": ("bug_report:completion", "Print the script for Tab completion in a shell."),
}
"""Subcommand -> (module:attribute in `cli.commands`, short help): by name, so that `z2p --help` imports none of them."""

USERS_ERRORS = (
    "z2p_core.registry:PluginError",
    "z2p_core.config.pipeline:ConfigError",
    "z2p_core.interfaces:ScanError",
    "z2p_core.interfaces:SettingError",
    "z2p_renderer.storage.models.checkpoints:WeightsError",
    "z2p_renderer.storage.images.image_files:PictureError",
    "z2p_renderer.storage.results.store:StoreError",
    "z2p_renderer.pipeline.render:RenderError",
)
"""Errors that a user can mend: told in one line with exit status 2. By name, so that nothing is imported for them."""


INTERRUPTED = 130
"""Exit status after Ctrl-C, as shells have it; 1 would say that all files had their turn."""


class Failure(click.ClickException):
    """One line ``Error: ...`` and exit status 2."""

    exit_code = 2


class Refusal(click.ClickException):
    """One line ``Error: ...`` and the exit status of what may pass: see `storage.files.disk_errors`."""

    exit_code = 75


class LazyGroup(click.Group):
    """Group whose subcommands are imported only when called, and whose errors are one line."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            return None
        module, _, attribute = COMMANDS[cmd_name][0].partition(":")
        commands = importlib.import_module(f"z2p_renderer.pipeline.cli.commands.{module}")
        command: click.Command = getattr(commands, attribute)
        return command

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        try:
            return super().parse_args(ctx, args)
        except click.NoSuchOption as error:
            from z2p_renderer.pipeline.cli.unknown_words import misplaced_option

            raise misplaced_option(error) from None

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if args[0] not in COMMANDS and not ctx.resilient_parsing:
            from z2p_renderer.pipeline.cli.unknown_words import unknown_command

            raise click.UsageError(unknown_command(args, COMMANDS), ctx)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, help_text) for name, (_, help_text) in COMMANDS.items()])

    def invoke(self, ctx: click.Context) -> Any:
        _open_closed_streams()
        try:
            with _interrupted_once():
                return super().invoke(ctx)
        except KeyboardInterrupt:
            click.echo("Interrupted.", err=True)
            ctx.exit(INTERRUPTED)
        except click.NoSuchOption as error:
            from z2p_renderer.pipeline.cli.unknown_words import unknown_option

            raise unknown_option(error) from None
        except (click.ClickException, click.Abort, click.exceptions.Exit):
            raise
        except Exception as error:
            broken_pipe = isinstance(error, OSError) and error.errno == errno.EPIPE  # click ends quietly on it
            if debugging() or broken_pipe:
                raise
            from z2p_renderer.storage.files.disk_errors import disk_error_message  # late, as all but click

            if refused := disk_error_message(error):
                raise Refusal(refused) from None
            raise Failure(_told(error)) from None


def _open_closed_streams() -> None:
    """Lets streams that a shell closed (``2>&-``) lead nowhere.

    Else the next file that is opened would take the number of one, and whatever a library writes there.
    """
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):  # numbers are given from the lowest on
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode))  # noqa: SIM115, PTH123 - until the process ends


@contextmanager
def _interrupted_once() -> Iterator[None]:
    """Lets the first Ctrl-C end the work in good order, and the next one at once, whatever is on its way by then.

    A file that is being written is then not there, as after a kill.
    """
    usual = signal.getsignal(signal.SIGINT)
    if usual is not signal.default_int_handler or threading.current_thread() is not threading.main_thread():
        yield  # interrupts are ignored, as those of background jobs are, or somebody else's
        return

    def first(number: int, frame: FrameType | None) -> None:
        signal.signal(signal.SIGINT, lambda number, frame: os._exit(INTERRUPTED))
        raise KeyboardInterrupt

    signal.signal(signal.SIGINT, first)
    try:
        yield
    except KeyboardInterrupt:
        raise  # the process ends now: the next one stays deadly
    except BaseException:
        signal.signal(signal.SIGINT, usual)
        raise
    signal.signal(signal.SIGINT, usual)


def debugging() -> bool:
    """True when the user asked for tracebacks and library messages with ``Z2P_DEBUG=1``."""
    return os.environ.get("Z2P_DEBUG") == "1"


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="z2p", message="%(prog)s %(version)s")
def main() -> None:
    """Point clouds in, studio-quality pictures out, on a plain CPU.

    Set Z2P_DEBUG=1 to see tracebacks and the messages of libraries.
    """
    import logging

    if debugging():
        logging.basicConfig(level=logging.INFO)
    else:
        logging.getLogger().addHandler(logging.NullHandler())  # without it Python prints libraries' warnings


def _told(error: Exception) -> str:
    """One line about an error: its message when the user can mend it, else a request for a report."""
    text = " ".join(str(error).split())
    for name in USERS_ERRORS:
        module, _, attribute = name.partition(":")
        kind = getattr(sys.modules.get(module), attribute, None)
        if kind is not None and isinstance(error, kind):
            return text
    return f"unexpected {type(error).__name__}: {text}; run again with Z2P_DEBUG=1 for the traceback"

