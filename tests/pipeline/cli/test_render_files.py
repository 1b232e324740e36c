"""`z2p render`: which files the inputs stand for, and which pictures they become."""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from PIL import Image


def pictures(folder: Path) -> list[str]:
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())


def lines(result: Result) -> list[dict[str, object]]:
    return [json.loads(line) for line in result.stdout.splitlines()]


def test_files_with_equal_stems_and_odd_names_get_own_pictures(
    render: Callable[..., Result], tmp_path: Path, cloud: np.ndarray
) -> None:
    folder = tmp_path / "odd"
    folder.mkdir()
    for name in ("a.xyz", "a.txt", "with space.xyz", "größe 点.xyz", "two\nlines.xyz"):
        np.savetxt(folder / name, cloud[:50])
    result = render(folder, "--json")
    assert result.exit_code == 0, result.output
    assert pictures(tmp_path / "out") == sorted(
        ["a.xyz.png", "a.txt.png", "with space.png", "größe 点.png", "two\nlines.png"]
    )
    assert len(result.stderr.splitlines()) == 6
    assert "two\\nlines" in result.stderr
    assert len(lines(result)) == 5


def test_recursive_mirrors_sub_folders(render: Callable[..., Result], scans: Path, tmp_path: Path) -> None:
    (scans / "sub" / "deep").mkdir(parents=True)
    (scans / "one.npy").rename(scans / "sub" / "deep" / "two.npy")
    assert render(scans).exit_code == 0
    assert pictures(tmp_path / "out") == ["two.png"]
    assert render(scans, "--recursive").exit_code == 0
    assert pictures(tmp_path / "out") == ["sub/deep/two.png", "two.png"]


def test_a_file_given_twice_is_rendered_once(render: Callable[..., Result], scans: Path, tmp_path: Path) -> None:
    assert render(f"{scans}/*.npy", scans / "one.npy").exit_code == 0
    assert pictures(tmp_path / "out") == ["one.png"]


def test_each_cloud_of_a_batch_file_gets_a_picture(
    render: Callable[..., Result], tmp_path: Path, cloud: np.ndarray
) -> None:
    np.save(tmp_path / "many.npy", np.stack([cloud, cloud * (1, 2, 1), cloud * (1, 1, 3)]))
    result = render(tmp_path / "many.npy", "--json")
    assert result.exit_code == 0, result.output
    assert pictures(tmp_path / "out") == ["many_000.png", "many_001.png", "many_002.png"]
    [line] = lines(result)
    assert [Path(path).name for path in line["outputs"]] == pictures(tmp_path / "out")
    assert line["points"] == 3 * len(cloud)
    assert lines(render(tmp_path / "many.npy", "--json"))[0]["status"] == "skipped"


@pytest.mark.parametrize("bad", [np.nan, 0.0])
def test_a_bad_cloud_of_a_batch_file_leaves_the_others(
    render: Callable[..., Result], z2p: Callable[..., Result], tiny_weights: Path, tmp_path: Path, cloud: np.ndarray,
    bad: float,
) -> None:
    np.save(tmp_path / "many.npy", np.stack([cloud, cloud * bad, cloud * (1, 1, 3)]))
    for words in ((), ("--same-frame", "--fit", "tight", "--overwrite")):
        result = render(tmp_path / "many.npy", "--json", *words)
        assert result.exit_code == 1
        assert pictures(tmp_path / "out") == ["many_000.png", "many_002.png"]
        [line] = lines(result)
        assert line["status"] == "failed" and str(line["error"]).startswith("cloud [1]: ")
        assert line["points"] == 2 * len(cloud) and result.stderr.count("[1]") == 1
    last = tmp_path / "out" / "many_002.png"
    assert z2p("rerender", last, "--weights", tiny_weights).exit_code == 0


def test_output_may_name_one_picture(render: Callable[..., Result], scans: Path, tmp_path: Path) -> None:
    target = tmp_path / "figures" / "final.png"
    assert render(scans / "one.npy", output=target).exit_code == 0
    assert pictures(tmp_path / "figures") == ["final.png"]
    result = render(scans, output=tmp_path / "other.png")
    assert result.exit_code == 2
    assert "2 scans" in result.stderr


def test_existing_pictures_are_skipped_unless_overwritten(
    render: Callable[..., Result], scans: Path, tmp_path: Path
) -> None:
    (tmp_path / "out").mkdir()
    Image.new("RGB", (4, 4)).save(tmp_path / "out" / "one.png")
    mine = (tmp_path / "out" / "one.png").read_bytes()
    result = render(scans, "--json")
    assert result.exit_code == 0
    assert [line["status"] for line in lines(result)] == ["skipped", "ok"]
    assert "--overwrite" in result.stderr
    assert (tmp_path / "out" / "one.png").read_bytes() == mine
    result = render(scans, "--json", "--overwrite")
    assert [line["status"] for line in lines(result)] == ["ok", "ok"]
    assert (tmp_path / "out" / "one.png").read_bytes() != mine


def test_an_unwritable_output_is_wrong_usage(render: Callable[..., Result], scans: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    for output in (tmp_path / "file", tmp_path / "file" / "out", tmp_path / "file" / "a.png"):
        result = render(scans / "one.npy", output=output)
        assert result.exit_code == 2, result.output
        assert "cannot write to" in result.stderr


def test_inputs_that_match_nothing_are_refused(render: Callable[..., Result], tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    for source in (tmp_path / "empty", tmp_path / "missing.ply", f"{tmp_path}/*.ply"):
        result = render(source)
        assert result.exit_code == 2, result.output
        assert str(source) in result.stderr
        assert len(result.stderr.splitlines()) == 1
    assert render().exit_code == 2


def test_a_scan_named_in_two_ways_is_rendered_once(
    render: Callable[..., Result], scans: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(scans)
    result = render("one.npy", scans / "one.npy", "./one.npy", scans)
    assert result.exit_code == 0
    assert "2 rendered, 0 skipped, 0 failed" in result.stderr


def test_prose_in_a_folder_is_passed_over_with_a_line(
    render: Callable[..., Result], scans: Path, tmp_path: Path
) -> None:
    for name, text in {"README.txt": "Scans of a fox.\nMade in May.\n", "list.csv": "name,owner\na,b\n", "e.txt": "",
                       "one number.txt": "12\n"}.items():  # fmt: skip
        (scans / name).write_text(text)
    rows = [f"{i},{i * i % 7},{i * i % 5}\n" for i in range(40)]
    (scans / "table.csv").write_text("X,Y,Z\n" + "".join(rows))
    (scans / "plain.txt").write_text("# made by hand\n\n" + "".join(rows).replace(",", " "))
    result = render(scans)
    assert result.exit_code == 0, result.output
    assert sorted(path.stem for path in (tmp_path / "out").iterdir()) == ["one", "plain", "table", "two"]
    lines = [line for line in result.stderr.splitlines() if line.startswith("passed over: ")]
    assert len(lines) == 4 and all("or the file itself" in line for line in lines)
    (scans / "list.csv").write_text("lon,lat,top\n" + "".join(rows))
    assert render(scans, "--columns", "x,y,z").exit_code == 0
    assert (tmp_path / "out" / "list.png").exists()
    named = render(scans / "README.txt")
    assert named.exit_code == 1 and "failed: " in named.stderr


def test_a_full_disk_at_the_end_loses_no_pictures(
    render: Callable[..., Result], scans: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*words: object, **more: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("z2p_renderer.pipeline.outputs.gallery.write_gallery", full)
    monkeypatch.setattr("z2p_renderer.pipeline.outputs.contact_sheet.write_contact_sheets", full)
    result = render(scans, "--gallery", "--sheet", "2x1")
    assert result.exit_code == 1 and len(list((tmp_path / "out").glob("*.png"))) == 2
    for name in ("the contact sheets", "the gallery"):
        assert f"failed: {name}: No space left on device" in result.stderr
    assert "2 rendered, 0 skipped, 0 failed" in result.stderr
