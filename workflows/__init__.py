"""luigi tasks, one a stage; each run() calls one function of `pipeline`. `luigi --module workflows FullPipeline`.

Importing this applies the safety settings of `luigi.cfg`, so the bare `luigi` command needs none from the user.
"""

from __future__ import annotations

import configparser
import logging
import os
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: its threads would spin; see z2p_core/linalg.py

import luigi.configuration
import luigi.interface

from z2p_renderer.workflows.plan import USER_ERRORS
from z2p_renderer.workflows.process.exit_status import summarize_failures

_applied_settings: dict[tuple[str, str], str] = {}
"""What we have set so far: a user's own configuration goes before it, a later file of ours after it."""


def apply_settings(name: str) -> None:
    """Set what one of our configuration files says, except where the user's own says something else."""
    file = configparser.ConfigParser()
    file.read_string((Path(__file__).parent / name).read_text(encoding="utf-8"))
    settings = luigi.configuration.get_config()
    for section in file.sections():
        for option, value in file.items(section):
            theirs = settings.get(section, option) if settings.has_option(section, option) else None
            if theirs is None or theirs == _applied_settings.get((section, option)):
                settings.set(section, option, value)
            _applied_settings[section, option] = value


class _LogFilter(logging.Filter):
    """Lets through warnings and failures, and the closing summary where nothing failed; all in debug mode."""

    def filter(self, record: logging.LogRecord) -> bool:
        ends = "Execution Summary" in record.getMessage()
        failed = ends and summarize_failures()
        if logging.getLogger(record.name).getEffectiveLevel() <= logging.DEBUG:
            return True
        message = record.getMessage()
        # these are told in one line by `workflows.stage_task` and `workflows.plan_task`: where they arose is no news
        told_by_us = message.startswith("Will not run") and "error in " in message
        told_by_us |= record.exc_info is not None and isinstance(record.exc_info[1], (*USER_ERRORS, OSError))
        told_by_us |= record.exc_info is not None and " failed " in message  # a task, with the traceback of its log
        return (ends and not failed) or (record.levelno >= logging.WARNING and not told_by_us)


apply_settings("luigi.cfg")
luigi.interface.core.ignore_unconsumed |= {"rpc_retry_attempts", "rpc_retry_wait"}  # read elsewhere; no need to warn
logging.getLogger("luigi-interface").addFilter(_LogFilter())

# after the settings, which luigi reads as it goes
from z2p_renderer.workflows import stages  # noqa: E402
from z2p_renderer.workflows.ablation import stages as ablation_stages  # noqa: E402
from z2p_renderer.workflows.ablation.ablations import Ablations  # noqa: E402
from z2p_renderer.workflows.full_pipeline import FullPipeline  # noqa: E402
from z2p_renderer.workflows.report import stages as report_stages  # noqa: E402
from z2p_renderer.workflows.report.paper_report import PaperReport  # noqa: E402

__all__ = ["Ablations", "FullPipeline", "PaperReport", "ablation_stages", "report_stages", "stages"]
