"""What a run refuses before it draws: paths that would cost a file, and options that contradict each other."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result


@pytest.mark.parametrize(
    ("name", "told"),
    [("scans/one.npy", "reads or writes"), ("scans/../scans/one.npy", "reads or writes"),
     ("link.npy", "reads or writes"), ("out/one.png", "a picture's"), ("new.webp", "a picture's"),
     ("scans", "a folder"), ("notes.json", "no camera"), ("notes.json/cam.json", "cannot write to")],
)  # fmt: skip
def test_a_camera_replaces_nothing_but_a_camera(
    render: Callable[..., Result], scans: Path, tmp_path: Path, name: str, told: str
) -> None:
    (tmp_path / "notes.json").write_text('{"mine": 1}')
    (tmp_path / "link.npy").symlink_to(scans / "one.npy")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    result = render(scans / "one.npy", "--save-camera", tmp_path / name)
    assert result.exit_code == 2 and "--save-camera" in result.stderr
    assert told in " ".join(result.stderr.split())
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before  # nor was it drawn
    for _ in range(2):  # its own, again
        assert render(scans / "one.npy", "--overwrite", "--save-camera", tmp_path / "cam.json").exit_code == 0
