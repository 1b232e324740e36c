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
"""Settings that our files made so far. A later file of ours may replace them; a user's own are never replaced."""


def apply_settings(name: str) -> None:
    """Apply the settings of one of our configuration files, except where the user's own configuration differs."""
    file = configparser.ConfigParser()
    file.read_string((Path(__file__).parent / name).read_text(encoding="utf-8"))
    settings = luigi.configuration.get_config()
    for section in file.sections():
        for option, value in file.items(section):
            current = settings.get(section, option) if settings.has_option(section, option) else None
            if current is None or current == _applied_settings.get((section, option)):
                settings.set(section, option, value)
            _applied_settings[section, option] = value


class _LogFilter(logging.Filter):
    """Lets through warnings and errors, and luigi's closing summary unless a task failed; in debug mode everything."""

    def filter(self, record: logging.LogRecord) -> bool:
        message = record.getMessage()
        is_summary = "Execution Summary" in message
        any_failed = is_summary and summarize_failures()
        if logging.getLogger(record.name).getEffectiveLevel() <= logging.DEBUG:
            return True
        # `workflows.stage_task` and `workflows.plan_task` report these in one line, without a traceback
        reported_by_us = message.startswith("Will not run") and "error in " in message
        reported_by_us |= record.exc_info is not None and isinstance(record.exc_info[1], (*USER_ERRORS, OSError))
        reported_by_us |= record.exc_info is not None and " failed " in message  # a task, whose log has the traceback
        return (is_summary and not any_failed) or (record.levelno >= logging.WARNING and not reported_by_us)


apply_settings("luigi.cfg")
# luigi's scheduler client reads these two by itself, so luigi need not warn that nobody consumed them
luigi.interface.core.ignore_unconsumed |= {"rpc_retry_attempts", "rpc_retry_wait"}
logging.getLogger("luigi-interface").addFilter(_LogFilter())

# after the settings, so that every task sees them
from z2p_renderer.workflows import stages  # noqa: E402
from z2p_renderer.workflows.ablation import stages as ablation_stages  # noqa: E402
from z2p_renderer.workflows.ablation.ablations import Ablations  # noqa: E402
from z2p_renderer.workflows.full_pipeline import FullPipeline  # noqa: E402
from z2p_renderer.workflows.report import stages as report_stages  # noqa: E402
from z2p_renderer.workflows.report.paper_report import PaperReport  # noqa: E402

__all__ = ["Ablations", "FullPipeline", "PaperReport", "ablation_stages", "report_stages", "stages"]
