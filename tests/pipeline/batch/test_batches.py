from __future__ import annotations

import gzip
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from z2p_core.coloring.options import ColorOptions
from z2p_renderer.pipeline.batch.render_files import render_files
from z2p_renderer.pipeline.batch.tasks import Task, plan_outputs
from z2p_renderer.pipeline.inference.look import Look
from z2p_renderer.pipeline.inference.renderer import Renderer
from z2p_renderer.storage.images.image_files import write_picture

LOOK = Look(width=32, height=32)


@pytest.fixture(scope="module")
def renderer(tiny_weights: Path) -> Renderer:
    return Renderer(tiny_weights)


def names(scans: list[str], folders: list[str] | None = None, mirror: bool = False) -> list[str]:
    tasks = plan_outputs([Path(scan) for scan in scans], [Path(one) for one in folders or []], Path("out"), mirror)
    return [task.output.relative_to("out").as_posix() for task in tasks]


def test_outputs_are_named_by_stem() -> None:
    assert names(["in/a.ply", "in/b.c.xyz", "in/no suffix"]) == ["a.png", "b.c.png", "no suffix.png"]


def test_shared_stems_keep_their_suffix_in_any_order() -> None:
    assert names(["a.ply", "a.pcd", "b.ply"]) == ["a.ply.png", "a.pcd.png", "b.png"]
    assert names(["b.ply", "a.pcd", "a.ply"]) == ["b.png", "a.pcd.png", "a.ply.png"]


@pytest.mark.parametrize(
    "scans",
    [
        ["x/a.ply", "y/a.ply", "z/a.ply"],
        ["a.ply", "a.pcd", "a.ply.xyz"],
        ["a.ply.xyz", "a.ply", "a.pcd"],
        ["x/a.ply", "y/a.ply", "a.ply-2.xyz"],
    ],
)
def test_no_two_scans_share_a_picture(scans: list[str]) -> None:
    assert len(set(names(scans))) == len(scans)
    assert names(scans) == names(scans)


def test_sub_folders_are_mirrored_and_part_equal_names() -> None:
    scans = ["in/a.ply", "in/s/a.ply", "in/s/t/a.ply", "in/s/t/a.pcd", "other/a.ply"]
    assert names(scans, ["in"], mirror=True) == [
        "a.ply.png", "s/a.png", "s/t/a.ply.png", "s/t/a.pcd.png", "a.ply-2.png"
    ]  # fmt: skip


def test_a_picture_is_written_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = tmp_path / "a.png"
    write_picture(np.zeros((32, 32, 4), np.uint8), target)
    before = target.read_bytes()

    def fail(self: Path, to: Path) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", fail)
    with pytest.raises(OSError, match="No space"):
        write_picture(np.full((32, 32, 4), 9, np.uint8), target)
    assert target.read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["a.png"]


def test_background_is_blended_on_srgb_values(tmp_path: Path) -> None:
    picture = np.full((32, 32, 4), (200, 100, 0, 51), np.uint8)  # alpha 0.2
    write_picture(picture, tmp_path / "clear.png")
    write_picture(picture, tmp_path / "white.png", (1.0, 1.0, 1.0))
    assert np.array_equal(np.asarray(Image.open(tmp_path / "clear.png")), picture)
    white = np.asarray(Image.open(tmp_path / "white.png"))
    assert white.shape == (32, 32, 3)
    assert np.abs(white[0, 0].astype(int) - (244, 224, 204)).max() <= 1


def test_bad_files_do_not_stop_others_with_any_thread_count(
    tmp_path: Path, renderer: Renderer, cloud: np.ndarray
) -> None:
    for index in range(6):
        np.save(tmp_path / f"{index}.npy", cloud + np.arange(len(cloud))[:, None] * index * 0.01)
    (tmp_path / "3.npy").write_bytes(b"garbage")
    scans = sorted(tmp_path.glob("*.npy"))
    pictures = []
    for jobs in (1, 3):
        tasks = plan_outputs(scans, [], tmp_path / f"out{jobs}", False)
        outcomes = list(render_files(tasks, renderer, LOOK, jobs=jobs))
        assert [outcome.scan for outcome in outcomes] == scans
        assert [outcome.status for outcome in outcomes] == ["ok", "ok", "ok", "failed", "ok", "ok"]
        assert all("\n" not in (outcome.error or "") for outcome in outcomes)
        assert "Traceback" not in str(outcomes[3].error)
        pictures.append([path.read_bytes() for path in sorted((tmp_path / f"out{jobs}").iterdir())])
    assert len(pictures[0]) == 5
    assert pictures[0] == pictures[1]
    assert len(set(pictures[0])) == 5


def test_only_one_large_file_at_a_time_is_in_memory(
    tmp_path: Path, renderer: Renderer, monkeypatch: pytest.MonkeyPatch
) -> None:
    from z2p_renderer.pipeline.batch import render_files as batch

    at_work, together = set[str](), set[frozenset[str]]()
    both_light = threading.Barrier(2, timeout=20)
    original = batch.read_scans

    def watched(path: Path, columns: None, options: ColorOptions, max_rows: int) -> list[batch.Scan]:
        at_work.add(path.stem)
        together.add(frozenset(at_work))
        if path.stem.startswith("light"):
            both_light.wait()  # for ever, if they came one after the other
        try:
            return original(path, columns, options, max_rows)
        finally:
            at_work.remove(path.stem)

    monkeypatch.setattr(batch, "read_scans", watched)
    monkeypatch.setattr(batch, "LARGE_FILE_BYTES", 5_000)
    for name, count in {"light1": 50, "light2": 60, "heavy1": 900, "heavy2": 901, "heavy3": 902}.items():
        np.save(tmp_path / f"{name}.npy", np.random.default_rng(count).normal(size=(count, 3)))
    packed = tmp_path / "heavy4.npy.gz"  # it is what it unpacks to that counts
    np.save(tmp_path / "even.npy", np.stack(np.meshgrid(*[np.arange(9.0)] * 3), -1).reshape(-1, 3))
    packed.write_bytes(gzip.compress((tmp_path / "even.npy").read_bytes()))
    (tmp_path / "even.npy").unlink()
    assert packed.stat().st_size < 5_000
    tasks = plan_outputs(sorted(tmp_path.glob("*.npy*"), reverse=True), [], tmp_path, False)
    assert [one.status for one in render_files(tasks, renderer, LOOK, jobs=3)] == ["ok"] * 6
    assert all(sum(name.startswith("heavy") for name in names) < 2 for names in together)


def test_jobs_bound_the_clouds_in_memory(tmp_path: Path, renderer: Renderer, monkeypatch: pytest.MonkeyPatch) -> None:
    from z2p_renderer.pipeline.batch import render_files as batch

    alive, most, lock = [0], [0], threading.Lock()
    original = batch.read_scans

    def counted(path: Path, columns: None, options: ColorOptions, max_rows: int) -> list[batch.Scan]:
        with lock:
            alive[0] += 1
            most[0] = max(most[0], alive[0])
        return original(path, columns, options, max_rows)

    def drawn(*arguments: object) -> None:
        with lock:
            alive[0] -= 1

    monkeypatch.setattr(batch, "read_scans", counted)
    monkeypatch.setattr(batch, "write_picture", drawn)
    for index in range(12):
        np.save(tmp_path / f"{index}.npy", np.random.default_rng(index).normal(size=(50, 3)))
    tasks = plan_outputs(sorted(tmp_path.glob("*.npy")), [], tmp_path, False)
    assert len(list(render_files(tasks, renderer, LOOK, jobs=2))) == 12
    assert 1 <= most[0] <= 2


def test_threads_take_turns_faster_only_meanwhile(tmp_path: Path, renderer: Renderer, cloud: np.ndarray) -> None:
    np.savetxt(tmp_path / "one.xyz", cloud)
    tasks = [Task(tmp_path / "one.xyz", tmp_path / f"{number}.png") for number in range(3)]
    usual, seen = sys.getswitchinterval(), []
    for _ in render_files(tasks, renderer, Look(width=32, height=32), jobs=2):
        seen.append(sys.getswitchinterval())
    assert max(seen) < usual == sys.getswitchinterval()
    outcomes = render_files(tasks, renderer, Look(width=32, height=32), overwrite=True, jobs=2)
    next(outcomes)
    outcomes.close()
    assert sys.getswitchinterval() == usual


def test_numbered_pictures_do_not_collide_with_other_files(
    tmp_path: Path, renderer: Renderer, cloud: np.ndarray
) -> None:
    np.save(tmp_path / "a.npy", np.stack([cloud, cloud[:, ::-1]]))
    np.save(tmp_path / "a_001.npy", cloud)
    out = tmp_path / "out"
    tasks = plan_outputs([tmp_path / "a.npy", tmp_path / "a_001.npy"], [], out, False)
    outcomes = list(render_files(tasks, renderer, LOOK))
    assert [outcome.status for outcome in outcomes] == ["ok", "ok"]
    assert sorted(path.name for path in out.iterdir()) == ["a.npy_000.png", "a.npy_001.png", "a_001.png"]
    assert np.array_equal(Image.open(out / "a.npy_000.png"), Image.open(out / "a_001.png"))


def test_an_interrupted_batch_file_is_completed(tmp_path: Path, renderer: Renderer, cloud: np.ndarray) -> None:
    np.save(tmp_path / "a.npy", np.stack([cloud] * 3))
    tasks = [Task(tmp_path / "a.npy", tmp_path / "a.png")]
    assert [outcome.status for outcome in render_files(tasks, renderer, LOOK)] == ["ok"]
    (tmp_path / "a_001.png").unlink()
    kept = (tmp_path / "a_000.png").stat().st_mtime_ns
    [outcome] = render_files(tasks, renderer, LOOK)
    assert outcome.status == "ok"
    assert (tmp_path / "a_001.png").exists()
    assert (tmp_path / "a_000.png").stat().st_mtime_ns == kept
    assert [outcome.status for outcome in render_files(tasks, renderer, LOOK)] == ["skipped"]


def test_several_clouds_do_not_fit_into_one_named_picture(
    tmp_path: Path, renderer: Renderer, cloud: np.ndarray
) -> None:
    np.save(tmp_path / "a.npy", np.stack([cloud] * 3))
    [outcome] = render_files([Task(tmp_path / "a.npy", tmp_path / "a.png", single=True)], renderer, LOOK)
    assert outcome.status == "failed"
    assert "3 clouds" in str(outcome.error)


def test_a_batch_file_is_digested_once(
    tmp_path: Path, renderer: Renderer, cloud: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    from z2p_renderer.pipeline.inference import scan_source

    digested = []
    monkeypatch.setattr(scan_source, "file_digest", lambda path: digested.append(path) or "0")
    np.save(tmp_path / "a.npy", np.stack([cloud] * 5))
    [outcome] = render_files(plan_outputs([tmp_path / "a.npy"], [], tmp_path / "out", False), renderer, LOOK)
    assert outcome.status == "ok" and len(outcome.outputs) == 5
    assert digested == [tmp_path / "a.npy"]
