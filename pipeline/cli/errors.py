"""How commands end: their exit statuses, and errors as one line. Only click is imported, so that `z2p` starts fast."""

from __future__ import annotations

import os
import sys
from enum import IntEnum

import click

from z2p_renderer.storage.files.disk_errors import TEMPORARY_FAILURE


class ExitStatus(IntEnum):
    """The exit statuses of `z2p`; those of pipelines are luigi's, see `workflows/luigi.cfg`."""

    DONE = 0
    SOME_FAILED = 1
    """Some files failed, and the others are done; or `z2p verify` found damaged results."""
    FAILED = 2
    """Wrong usage, or an error that stopped the whole command."""
    TEMPORARY = TEMPORARY_FAILURE
    """The disk is full, say: the same command may succeed later."""
    INTERRUPTED = 130
    """After Ctrl-C, as shells have it."""


class CommandError(click.ClickException):
    """Ends the command with one line ``Error: ...``."""

    exit_code = ExitStatus.FAILED


class TemporaryError(click.ClickException):
    """Ends the command with one line ``Error: ...`` for an error that may pass; see `storage.files.disk_errors`."""

    exit_code = ExitStatus.TEMPORARY


USER_ERRORS = (
    "z2p_core.registry:PluginError",
    "z2p_core.config.pipeline:ConfigError",
    "z2p_core.interfaces:ScanError",
    "z2p_core.interfaces:SettingError",
    "z2p_renderer.storage.models.checkpoints:WeightsError",
    "z2p_renderer.storage.images.image_files:PictureError",
    "z2p_renderer.storage.results.store:StoreError",
    "z2p_renderer.pipeline.render:RenderError",
)
"""Errors that a user can mend, as module:class: a class whose module is not imported cannot have been raised."""


def is_debugging() -> bool:
    """True if the user asked for tracebacks and the messages of libraries with ``Z2P_DEBUG=1``."""
    return os.environ.get("Z2P_DEBUG") == "1"


def error_line(error: Exception) -> str:
    """One line about an error: its message if the user can mend it, else a request to run again for the traceback."""
    text = " ".join(str(error).split())
    if _is_user_error(error):
        return text
    return f"unexpected {type(error).__name__}: {text}; run again with Z2P_DEBUG=1 for the traceback"


def _is_user_error(error: Exception) -> bool:
    for name in USER_ERRORS:
        module, _, class_name = name.partition(":")
        error_class = getattr(sys.modules.get(module), class_name, None)
        if error_class is not None and isinstance(error, error_class):
            return True
    return False
