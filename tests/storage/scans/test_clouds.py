"""Scans on disk: search, reading and refusals; good and bad readers."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from z2p_core import registry
from z2p_core.interfaces import RawCloud, Reader, ScanError, Sensor
from z2p_renderer.storage.scans.clouds import find_scans, read_clouds, read_each, readable_suffixes, write_cloud


def points(count: int = 20) -> np.ndarray:
    return np.random.default_rng(1).normal(size=(count, 3))


def touch(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_cloud(path, points())
    return path


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_cloud_round_trip_is_exact_and_repeatable(tmp_path: Path, dtype: type) -> None:
    array = (points() + 5.4e6).astype(dtype)
    write_cloud(tmp_path / "a.ply", array)
    write_cloud(tmp_path / "b.ply", np.asfortranarray(array))
    (scan,) = read_clouds(tmp_path / "a.ply")
    assert scan.points.dtype == np.float64
    assert np.array_equal(scan.points, array.astype(np.float64))
    assert (scan.dropped, scan.label) == (0, "")
    assert (tmp_path / "a.ply").read_bytes() == (tmp_path / "b.ply").read_bytes()


def test_rows_that_are_not_finite_are_dropped_and_counted(tmp_path: Path) -> None:
    array = points()
    array[2, 1], array[5], array[9, 0] = np.nan, np.inf, -np.inf
    write_cloud(tmp_path / "a.ply", array)
    (scan,) = read_clouds(tmp_path / "a.ply")
    assert scan.dropped == 3
    assert np.array_equal(scan.points, np.delete(array, [2, 5, 9], axis=0))


def test_batches_give_labelled_scans_in_any_suffix_case(tmp_path: Path) -> None:
    batch = np.random.default_rng(2).normal(size=(4, 10, 3))
    np.save(tmp_path / "a.npy", batch)
    (tmp_path / "a.npy").rename(tmp_path / "A.NPY")
    scans = read_clouds(tmp_path / "A.NPY")
    assert [scan.label for scan in scans] == ["[0]", "[1]", "[2]", "[3]"]
    assert np.array_equal(np.stack([scan.points for scan in scans]), batch)
    batch[2] = np.nan
    np.save(tmp_path / "b.npy", batch)
    with pytest.raises(ScanError, match=r"cloud \[2\]: none of the 10"):
        read_clouds(tmp_path / "b.npy")
    each = read_each(tmp_path / "b.npy")
    assert [isinstance(scan, ScanError) for scan in each] == [False, False, True, False]
    assert str(each[2]).startswith(f"{tmp_path / 'b.npy'}: cloud [2]: none of the 10")


@pytest.mark.parametrize(
    ("array", "match"),
    [
        (np.empty((0, 3)), "is empty"),
        (np.full((9, 3), np.nan), "none of the 9 points is a place"),
        (np.vstack([points(2), np.full((4, 3), np.inf)]), "at least 3 finite points, got 2 of 6"),
        (points(1), "got 1 of 1"),
        (np.full((7, 3), 5e6), "all 7 points are at one place"),
    ],
)
@pytest.mark.parametrize("suffix", [".ply", ".npy", ".xyz"])
def test_clouds_without_extent_are_refused(tmp_path: Path, array: np.ndarray, match: str, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    {".ply": write_cloud, ".npy": np.save, ".xyz": np.savetxt}[suffix](path, array)
    with pytest.raises(ScanError, match=match) as caught:
        read_clouds(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("suffix", sorted(readable_suffixes()))
def test_an_empty_file_and_garbage_are_refused_by_name(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    for blob in (b"", b"\x00\xffgarbage\n" * 99):
        path.write_bytes(blob)
        with pytest.raises(ScanError, match=rf"a\{suffix}: ") as caught:
            read_clouds(path)
        assert "\n" not in str(caught.value)


def test_files_that_cannot_be_opened_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ScanError, match="cannot be opened"):
        read_clouds(tmp_path / "missing.ply")
    (tmp_path / "loop.ply").symlink_to("loop.ply")
    with pytest.raises(ScanError, match="cannot be opened"):
        read_clouds(tmp_path / "loop.ply")
    (tmp_path / "folder.ply").mkdir()
    for folder in (tmp_path, tmp_path / "folder.ply"):
        with pytest.raises(ScanError, match="expected a file, got a folder"):
            read_clouds(folder)
    os.mkfifo(tmp_path / "pipe.ply")
    with pytest.raises(ScanError, match="got a folder or a device"):
        read_clouds(tmp_path / "pipe.ply")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_file_without_read_permission_is_refused(tmp_path: Path) -> None:
    touch(tmp_path / "a.ply").chmod(0)
    with pytest.raises(ScanError, match="cannot be opened"):
        read_clouds(tmp_path / "a.ply")


def test_unknown_suffix_lists_the_readable_ones(tmp_path: Path) -> None:
    (tmp_path / "a.docx").write_text("hello")
    with pytest.raises(ScanError, match=r"no reader for '.docx'; readable: .*\.laz.*\.ply"):
        read_clouds(tmp_path / "a.docx")


def test_messages_stay_on_one_line_for_any_file_name(tmp_path: Path) -> None:
    for name in ("with space.ply", "línea.ply", "new\nline.ply"):
        (tmp_path / name).write_bytes(b"garbage")
        with pytest.raises(ScanError, match="another format") as caught:
            read_clouds(tmp_path / name)
        assert "\n" not in str(caught.value)


class Strange(Reader):
    """A third-party reader with mistakes."""

    name = "strange"
    version = "1"
    suffixes = (".odd", ".ply")

    def read(self, path: Path) -> list[np.ndarray]:
        if path.stem == "shape":
            return [np.zeros((3, 9))]
        raise KeyError("no such thing")


def with_reader(monkeypatch: pytest.MonkeyPatch, plugin: type[Reader] | Exception) -> None:
    """One more reader named `strange`, as though it had been installed."""
    names, load = registry.names, registry.load

    def load_strange(group: str, name: str) -> type:
        if name != "strange":
            return load(group, name)
        if isinstance(plugin, Exception):
            raise plugin
        return plugin

    monkeypatch.setattr(registry, "names", lambda group: [*names(group), "strange"])
    monkeypatch.setattr(registry, "load", load_strange)


def test_an_error_in_a_plugin_reader_fails_its_file_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with_reader(monkeypatch, Strange)
    (tmp_path / "a.odd").write_bytes(b"?")
    (tmp_path / "shape.odd").write_bytes(b"?")
    with pytest.raises(ScanError, match=r"'strange' failed \(KeyError: 'no such thing'\)"):
        read_clouds(tmp_path / "a.odd")
    with pytest.raises(ScanError, match=r"gave arrays \(3, 9\)"):
        read_clouds(tmp_path / "shape.odd")
    with pytest.raises(ScanError, match="claimed by the readers ply and strange"):
        read_clouds(touch(tmp_path / "a.ply"))


class Seeing(Reader):
    """A reader that tells of a sensor with its first cloud alone."""

    name, version, suffixes = "strange", "1", (".odd",)

    def read(self, path: Path) -> list[RawCloud | np.ndarray]:
        return [RawCloud(points(), Sensor(np.ones(3), np.eye(3))), points()]


def test_a_scan_keeps_its_sensor(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with_reader(monkeypatch, Seeing)
    (tmp_path / "a.odd").write_bytes(b"?")
    first, second = read_clouds(tmp_path / "a.odd")
    assert first.sensor is not None and np.array_equal(first.sensor.position, [1, 1, 1])
    assert second.sensor is None
    assert np.array_equal(first.points, second.points)


def test_a_broken_reader_does_not_break_the_rest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with_reader(monkeypatch, registry.PluginError("reader 'strange' fails to load"))
    assert len(read_clouds(touch(tmp_path / "a.ply"))) == 1
    with pytest.raises(ScanError, match="'strange' fails to load"):
        read_clouds(tmp_path / "a.odd")


def names(paths: list[Path], root: Path) -> list[str]:
    return [str(path.relative_to(root)) for path in paths]


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A folder with scans, other files, hidden files, links that loop, lead out, or point at nothing."""
    root = tmp_path / "root"
    for name in ("b.ply", "A.PLY", "c [1].ply", ".hidden.ply", "sub/d.ply", "sub/deep/e.ply", ".cache/f.ply"):
        touch(root / name)
    (root / "notes.md").write_text("no scan")
    touch(tmp_path / "outside" / "secret.ply")
    (root / "sub" / "loop").symlink_to(root, target_is_directory=True)
    (root / "out.ply").symlink_to(tmp_path / "outside", target_is_directory=True)
    (root / "linked.ply").symlink_to(tmp_path / "outside" / "secret.ply")
    (root / "dangling.ply").symlink_to("nowhere.ply")
    return root


TOP = ["A.PLY", "b.ply", "c [1].ply", "dangling.ply", "linked.ply"]


def test_folder_gives_its_readable_files_sorted(tree: Path) -> None:
    assert names(find_scans([str(tree)], recursive=False), tree) == TOP


def test_recursive_walks_once_and_never_through_links(tree: Path) -> None:
    assert names(find_scans([str(tree)], recursive=True), tree) == [*TOP, "sub/d.ply", "sub/deep/e.ply"]


def test_globs_are_expanded_unless_the_literal_path_exists(tree: Path) -> None:
    assert names(find_scans([f"{tree}/*.ply"], False), tree) == TOP[1:]
    assert names(find_scans([f"{tree}/**/*.ply"], False), tree) == [*TOP[1:], "sub/d.ply", "sub/deep/e.ply"]
    assert names(find_scans([f"{tree}/c [1].ply"], False), tree) == ["c [1].ply"]
    assert names(find_scans([f"{tree}/[ab].*"], False), tree) == ["b.ply"]


def test_relative_inputs_and_files_given_twice(tree: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tree)
    assert find_scans(["b.ply", "./sub/../b.ply", "*.ply"], False)[0] == Path("b.ply")
    assert sorted(map(str, find_scans(["b.ply", "*.ply", "."], False))) == sorted(TOP)


def test_a_file_is_taken_whatever_its_suffix(tree: Path) -> None:
    assert find_scans([str(tree / "notes.md")], False) == [tree / "notes.md"]
    assert find_scans([str(tree / ".hidden.ply")], False) == [tree / ".hidden.ply"]


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("{root}/missing.ply", "no such file or folder"),
        ("{root}/*.laz", r"pattern .*holds no point cloud; readable: .*\.ply"),
        ("{root}/*.md", "holds no point cloud"),
        ("{root}/**.ply", "cannot be searched"),
        ("{root}/empty", r"folder .*empty holds no point cloud; readable: .*--recursive"),
        ("https://example.org/a.ply", "is a URL"),
        ("s3://bucket/a.ply", "is a URL"),
        ("x" * 5000, "cannot be searched"),
        ("", "."),
    ],
)
def test_inputs_that_match_nothing_are_refused(tree: Path, text: str, match: str, monkeypatch) -> None:
    (tree / "empty").mkdir()
    monkeypatch.chdir(tree / "empty")
    with pytest.raises(ScanError, match=match):
        find_scans([str(tree / "b.ply"), text.format(root=tree)], recursive=False)


def test_a_missing_path_suggests_a_similar_name_if_unique(tmp_path: Path) -> None:
    for name in ("bunny.ply", "scan_002.ply"):
        (tmp_path / name).touch()
    for wrong, message in (("buny.ply", r"did you mean .*bunny\.ply\?"), ("scan_001.ply", "check the path"),
                        ("horse.ply", "check the path"), ("none/bunny.ply", "check the path")):  # fmt: skip
        with pytest.raises(ScanError, match=message):
            find_scans([str(tmp_path / wrong)], False)


def test_an_image_given_as_scan_is_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "bunny.ply").touch()
    with pytest.raises(ScanError, match=r"a picture that is to be written is named by --output .*bunny\.png"):
        find_scans([str(tmp_path / "bunny.ply"), str(tmp_path / "bunny.png")], False)


def test_ignored_columns_option_gets_a_note(tmp_path):
    rows = np.random.default_rng(0).normal(size=(50, 4))
    np.save(tmp_path / "a.npy", rows[:, :3])
    np.savetxt(tmp_path / "a.txt", rows)
    array, text = (read_clouds(tmp_path / name, ("x", "y", "z", "label"))[0].note for name in ("a.npy", "a.txt"))
    assert "--columns ignored" in array and "--columns" not in text
    assert "--columns" not in read_clouds(tmp_path / "a.npy")[0].note
