"""The viewer's server answers its own page only, and its pictures are those of the command that it copies."""

from __future__ import annotations

import http.client
import io
import json
import socket
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest
from PIL import Image

from z2p_core.interfaces import SettingError
from z2p_renderer.pipeline.cli.viewer.saving import Saver
from z2p_renderer.pipeline.cli.viewer.server import ViewServer
from z2p_renderer.pipeline.cli.viewer.viewed_scans import ViewedScans

MOVED = {"azimuth": 33.3, "controls": {"elevation": [30.0], "light": [3.6, 20.0, 40.0]}, "size": [96, 64],
         "background": "white", "margin": 0.05}  # fmt: skip


class Client:
    """Sends a page's requests."""

    def __init__(self, server: ViewServer) -> None:
        self.server, self.parts = server, urlsplit(server.address)

    def ask(self, place: str, body: Any = None, token: str = "", **headers: str) -> tuple[int, bytes, dict[str, str]]:
        connection = http.client.HTTPConnection(str(self.parts.hostname), self.parts.port or 0, timeout=60)
        path = f"/{token or self.server.token}/{place}"
        names = {name.replace("_", "-"): text for name, text in headers.items()}
        connection.request("GET" if body is None else "POST", path, None if body is None else json.dumps(body), names)
        answer = connection.getresponse()
        found = answer.status, answer.read(), dict(answer.getheaders())
        connection.close()
        return found

    def json(self, place: str, body: Any) -> Any:
        return json.loads(self.ask(place, body)[1])

    def picture(self, state: Any, number: int = 0, draft: bool = False, pane: int = 0) -> tuple[int, Any]:
        body = {"page": "a", "state": state, "number": number, "draft": draft, "pane": pane}
        status, content, _ = self.ask("picture", body)
        return status, np.asarray(Image.open(io.BytesIO(content))) if status == 200 else content


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder: Path = tmp_path_factory.mktemp("viewer")
    rng = np.random.default_rng(0)
    points = rng.normal(size=(600, 3))
    np.savez(folder / "ball.npz", points=points / np.linalg.norm(points, axis=1, keepdims=True), heat=points[:, 0])
    return folder


@pytest.fixture(scope="module")
def client(folder: Path) -> Iterator[Client]:
    scans = ViewedScans([folder / "ball.npz"])
    with ViewServer(scans, Saver(scans, folder / "pictures", []), port=0) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.05,))
        thread.start()
        yield Client(server)
        server.shutdown()
        thread.join(10)
        assert not thread.is_alive()


def test_the_page_is_served_and_loads_nothing_from_elsewhere(client: Client) -> None:
    status, content, headers = client.ask("")
    assert status == 200 and b"http://" not in content and b"https://" not in content
    assert "default-src 'none'" in headers["Content-Security-Policy"]


@pytest.mark.parametrize(
    "headers",
    [{"token": "wrong"}, {"Host": "example.org"}, {"Origin": "http://example.org"}],
    ids=lambda one: next(iter(one)),
)
def test_other_pages_are_refused(client: Client, headers: dict[str, str]) -> None:
    assert client.ask("recipe", {"state": {}}, **headers)[0] == 403


def test_every_control_has_its_slider(client: Client) -> None:
    described = client.json("description", {"state": {}})
    light = described["sliders"]["light"]
    assert light["components"] == ["radius", "azimuth", "elevation"] and light["low"] == [3.0, -90.0, 25.0]
    assert {"color", "metallic"} <= set(described["sliders"]) and described["fields"] == ["heat"]


def test_a_draft_resembles_the_full_picture_and_a_full_one_has_its_size(client: Client) -> None:
    (status, draft), (_, full) = client.picture(MOVED, 1, draft=True), client.picture(MOVED, 2)
    assert status == 200 and full.shape[:2] == (64, 96)
    assert np.abs(draft[..., :3].astype(float) - full[..., :3]).mean() < 4


def test_a_picture_that_a_page_no_longer_wants_is_not_drawn(client: Client) -> None:
    assert client.picture(MOVED, 9)[0] == 200
    assert client.picture(MOVED, 8)[0] == 204


@pytest.mark.parametrize(
    "state",
    [{"azimuth": "x"}, {"controls": {"light": [9, 9, 9]}}, {"background": "nonsense"}, {"controls": {"mass": [1]}},
     {"size": [9, 9]}, {"color_by": "--output"}, {"colormap": "none such", "color_by": "heat"}, []],
    ids=str,
)  # fmt: skip
def test_bad_settings_get_one_line(client: Client, state: Any) -> None:
    status, content = client.picture(state, 20)
    assert status == 400 and len(json.loads(content)["error"].splitlines()) == 1


@pytest.mark.slow
def test_a_saved_picture_is_what_the_copied_command_and_call_make(client: Client, folder: Path) -> None:
    import shlex

    from click.testing import CliRunner

    from z2p_renderer.pipeline.cli import main

    (saved,) = client.json("save", {"state": MOVED})["paths"]
    content = Path(saved).read_bytes()
    Path(saved).unlink()
    recipe = client.json("recipe", {"state": MOVED})
    done = CliRunner().invoke(main, shlex.split(recipe["command"])[1:])
    assert done.exit_code == 0, done.output
    assert Path(saved).read_bytes() == content
    shown = client.picture(MOVED, 30)[1]
    assert np.array_equal(np.asarray(Image.open(saved)), shown)
    exec(recipe["call"], {})
    assert np.array_equal(np.asarray(Image.open(saved).convert("RGB")), shown[..., :3])


def test_a_saved_camera_can_be_loaded(client: Client) -> None:
    from z2p_renderer.storage.cameras import read_camera

    (path,) = client.json("camera", {"state": MOVED})["paths"]
    assert read_camera(Path(path)).elevation == 30.0


def test_a_port_in_use_is_said(client: Client) -> None:
    scans = client.server.scans
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with pytest.raises(SettingError, match="is in use"):
            ViewServer(scans, client.server.saver, port=taken.getsockname()[1])


def test_it_ends_when_its_last_page_is_closed(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("z2p_renderer.pipeline.cli.viewer.server.CLOSING_SECONDS", 0.05)
    with ViewServer(client.server.scans, client.server.saver, port=0) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.02,))
        thread.start()
        page = Client(server)
        for place, name in (("open", "a"), ("open", "b"), ("bye", "a")):
            page.ask(place, {"page": name})
        thread.join(0.3)
        assert thread.is_alive()
        page.ask("bye", {"page": "b"})
        thread.join(10)
        assert not thread.is_alive()
