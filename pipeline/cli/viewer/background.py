"""A viewer beside a running program, such as a notebook."""

from __future__ import annotations

import shutil
import tempfile
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from z2p_core.api.view import GIVEN_VALUES
from z2p_renderer.pipeline.cli.viewer.saving import Saver
from z2p_renderer.pipeline.cli.viewer.server import ViewServer
from z2p_renderer.pipeline.cli.viewer.viewed_scans import ViewedScans

PICTURES_FOLDER = Path("pictures")


class BackgroundViewer:
    """A viewer whose server runs in a thread of its own; it ends with the program."""

    def __init__(self, server: ViewServer, folder: Path | None) -> None:
        self._server, self._folder = server, folder
        self.address = server.address
        self._thread = threading.Thread(target=server.serve_forever, args=(0.2,), daemon=True, name="z2p view")
        self._thread.start()

    def close(self) -> None:
        """End the server and remove the points' temporary files; a second time does nothing."""
        self._server.shutdown()
        self._server.server_close()
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)
            self._folder = None


def start_viewer(
    points: Sequence[Path] | Sequence[np.ndarray], fields: Sequence[Mapping[str, np.ndarray]], up: str
) -> BackgroundViewer:
    """A running viewer of files, or of clouds (N, 3), which are kept in temporary files until it ends.

    Raises:
        ScanError: no cloud can be shown.
    """
    import atexit

    paths = [one for one in points if isinstance(one, Path)]
    folder = None if paths else Path(tempfile.mkdtemp(prefix="z2p-view-"))
    if folder is not None:
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
        clouds = [np.asarray(cloud) for cloud in points]
        paths = [_write_cloud(folder, index, cloud, fields[index]) for index, cloud in enumerate(clouds)]
    scans = ViewedScans(paths)
    saver = Saver(scans, PICTURES_FOLDER, [], None if folder is None else "points", "auto" if folder is None else "+Z")
    color_by = GIVEN_VALUES if fields and all(GIVEN_VALUES in one for one in fields) else "auto"
    server = ViewServer(scans, saver, port=0, ends_with_page=False, first_up=up, first_color_by=color_by)
    return BackgroundViewer(server, folder)


def _write_cloud(folder: Path, index: int, cloud: np.ndarray, fields: Mapping[str, np.ndarray]) -> Path:
    """The file of one cloud with its fields."""
    path = folder / f"points{index or ''}.npz"
    np.savez(path, points=cloud, **{name: np.asarray(values) for name, values in fields.items()})  # type: ignore[arg-type]
    return path
