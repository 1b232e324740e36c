"""Series of figures: one camera, one frame, formats, palettes, contact sheets and the gallery."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from PIL import Image

from pipeline.cli.options.palettes import PALETTES, palette_colors
from z2p_renderer.pipeline.inference.trim import MIN_VISIBLE_ALPHA, crop_frame
from z2p_renderer.pipeline.outputs.contact_sheet import write_contact_sheets
from z2p_renderer.storage.cameras import read_camera
from z2p_renderer.storage.images.image_files import read_record


def pixels(path: Path) -> np.ndarray:
    return np.asarray(Image.open(path))


def test_a_saved_camera_gives_the_same_picture(render: Callable[..., Result], scans: Path, tmp_path: Path) -> None:
    camera = tmp_path / "cam.json"
    assert render(scans / "one.npy", "--azimuth", 33, "--elevation", 44, "--save-camera", camera).exit_code == 0
    first = tmp_path / "out" / "one.png"
    for name, source in {"json": camera, "picture": first}.items():
        result = render(scans / "one.npy", "--load-camera", source, output=tmp_path / name)
        assert result.exit_code == 0, result.output
        assert np.array_equal(pixels(tmp_path / name / "one.png"), pixels(first))
        assert "; seen from the given camera, elevation 44)" in result.stderr
    assert read_camera(camera).elevation == 44
    high = render(scans / "one.npy", "--load-camera", camera, "--elevation", 60, output=tmp_path / "high")
    assert high.exit_code == 0
    assert read_record(tmp_path / "high" / "one.png")["camera"]["elevation"] == 60
    skipped = render(scans / "one.npy", "--save-camera", tmp_path / "again.json")
    assert "skipped" in skipped.stderr
    assert (tmp_path / "again.json").read_bytes() == camera.read_bytes()


def test_impossible_cameras_are_refused(render: Callable[..., Result], scans: Path, tmp_path: Path) -> None:
    several = render(scans, "--save-camera", tmp_path / "cam.json")
    assert several.exit_code == 2 and "add --same-frame" in several.stderr
    (tmp_path / "bad.json").write_text("{}")
    for name in ("bad.json", "missing.json"):
        result = render(scans, "--load-camera", tmp_path / name)
        assert result.exit_code == 2 and name in result.stderr and "--save-camera" in result.stderr
    far = render(scans / "one.npy", "--load-camera", write_camera_far(tmp_path))
    assert far.exit_code == 1 and "beyond the camera's frame" in far.stderr


def write_camera_far(folder: Path) -> Path:
    from z2p_core.placement.viewpoint import frame_points
    from z2p_renderer.storage.cameras import write_camera

    write_camera(frame_points(np.eye(3) * 1e-3, np.eye(3), 20.0), folder / "far.json")
    return folder / "far.json"


def test_same_frame_gives_a_series_one_camera(render: Callable[..., Result], tmp_path: Path, cloud: np.ndarray) -> None:
    folder = tmp_path / "series"
    folder.mkdir()
    small = (cloud - cloud.mean(0)) / 3 + cloud.mean(0) + [2.0, 0, 0]
    np.save(folder / "a.npy", cloud)
    np.save(folder / "b.npy", small)
    (folder / "c.npy").write_bytes(b"garbage")
    result = render(folder, "--same-frame", "--save-camera", tmp_path / "cam.json")
    assert result.exit_code == 1
    assert result.stderr.startswith("one frame for 2 clouds: up +")
    assert result.stderr.count("c.npy") == 1
    records = [read_record(tmp_path / "out" / f"{name}.png") for name in "ab"]
    assert records[0]["camera"] == records[1]["camera"] == read_camera(tmp_path / "cam.json").to_json()
    viewpoint = read_camera(tmp_path / "cam.json")
    reach = [np.linalg.norm(viewpoint.place(points), axis=1).max() for points in (cloud, small)]
    assert max(reach) == pytest.approx(1.0, abs=0.01)
    lowest = min(viewpoint.place(points)[:, 2].min() for points in (cloud, small))
    assert viewpoint.floor == pytest.approx(lowest, abs=0.01)  # the smaller one hovers above it
    sizes = [np.ptp(viewpoint.place(points), axis=0) for points in (cloud, small)]
    np.testing.assert_allclose(sizes[1], sizes[0] / 3, rtol=1e-4)
    assert render(folder, "--same-frame", output=tmp_path / "again").exit_code == 1
    assert np.array_equal(pixels(tmp_path / "again" / "b.png"), pixels(tmp_path / "out" / "b.png"))


def test_a_series_has_one_crop(render: Callable[..., Result], tmp_path: Path, cloud: np.ndarray) -> None:
    """Every picture is the same part of its frame, which loses nothing of any of them."""
    folder = tmp_path / "series"
    folder.mkdir()
    np.save(folder / "a.npy", cloud)
    np.save(folder / "b.npy", np.stack([cloud / 3, cloud / 2]) + cloud.mean(0) / 2)
    (folder / "c.npy").write_bytes(b"garbage")
    look = ("--same-frame", "--resolution", "160,128", "--supersample", 2)
    render(folder, *look, weights="regular", output=tmp_path / "frame")
    result = render(folder, *look, "--fit", "tight", weights="regular", output=tmp_path / "tight")
    assert result.exit_code == 1 and result.stderr.count("c.npy") == 1
    names = ("a", "b_000", "b_001")
    window = read_record(tmp_path / "tight" / "a.png")["window"]
    for name in names:
        whole, part = (pixels(tmp_path / kind / f"{name}.png") for kind in ("frame", "tight"))
        shown = crop_frame(whole, window)
        assert np.array_equal(part, shown) and part.size < whole.size
        assert (part[..., 3] >= MIN_VISIBLE_ALPHA).sum() == (whole[..., 3] >= MIN_VISIBLE_ALPHA).sum()


@pytest.mark.slow
def test_rerender_keeps_the_crop_of_a_series_if_nothing_moves(
    render: Callable[..., Result], z2p: Callable[..., Result], scans: Path, tmp_path: Path
) -> None:
    result = render(scans, "--same-frame", "--fit", "tight", "--resolution", "64,48", weights="regular")
    assert result.exit_code == 0, result.output
    figure, again = tmp_path / "out" / "one.png", tmp_path / "out" / "again.png"
    for words, kept in (((), True), (("--color", "red"), True), (("--resolution", "128,96"), True),
                        (("--resolution", 64), False), (("--light", "3,0,60"), False), (("--elevation", 40), False),
                        (("--azimuth", 40), False), (("--fit", "tight"), False)):  # fmt: skip
        done = z2p("rerender", figure, "-o", again, "--overwrite", *words)
        assert done.exit_code == 0, done.output
        assert ("window" in read_record(again)) == kept
        assert bool(words) or again.read_bytes() == figure.read_bytes()


@pytest.mark.parametrize(("word", "suffix"), [("webp", ".webp"), ("jpeg", ".jpg"), ("tiff", ".tif"), ("png", ".png")])
def test_pictures_are_written_in_every_format(
    render: Callable[..., Result], scans: Path, tmp_path: Path, word: str, suffix: str
) -> None:
    result = render(scans, "--format", word)
    assert result.exit_code == 0
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [f"one{suffix}", f"two{suffix}"]
    assert ("the background is white" in result.stderr) == (word == "jpeg")
    assert read_record(tmp_path / "out" / f"one{suffix}")["input"]["name"] == "one.npy"
    alone = render(scans / "one.npy", output=tmp_path / f"mine{suffix}")
    assert alone.exit_code == 0 and Image.open(tmp_path / f"mine{suffix}").size == (32, 32)


def test_contradicting_formats_are_refused(render: Callable[..., Result], scans: Path, tmp_path: Path) -> None:
    result = render(scans / "one.npy", "--format", "webp", output=tmp_path / "a.png")
    assert result.exit_code == 2 and "does not fit" in result.stderr
    assert render(scans / "one.npy", "--format", "tiff", output=tmp_path / "a.tiff").exit_code == 0


@pytest.mark.parametrize(("name", "message"), [("a.bmp", ".png, .webp"), ("a.gif", "z2p animate"), ("a.EPS", ".tiff")])
def test_unsupported_picture_suffixes_are_refused(
    render: Callable[..., Result], scans: Path, tmp_path: Path, name: str, message: str
) -> None:
    result = render(scans / "one.npy", output=tmp_path / name)
    assert result.exit_code == 2 and message in " ".join(result.stderr.split())
    assert not (tmp_path / name).exists()


def test_palette_colours_are_used_in_turn(
    render: Callable[..., Result], scans: Path, tmp_path: Path, cloud: np.ndarray
) -> None:
    for name in PALETTES:
        assert len(set(palette_colors(name))) == len(PALETTES[name]) >= 5
        assert all(len(color) == 3 and all(0 <= channel <= 1 for channel in color) for color in palette_colors(name))
    np.save(scans / "zmany.npy", np.stack([cloud, cloud]))
    assert render(scans, "--palette", "okabe-ito").exit_code == 0
    names = ("one", "two", "zmany_000", "zmany_001")
    used = [tuple(read_record(tmp_path / "out" / f"{name}.png")["controls"]["color"]) for name in names]
    colors = palette_colors("okabe-ito")
    assert used == [colors[0], colors[1], colors[2], colors[3]]
    both = render(scans, "--palette", "greys", "--color", "red")
    assert both.exit_code == 2 and "leave one out" in both.stderr


def test_contact_sheets_have_the_given_grid(render: Callable[..., Result], scans: Path, tmp_path: Path) -> None:
    for number in range(5):
        (scans / f"more{number}.npy").write_bytes((scans / "one.npy").read_bytes())
    result = render(scans, "--sheet", "3x2")
    assert result.exit_code == 0
    assert f"wrote {tmp_path / 'out' / 'sheet.png'}" in result.stderr
    sheets = [Image.open(tmp_path / "out" / name) for name in ("sheet.png", "sheet_2.png")]
    assert sheets[0].size[0] == 3 * 104 + 8 and sheets[1].size[0] == 104 + 8  # 96 pixels for the names, and a gap
    assert render(scans, "--sheet", "4x4").exit_code == 0  # the pictures are there; the sheet is made all the same
    assert not (tmp_path / "out" / "sheet_2.png").exists()
    assert render(scans, "--sheet", "0x2").exit_code == 2


@pytest.mark.parametrize(("option", "name"), [(("--sheet", "1x1"), "sheet.png"), (("--sheet", "1x1"), "sheet_2.png"),
                                              (("--gallery",), "gallery.html")])  # fmt: skip
def test_sheets_and_galleries_replace_no_other_files(
    render: Callable[..., Result], scans: Path, tmp_path: Path, option: tuple[str, ...], name: str
) -> None:
    own = tmp_path / "out" / name
    own.parent.mkdir()
    own.write_bytes(b"mine")
    result = render(scans, *option, "--overwrite")
    assert result.exit_code == 2 and name in result.stderr and "rename" in result.stderr
    assert own.read_bytes() == b"mine" and len(list(own.parent.iterdir())) == 1  # said before anything was drawn
    own.unlink()
    assert render(scans, *option).exit_code == 0
    assert render(scans, *option).exit_code == 0  # its own, again


@pytest.mark.parametrize("name", ["sheet", "sheet_2"])
def test_a_scan_called_sheet_keeps_its_picture(
    render: Callable[..., Result], scans: Path, tmp_path: Path, name: str
) -> None:
    (scans / f"{name}.npy").write_bytes((scans / "one.npy").read_bytes())
    refused = render(scans, "--sheet", "2x1")
    assert refused.exit_code == 2 and f"{name}.npy too" in refused.stderr
    assert render(scans).exit_code == 0
    if name == "sheet_2":  # one sheet now: it must not take the scan's picture for a second one that is left over
        picture = tmp_path / "out" / f"{name}.png"
        before = picture.read_bytes()
        assert render(scans, "--sheet", "4x4").exit_code == 0
        assert picture.read_bytes() == before


def test_a_bad_cloud_does_not_change_the_common_frame(
    render: Callable[..., Result], scans: Path, tmp_path: Path
) -> None:
    np.save(scans / "few.npy", np.random.default_rng(0).normal(size=(4, 3)))
    result = render(scans, "--same-frame", "--cut-top", 60)
    assert result.exit_code == 1 and "failed: " in result.stderr and "few.npy" in result.stderr
    assert (tmp_path / "out" / "one.png").exists()


def test_contact_sheet_cells_fit_the_pictures_up_to_a_limit(tmp_path: Path) -> None:
    for side, cell in ((20, 96), (200, 200), (900, 320)):
        Image.new("RGBA", (side, side // 2), "red").save(tmp_path / f"{side}.png")
        write_contact_sheets([tmp_path / f"{side}.png"], tmp_path, 1, 1)
        page = pixels(tmp_path / "sheet.png").astype(int)
        assert page.shape[1] == cell + 16
        red = (page[..., 0] - page[..., 1] > 200).any(0).sum()
        assert red == min(side, cell)


class Page(HTMLParser):
    """What a browser would make of the page: tags, their attributes, and text outside scripts."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        if self.tags and self.tags[-1][0] not in ("script", "style"):
            self.text += data


def test_the_gallery_is_one_self_contained_page(
    render: Callable[..., Result], scans: Path, tmp_path: Path, cloud: np.ndarray
) -> None:
    evil = '<script>alert(1)</script> & "quotes" \'x\'.npy'.replace("/", "")
    np.save(scans / evil, cloud)
    result = render(scans, "--gallery", "--color", "teal")
    assert result.exit_code == 0, result.output
    text = (tmp_path / "out" / "gallery.html").read_text()
    page = Page(text)
    images = [attributes for tag, attributes in page.tags if tag == "img"]
    assert len(images) == 3
    assert all(str(image["src"]).startswith("data:image/webp;base64,") for image in images)
    assert [tag for tag, _ in page.tags].count("script") == 1  # ours
    assert evil.removesuffix(".npy") in [image["alt"] for image in images]
    links = [str(attributes["href"]) for tag, attributes in page.tags if tag == "a"]
    assert len(links) == 3 and all(re.fullmatch(r"[\w.%~-]+", link) for link in links)
    assert not re.search(r"""(src|href)=["']?(https?:)?//""", text)  # nothing from elsewhere
    assert "0, 0.502, 0.502" in page.text and "one.npy" in page.text


def test_the_gallery_includes_pictures_of_an_earlier_run(
    render: Callable[..., Result], scans: Path, tmp_path: Path
) -> None:
    assert render(scans).exit_code == 0
    result = render(scans, "--gallery", "--json")
    assert [json.loads(line)["status"] for line in result.stdout.splitlines()] == ["skipped", "skipped"]
    assert (tmp_path / "out" / "gallery.html").read_text().count("<figure ") == 2
