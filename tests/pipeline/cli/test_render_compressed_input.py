"""Scans that are compressed, come through standard input, have named columns, or are too large."""

from __future__ import annotations

import gzip
import io
import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from PIL import Image

from z2p_core.interfaces import ScanError
from z2p_renderer.pipeline.cli import main
from z2p_renderer.storage.images.image_files import read_record
from z2p_renderer.storage.scans import clouds
from z2p_renderer.storage.scans.clouds import read_clouds
from z2p_renderer.storage.scans.unpack import spool


def pixels(path: Path) -> np.ndarray:
    return np.asarray(Image.open(path))


def test_gzipped_scans_are_read_and_named_without_gz(
    render: Callable[..., Result], scans: Path, tmp_path: Path
) -> None:
    assert render(scans).exit_code == 0
    zipped = tmp_path / "zipped"
    zipped.mkdir()
    for path in scans.iterdir():
        (zipped / f"{path.name}.gz").write_bytes(gzip.compress(path.read_bytes()))
    assert render(zipped, output=tmp_path / "unzipped").exit_code == 0
    for name in ("one.png", "two.png"):
        assert np.array_equal(pixels(tmp_path / "unzipped" / name), pixels(tmp_path / "out" / name))
    assert read_record(tmp_path / "unzipped" / "one.png")["input"]["name"] == "one.npy.gz"


def test_a_damaged_gz_is_reported_in_one_line(scans: Path, tmp_path: Path) -> None:
    whole = gzip.compress((scans / "one.npy").read_bytes())
    for content in (b"no gzip", whole[:50], whole[:-8] + bytes(8), b""):
        (tmp_path / "a.npy.gz").write_bytes(content)
        with pytest.raises(ScanError, match=r"a\.npy\.gz: ") as caught:
            read_clouds(tmp_path / "a.npy.gz")
        assert "\n" not in str(caught.value)
    (tmp_path / "a.foo.gz").write_bytes(whole)
    with pytest.raises(ScanError, match=r"no reader for '\.foo'"):
        read_clouds(tmp_path / "a.foo.gz")


def test_files_too_large_for_memory_are_refused_at_once(
    scans: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "bomb.xyz.gz").write_bytes(gzip.compress(b"0 0 0\n" * 4_000_000, 1))
    monkeypatch.setattr(clouds, "free_memory", lambda: 100_000)
    with pytest.raises(ScanError, match=r"one\.npy: would take about 0\.0 GB"):
        read_clouds(scans / "one.npy")
    with pytest.raises(ScanError, match=r"bomb\.xyz\.gz: unpacks to more than"):
        read_clouds(tmp_path / "bomb.xyz.gz")
    monkeypatch.setattr(clouds, "free_memory", lambda: None)  # a system that does not tell
    assert len(read_clouds(scans / "one.npy")[0].points) == 400


def test_standard_input_with_a_false_gzip_header_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ScanError, match="begins like a gzip file"):
        spool(io.BytesIO(b"\x1f\x8b" + bytes(range(200))), tmp_path)


def test_a_pipe_in_a_folder_is_passed_over(render: Callable[..., Result], scans: Path) -> None:
    os.mkfifo(scans / "pipe.txt")
    result = render(scans)
    assert result.exit_code == 1 and "pipe.txt: expected a file" in result.stderr and "2 rendered" in result.stderr


def stl(triangles: int, stray: bytes = b"") -> bytes:
    return bytes(80) + triangles.to_bytes(4, "little") + bytes(range(50)) * triangles + stray


@pytest.mark.parametrize(
    ("content", "suffix"),
    [(b"x,y,z\n1,2,3\n", ".txt"), ("\ufeffx,y,z\n1,2,3\n".encode(), ".txt"), ("x;y\n1;2\n".encode("utf-16"), ".txt"),
     (b"label,x,y,z\noak,1,2,3\n", ".txt"), (b"1 2 3 4 5 6\n", ".txt"), (b"9\n1 2 3\n", ".txt"),
     (b"OFFSET,x,y,z\n1,2,3,4\n", ".txt"), (b"OFF\n3 0 0\n", ".off"), (b"# by hand\nCOFF\n3 0 0\n", ".off"),
     (b"STCNOFF 3 0 0\n", ".off"), (stl(9), ".stl"), (stl(30_000), ".stl"), (stl(9, b"\r\n"), ".stl"), (stl(0), ".stl"),
     (stl(9)[:-50], ".txt"), (b"\n v 1 2 3\n", ".obj"), (b"solid a\n", ".stl"),
     (b"\x89HDF\r\n\x1a\n", ".h5"), (b"\x1f\x8b", ".txt")]
)  # fmt: skip
def test_the_format_of_standard_input_is_detected(tmp_path: Path, content: bytes, suffix: str) -> None:
    for blob in (content, gzip.compress(content)):
        path = spool(io.BytesIO(blob), tmp_path)
        assert path.name.removesuffix(".gz") == f"stdin{suffix}" and path.read_bytes() == blob


def test_text_tables_are_read_from_standard_input(tiny_weights: Path, tmp_path: Path) -> None:
    rows = [f"old oak,{x},{y},{x * y}" for x in range(5) for y in range(5)]
    words = ["run-inference", "-", "-o", str(tmp_path / "a.png"), "--weights", str(tiny_weights), "--resolution", "32"]
    result = CliRunner().invoke(main, words, input="\n".join(["label,x,y,z", *rows]).encode("utf-16"))
    assert result.exit_code == 0 and "25 points" in result.stderr, result.output


@pytest.mark.parametrize("form", ["npy", "xyz", "xyz.gz"])
def test_standard_input_is_rendered(tiny_weights: Path, scans: Path, tmp_path: Path, form: str) -> None:
    blob = (scans / "one.npy").read_bytes()
    if form != "npy":
        blob = (scans / "two.xyz").read_bytes()
    blob = gzip.compress(blob) if form.endswith("gz") else blob
    words = ["run-inference", "-", "-o", str(tmp_path / "out"), "--weights", str(tiny_weights), "--resolution", "32"]
    result = CliRunner().invoke(main, [*words, "--json"], input=blob)
    assert result.exit_code == 0, result.output
    assert result.stderr.startswith("rendered: standard input -> ")
    assert json.loads(result.stdout)["input"] == "-"
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["stdin.png"]
    assert read_record(tmp_path / "out" / "stdin.png")["input"]["path"] is None
    again = ["rerender", str(tmp_path / "out" / "stdin.png"), "--weights", str(tiny_weights)]
    assert "came through standard input" in CliRunner().invoke(main, again).stderr
    empty = CliRunner().invoke(main, words, input=b"")
    assert empty.exit_code == 2 and "standard input is empty" in empty.stderr
    assert CliRunner().invoke(main, [*words, "-"], input=blob).exit_code == 2


@pytest.mark.slow
def test_standard_input_of_a_real_process(tiny_weights: Path, scans: Path, tmp_path: Path) -> None:
    with (scans / "one.npy").open("rb") as scan:
        done = subprocess.run(
            [sys.executable, "-m", "z2p_renderer.pipeline.cli", "run-inference", "-", "-o", tmp_path / "a.png", "-q",
             "--weights", tiny_weights, "--resolution", "32"],
            stdin=scan, capture_output=True, env={**os.environ, "OMP_NUM_THREADS": "1"},
        )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (0, b"", b"")
    assert Image.open(tmp_path / "a.png").size == (32, 32)


def test_a_time_before_the_coordinates_needs_column_names(
    render: Callable[..., Result], tmp_path: Path, cloud: np.ndarray
) -> None:
    table = np.hstack([1.6e9 + np.arange(len(cloud))[:, None] / 8, cloud, np.ones((len(cloud), 2))])
    np.savetxt(tmp_path / "six.xyz", table)
    np.save(tmp_path / "plain.npy", np.loadtxt(tmp_path / "six.xyz")[:, 1:4])
    refused = render(tmp_path / "six.xyz")
    assert refused.exit_code == 1 and "--columns time,x,y,z,c5,c6" in refused.stderr
    assert render(tmp_path / "six.xyz", "--columns", "time, X, Y, Z, a, b").exit_code == 0
    assert render(tmp_path / "plain.npy").exit_code == 0
    assert np.array_equal(pixels(tmp_path / "out" / "six.png"), pixels(tmp_path / "out" / "plain.png"))
    assert read_record(tmp_path / "out" / "six.png")["input"]["columns"] == ["time", "x", "y", "z", "a", "b"]
    wrong = render(tmp_path / "six.xyz", "--columns", "x,y,z", "--overwrite")
    assert wrong.exit_code == 1 and "names 3 columns (x,y,z), the file has 6" in wrong.stderr
    for text in ("x,y", "x,y,z,x", "r,g,b"):
        assert render(tmp_path / "six.xyz", "--columns", text).exit_code == 2


def test_a_readers_note_is_in_the_line_of_the_file(
    render: Callable[..., Result], tmp_path: Path, cloud: np.ndarray
) -> None:
    np.savetxt(tmp_path / "numbered.txt", np.column_stack([np.arange(len(cloud)), cloud]))
    result = render(tmp_path / "numbered.txt", "--json")
    note = "column 1 counts the rows, so x y z are columns 2 to 4; --columns x,y,z,c4 takes it as x"
    assert f" s; {note}; up " in result.stderr and json.loads(result.stdout)["note"] == note


def test_a_url_is_refused_with_the_reason(render: Callable[..., Result]) -> None:
    result = render("https://example.org/a.ply")
    assert result.exit_code == 2
    assert "is a URL; z2p reads local files only, so download it first" in result.stderr
