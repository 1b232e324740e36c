"""Saves what a page shows: by running the very command that the page copies, so that both make the same bytes."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from z2p_core.interfaces import SettingError
from z2p_renderer.pipeline.cli.viewer.view_state import ViewState, call_text, command_text, command_words
from z2p_renderer.pipeline.cli.viewer.viewed_scans import Pane, ViewedScans
from z2p_renderer.storage.cameras import check_camera_place, write_camera

SAVE_SECONDS = 600
"""Time after which a saving command is given up."""


@dataclass(frozen=True)
class Recipe:
    """How the pictures of a page are made elsewhere."""

    words: list[str]
    """The command without `z2p`."""
    command: str
    call: str
    output: Path
    """The picture; or the folder of several."""


class Saver:
    """Writes pictures and cameras of one viewer into a folder."""

    def __init__(
        self, scans: ViewedScans, folder: Path, run_words: list[str], source: str | None = None, up: str = "auto"
    ) -> None:  # fmt: skip
        """
        Args:
            scans: the viewer's.
            folder: where pictures and cameras go.
            run_words: further words of every command, such as ``--engine torch``.
            source: the Python expression of points that were given in place of files.
            up: of a call of `z2p_core.render` that names none.
        """
        self._scans, self._folder, self._words = scans, folder, run_words
        self._source, self._up = source, up

    def recipe(self, state: ViewState) -> Recipe:
        """The command and the call that make the pictures of a state."""
        inputs = [str(path) for path in self._scans.paths]
        is_single = len(self._scans.panes) == 1 and len(inputs) == 1
        output = self._folder / f"{self._scans.paths[0].stem}.png" if is_single else self._folder
        words = [*state.options(), *self._words, "--overwrite"]
        sources = [repr(name) for name in inputs] if self._source is None else [self._source]
        has_batches = len(self._scans.panes) > len(inputs)
        call = call_text(sources, str(output), self._keywords(state), has_batches)
        return Recipe(command_words(inputs, str(output), words), command_text(inputs, str(output), words), call, output)

    def save_pictures(self, state: ViewState) -> list[Path]:
        """The pictures that the state's command has written.

        Raises:
            SettingError: the command failed; the message is its last line.
        """
        recipe = self.recipe(state)
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        try:
            done = subprocess.run(
                [sys.executable, "-m", "z2p_renderer.pipeline.cli", *recipe.words, "--quiet", "--json"],
                capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=SAVE_SECONDS, env=environment,
            )  # fmt: skip
        except (OSError, subprocess.TimeoutExpired) as error:
            raise SettingError(f"not saved: {error}") from error
        if done.returncode:
            lines = done.stderr.strip().splitlines() or [f"exit status {done.returncode}"]
            raise SettingError(f"not saved: {lines[-1].removeprefix('Error: ')}")
        return _outputs_of(done.stdout) or [recipe.output]

    def save_cameras(self, state: ViewState) -> list[Path]:
        """The files, for `--load-camera`, with the camera of each cloud; one file where all share a frame.

        Raises:
            ScanError, SettingError: a cloud cannot be drawn; or a file of that name is no camera.
        """
        panes = self._scans.panes[:1] if state.same_frame else self._scans.panes
        self._folder.mkdir(parents=True, exist_ok=True)
        paths = []
        for pane in panes:
            viewpoint = self._scans.full(pane, state).viewpoint
            assert viewpoint is not None
            path = self._camera_path(pane, state)
            check_camera_place(path, self._scans.paths)
            write_camera(viewpoint, path)
            paths.append(path)
        return paths

    def _camera_path(self, pane: Pane, state: ViewState) -> Path:
        if state.same_frame:
            return self._folder / "camera.json"
        several = sum(other.path.stem == pane.path.stem for other in self._scans.panes) > 1
        return self._folder / f"{pane.path.stem}{f'-{self._scans.panes.index(pane)}' if several else ''}-camera.json"

    def _keywords(self, state: ViewState) -> dict[str, Any]:
        """The keywords of the call in Python: a frame and a scale that clouds share have no keyword of their own."""
        keywords = state.keywords(self._up)
        limits = self._scans.common_limits(state)
        if limits is not None:
            keywords["clim"] = limits
        if state.same_frame:  # the camera stands for the up axis and the view
            keywords = {name: value for name, value in keywords.items() if name not in ("up", "view")}
            keywords["camera"] = str(self._folder / "camera.json")
        return keywords


def _outputs_of(json_lines: str) -> list[Path]:
    """The pictures that `z2p run-inference --json` names."""
    import json

    outcomes = [json.loads(line) for line in json_lines.splitlines() if line.startswith("{")]
    return [Path(output) for outcome in outcomes for output in outcome.get("outputs", [])]
