"""What a run refuses before it draws: outputs that would replace other files, and contradicting options."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result


@pytest.mark.parametrize(
    ("name", "message"),
    [("scans/one.npy", "reads or writes"), ("scans/../scans/one.npy", "reads or writes"),
     ("link.npy", "reads or writes"), ("out/one.png", "a picture's"), ("new.webp", "a picture's"),
     ("scans", "a folder"), ("notes.json", "no camera"), ("notes.json/cam.json", "cannot write to")],
)  # fmt: skip
def test_save_camera_replaces_only_cameras(
    render: Callable[..., Result], scans: Path, tmp_path: Path, name: str, message: str
) -> None:
    (tmp_path / "notes.json").write_text('{"mine": 1}')
    (tmp_path / "link.npy").symlink_to(scans / "one.npy")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    result = render(scans / "one.npy", "--save-camera", tmp_path / name)
    assert result.exit_code == 2 and "--save-camera" in result.stderr
    assert message in " ".join(result.stderr.split())
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before  # nor was it drawn
    for _ in range(2):  # its own, again
        assert render(scans / "one.npy", "--overwrite", "--save-camera", tmp_path / "cam.json").exit_code == 0


def test_an_output_with_a_slash_at_its_end_is_a_folder(
    z2p: Callable[..., Result], render: Callable[..., Result], scans: Path, tmp_path: Path, tiny_weights: Path
) -> None:
    assert render(scans, output=f"{tmp_path}/new.png/").exit_code == 0
    assert sorted(path.name for path in (tmp_path / "new.png").iterdir()) == ["one.png", "two.png"]
    result = z2p("animate", scans / "one.npy", "-o", f"{tmp_path}/new.gif/", "--frames", 2, "--resolution", 32,
                 "--weights", tiny_weights)  # fmt: skip
    assert result.exit_code == 0 and (tmp_path / "new.gif" / "one.webp").is_file(), result.output


@pytest.mark.parametrize("words", [("--output", ""), ("--output", "-"), ("",), ("--fps", "nan"), ("--cut-top", "nan"),
                                   ("--load-camera", "cam.json", "--up", "+Z"), ("--view", "3,4", "--elevation", "9")])
def test_animate_refuses_the_same_contradictions(
    z2p: Callable[..., Result], scans: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert z2p("animate", scans / "one.npy", *words).exit_code == 2
    assert [path.name for path in tmp_path.iterdir()] == ["scans"]
