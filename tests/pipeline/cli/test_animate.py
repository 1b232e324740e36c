"""Loops close, show the right motion and keep their record; a bad file does not stop the others."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from PIL import Image, ImageSequence

from z2p_core.interfaces import SettingError
from z2p_renderer.pipeline.inference.look import Look
from z2p_renderer.pipeline.inference.render_scan import render_scan
from z2p_renderer.pipeline.inference.renderer import Renderer
from z2p_renderer.pipeline.outputs.animation import Motion, draw_opening, render_frames
from z2p_renderer.pipeline.placement.options import PlacementOptions
from z2p_renderer.storage.images.animations import write_animation
from z2p_renderer.storage.images.image_files import PictureError, read_record
from z2p_renderer.storage.scans.clouds import Scan, usable

LOOK = Look(width=40, height=40)


@pytest.fixture(scope="module")
def renderer(tiny_weights: Path) -> Renderer:
    return Renderer(tiny_weights)


def loop(renderer: Renderer, scan: Scan, suffix: str, look: Look, motion: Motion) -> Iterator[np.ndarray]:
    return render_frames(draw_opening(renderer, scan, suffix, look), scan, look, motion)


def test_turntable_frames_equal_stills_of_turned_cameras(cloud: np.ndarray) -> None:
    renderer = Renderer("regular")
    look = replace(LOOK, placement_options=PlacementOptions("+Y", view=10.0))
    frames = [premultiplied(frame) for frame in loop(renderer, usable(cloud), ".ply", look, Motion(frames=4))]
    turns = [replace(look, placement_options=PlacementOptions("+Y", 10.0, azimuth=90.0 * turn)) for turn in range(4)]
    stills = [premultiplied(render_scan(renderer, usable(cloud), ".ply", turn).picture) for turn in turns]
    assert np.abs(frames[0] - stills[0]).max() <= 2
    for number in range(1, 4):  # light is sampled along other axes of the cloud
        differences = [np.abs(frames[number] - still).mean() for still in stills]
        assert differences[number] == min(differences) < 0.5 * sorted(differences)[1]


def premultiplied(picture: np.ndarray) -> np.ndarray:
    return picture * (picture[..., 3:] / 255)


def test_an_orbit_moves_camera_and_light_and_begins_as_a_turn(renderer: Renderer, cloud: np.ndarray) -> None:
    orbit, turn = (list(loop(renderer, usable(cloud), "", LOOK, Motion(kind, frames=3))) for kind in ("orbit", "turn"))
    assert np.array_equal(orbit[0], turn[0])
    assert not np.array_equal(orbit[1], turn[1]) and not np.array_equal(orbit[1], orbit[2])


def test_a_turn_of_a_smoothed_cloud_begins_with_its_picture(renderer: Renderer, cloud: np.ndarray) -> None:
    look = replace(LOOK, placement_options=PlacementOptions("+Z", view=10.0, smooth=0.3))
    first = next(loop(renderer, usable(cloud), ".ply", look, Motion(frames=4, steady=1)))
    looks = (look, replace(look, placement_options=PlacementOptions("+Z", view=10.0, smooth=0.0)))
    still, plain = (render_scan(renderer, usable(cloud), ".ply", one).picture for one in looks)
    assert np.abs(first.astype(int) - still).mean() < 0.3 * np.abs(first.astype(int) - plain).mean()


def test_a_light_sweep_goes_right_left_and_back(renderer: Renderer, cloud: np.ndarray) -> None:
    frames = list(loop(renderer, usable(cloud), "", LOOK, Motion("light", frames=4, steady=1)))
    assert np.array_equal(frames[0], frames[2])  # the middle, on the way there and back
    assert not np.array_equal(frames[1], frames[3])
    assert not np.array_equal(frames[0], frames[1])


def test_a_light_sweep_needs_weights_with_a_light(make_weights: Callable[..., Path], cloud: np.ndarray) -> None:
    with pytest.raises(SettingError, match="'light'"):
        list(loop(Renderer(make_weights(("color",))), usable(cloud), "", LOOK, Motion("light", 4, 1)))


def test_a_steady_frame_is_the_mean_of_pictures_around_it(renderer: Renderer, cloud: np.ndarray) -> None:
    fine = list(loop(renderer, usable(cloud), "", LOOK, Motion(frames=12, steady=1)))
    steady = list(loop(renderer, usable(cloud), "", LOOK, Motion(frames=4, steady=3)))
    around = np.stack([fine[-1], fine[0], fine[1]]).astype(float)
    alpha = around[..., 3:] / 255
    assert np.abs(steady[0][..., 3] - around[..., 3].mean(0)).max() <= 1
    premultiplied = (around[..., :3] * alpha).mean(0)
    assert np.abs(steady[0][..., :3] * (steady[0][..., 3:] / 255) - premultiplied).max() <= 2


FRAMES = [np.full((21, 31, 4), (255, 40 * step, 0, 255), np.uint8) for step in range(6)]


@pytest.mark.parametrize("suffix", [".webp", ".gif"])
def test_loops_keep_frames_time_and_record(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    write_animation(FRAMES, path, 20, record={"record": 1, "name": "x" * 3000})
    loop = Image.open(path)
    assert (loop.n_frames, loop.size, loop.info["loop"]) == (6, (31, 21), 0)
    for expected, frame in zip(FRAMES, ImageSequence.Iterator(loop), strict=True):
        frame.load()
        assert frame.info["duration"] == 50
        assert np.abs(np.asarray(frame.convert("RGB")).astype(int) - expected[..., :3]).max() <= 8
    assert read_record(path) == {"record": 1, "name": "x" * 3000}


@pytest.mark.parametrize(("suffix", "rate", "total"), [(".webp", 24, 250), (".gif", 24, 250), (".webp", 60, 100),
                                                       (".gif", 60, 120)])  # fmt: skip
def test_the_duration_of_a_loop_follows_its_frame_rate(tmp_path: Path, suffix: str, rate: float, total: int) -> None:
    write_animation(FRAMES, path := tmp_path / f"a{suffix}", rate)
    stays = []
    for frame in ImageSequence.Iterator(Image.open(path)):
        frame.load()
        stays.append(frame.info["duration"])
    assert sum(stays) == total and min(stays) >= 16 and max(stays) - min(stays) <= 10


def test_webp_loops_are_transparent_and_gifs_have_a_background(tmp_path: Path) -> None:
    clear = [np.full((20, 20, 4), (0, 0, 255, alpha), np.uint8) for alpha in (0, 100)]
    write_animation(clear, tmp_path / "a.webp", 10)
    assert np.asarray(Image.open(tmp_path / "a.webp").convert("RGBA"))[..., 3].max() == 0
    write_animation(clear, tmp_path / "a.gif", 10, (1.0, 0.0, 0.0))
    assert Image.open(tmp_path / "a.gif").convert("RGB").getpixel((3, 3)) == (255, 0, 0)
    busy = np.random.default_rng(0).integers(0, 256, (4, 64, 64, 4)).astype(np.uint8)
    busy[:, :20] = 0
    for behind in ((1.0, 1.0, 1.0), (0.9, 0.302, 0.2)):
        write_animation(busy, tmp_path / "b.gif", 10, behind)
        for frame in ImageSequence.Iterator(Image.open(tmp_path / "b.gif")):
            assert frame.convert("RGB").getpixel((3, 3)) == tuple(round(255 * channel) for channel in behind)
    with pytest.raises(PictureError, match=r"\.webp, \.gif, \.mp4"):
        write_animation(clear, tmp_path / "a.avi", 10)


def test_an_mp4_has_even_sides_and_all_frames(tmp_path: Path) -> None:
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg")
    write_animation(FRAMES, tmp_path / "a.mp4", 12, record={"record": 1})
    reader = imageio_ffmpeg.read_frames(str(tmp_path / "a.mp4"))
    facts = next(reader)
    assert (facts["source_size"], facts["fps"]) == ((32, 22), 12)
    shots = [np.frombuffer(frame, np.uint8).reshape(22, 32, 3) for frame in reader]
    assert len(shots) == 6
    assert np.abs(shots[0][10, 10].astype(int) - (255, 0, 0)).max() < 20


def test_a_missing_video_extra_is_reported_before_drawing(
    z2p: Callable[..., Result], tiny_weights: Path, scans: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    result = z2p("animate", scans, "-o", tmp_path / "out", "--format", "mp4", "--weights", tiny_weights)
    assert result.exit_code == 2 and 'in a clone of z2p: pip install -c constraints.txt ".[video]"' in result.stderr
    assert not (tmp_path / "out").exists()


def test_animate_makes_loops_of_files_and_folders(
    z2p: Callable[..., Result], tiny_weights: Path, scans: Path, tmp_path: Path, cloud: np.ndarray
) -> None:
    (scans / "bad.ply").write_bytes(b"no")
    np.save(scans / "many.npy", np.stack([cloud, cloud]))
    words = ("animate", scans, "-o", tmp_path / "out", "--weights", tiny_weights, "--resolution", 32, "--frames", 3)
    result = z2p(*words)
    assert result.exit_code == 1
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["one.webp", "two.webp"]
    assert [line.split(":")[0] for line in result.stderr.splitlines()] == ["failed", "failed", "rendered", "rendered"]
    assert "holds 2 clouds" in result.stderr
    record = read_record(tmp_path / "out" / "one.webp")
    assert record["motion"] == {"kind": "turn", "frames": 3, "steady": 1, "fps": 24.0}
    assert "skipped" in z2p(*words).stderr
    again = z2p("rerender", tmp_path / "out" / "one.webp")
    assert again.exit_code == 2 and "is a loop; make it again with z2p animate" in again.stderr
    alone = z2p("animate", scans / "one.npy", "-o", tmp_path / "a.gif", "--weights", tiny_weights, "--resolution", 32,
                "--frames", 3, "--motion", "light", "--fit", "tight")  # fmt: skip
    assert alone.exit_code == 0 and "background is white" in alone.stderr
    assert Image.open(tmp_path / "a.gif").n_frames == 3
    seen = z2p("run-inference", scans / "one.npy", "-o", tmp_path / "b.png", "--weights", tiny_weights, "--resolution",
               32, "--load-camera", tmp_path / "a.gif")  # fmt: skip
    assert seen.exit_code == 0
    assert z2p("animate", scans, "-o", tmp_path / "a.gif", "--weights", tiny_weights).exit_code == 2
    webp = z2p("animate", scans / "one.npy", "-o", tmp_path / "b.webp", "--weights", tiny_weights, "--resolution", 32,
               "--frames", 2)  # fmt: skip
    assert webp.exit_code == 0 and Image.open(tmp_path / "b.webp").n_frames == 2
    still = z2p("animate", scans / "one.npy", "-o", tmp_path / "a.png", "--weights", tiny_weights)
    assert still.exit_code == 2 and "run-inference" in still.stderr and not (tmp_path / "a.png").exists()


def test_mp4_colours_are_bt_709_and_tagged_so(tmp_path: Path) -> None:
    ffmpeg = pytest.importorskip("imageio_ffmpeg").get_ffmpeg_exe()
    colors = [(255, 0, 0), (0, 255, 0), (0, 0, 255), (40, 120, 200), (255, 255, 255), (12, 12, 12)]
    frame = np.zeros((48, 16 * len(colors), 4), np.uint8)
    for index, color in enumerate(colors):
        frame[:, 16 * index : 16 * (index + 1)] = (*color, 255)
    path = tmp_path / "colours.mp4"
    write_animation([frame] * 3, path, 12)
    command = [ffmpeg, "-hide_banner", "-i", str(path)]
    output = subprocess.run(command, capture_output=True, text=True, check=False).stderr
    assert "yuv420p(tv, bt709" in output, output
    words = [ffmpeg, "-loglevel", "error", "-i", str(path), "-vf", "scale=in_color_matrix=bt709:in_range=tv", "-f",
             "rawvideo", "-pix_fmt", "rgb24", "-frames:v", "1", "-"]  # fmt: skip
    raw = subprocess.run(words, capture_output=True, check=True).stdout
    read = np.frombuffer(raw, np.uint8).reshape(48, -1, 3)
    for index, color in enumerate(colors):
        middle = read[24, 16 * index + 8].astype(int)
        assert np.abs(middle - color).max() <= 4, (color, middle)
