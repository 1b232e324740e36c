"""Configuration files."""

from __future__ import annotations

from pathlib import Path

from z2p_core.config import ConfigError
from z2p_renderer.storage.files.printable_names import is_file


def read_config_text(path: Path) -> str:
    """The text of a TOML file.

    Raises:
        ConfigError: there is no such file, or it is not encoded in UTF-8, as TOML must be.
    """
    if not is_file(path):
        raise ConfigError(f"--config: expected a TOML file, got {str(path)!r}, which is no file")
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: not valid TOML: byte {error.start} is not UTF-8; save it in UTF-8") from None
