"""A small web server for one viewer: the page, its pictures, and what its buttons do; nothing from elsewhere.

Only who knows the token in the address is answered. Requests for another host, or from the page of another site, are
refused, so that no page that the user visits can drive the viewer.
"""

from __future__ import annotations

import errno
import hmac
import json
import secrets
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import asdict
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from typing import Any

import numpy as np

from z2p_core.errors.messages import UserError
from z2p_core.interfaces import SettingError
from z2p_renderer.pipeline.cli.viewer.saving import Saver
from z2p_renderer.pipeline.cli.viewer.view_state import state_from_json
from z2p_renderer.pipeline.cli.viewer.viewed_scans import DRAFT_SIDES, View, ViewedScans, check_pane
from z2p_renderer.storage.images.image_files import encode_picture

DEFAULT_PORT = 8731
LOOPBACK = "127.0.0.1"
MAX_BODY_BYTES = 1 << 16
"""A page's requests are smaller."""
SOCKET_SECONDS = 30
"""Time after which a connection that sends nothing is closed."""
CLOSING_SECONDS = 4.0
"""How long the server waits, once the last page has been closed, for one that is only loaded again."""
TOKEN_BYTES = 16
COLORMAPS = ("viridis", "turbo", "batlow", "cividis", "inferno", "magma", "plasma", "coolwarm", "RdBu", "gray")
"""Colormaps that the page proposes; any other can be typed."""


class ViewServer(ThreadingHTTPServer):
    """Serves one viewer until its last page is closed, or `stop` is called."""

    daemon_threads = True
    allow_reuse_address = True

    def __init__(
        self, scans: ViewedScans, saver: Saver, host: str = LOOPBACK, port: int | None = None,
        ends_with_page: bool = True, first_up: str = "auto", first_color_by: str = "auto",
    ) -> None:  # fmt: skip
        """Open the port; None takes `DEFAULT_PORT`, or a free one if that is in use.

        Raises:
            SettingError: the port is in use, or the host is none of this machine's.
        """
        self.scans, self.saver, self.token = scans, saver, secrets.token_urlsafe(TOKEN_BYTES)
        self.ends_with_page, self.first_up, self.first_color_by = ends_with_page, first_up, first_color_by
        self._newest: dict[tuple[str, int], int] = {}
        self._pages: set[str] = set()
        self._pages_lock = threading.Lock()
        self._last_closed = 0.0
        self.host = host
        self.is_default_port_taken = False
        if ":" in host:
            self.address_family = socket.AF_INET6
        try:
            self._open(host, DEFAULT_PORT if port is None else port, is_given=port is not None)
        except (OSError, OverflowError) as error:
            raise SettingError(_port_message(error, host, port)) from error

    def _open(self, host: str, port: int, is_given: bool) -> None:
        try:
            super().__init__((host, port), _Handler)
        except OSError as error:
            if is_given or error.errno not in (errno.EADDRINUSE, errno.EACCES):
                raise
            self.is_default_port_taken = True
            super().__init__((host, 0), _Handler)

    def server_bind(self) -> None:
        """Bind without the lookup of the host's name, which takes seconds where there is no name server."""
        import socketserver

        socketserver.TCPServer.server_bind(self)
        self.server_name, self.server_port = self.host, self.server_address[1]

    @property
    def address(self) -> str:
        """Where a browser finds the page."""
        host = self.host if self.host not in ("0.0.0.0", "::") else socket.gethostname()
        return f"http://{f'[{host}]' if ':' in host else host}:{self.server_port}/{self.token}/"

    @property
    def is_on_loopback(self) -> bool:
        """Whether only this machine can reach the server."""
        return self.host in ("localhost", "::1") or self.host.startswith("127.")

    def stop(self) -> None:
        """End `serve_forever` from any thread, and close the port."""
        threading.Thread(target=self.shutdown, daemon=True).start()

    def service_actions(self) -> None:
        """End once the last page has been closed for a while; called twice a second."""
        with self._pages_lock:
            is_over = self._last_closed and not self._pages
            if self.ends_with_page and is_over and time.monotonic() - self._last_closed > CLOSING_SECONDS:
                self._last_closed = 0.0
                self.stop()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Says nothing of connections that a browser has given up; anything else is shown, as by default."""
        import sys

        if not isinstance(
            sys.exception() if hasattr(sys, "exception") else sys.exc_info()[1], ConnectionError | TimeoutError
        ):
            super().handle_error(request, client_address)

    def count_page(self, page: str, is_open: bool) -> None:
        """Note that a page is open, or has been closed."""
        with self._pages_lock:
            if is_open:
                self._pages.add(page)
            elif page in self._pages:
                self._pages.discard(page)
                self._last_closed = time.monotonic()

    def is_stale(self, page: str, pane: int, number: int) -> bool:
        """Whether a page has asked for a newer picture of the pane; if not, this is the newest from now on."""
        with self._pages_lock:
            newest = self._newest.get((page, pane), -1)
            self._newest[page, pane] = max(newest, number)
            return number < newest

    def describe(self, weights: str) -> dict[str, Any]:
        """What the page builds its panels from."""
        from z2p_renderer.storage.models.checkpoints import shipped_weights

        return {
            "panes": [pane.label for pane in self.scans.panes], "faults": self.scans.faults,
            "sliders": {name: asdict(slider) for name, slider in self.scans.sliders(weights).items()},
            "fields": self.scans.fields, "up": self.first_up, "color_by": self.first_color_by,
            "colormaps": COLORMAPS,
            "weights": ["auto", *shipped_weights()], "draft_sides": DRAFT_SIDES,
        }  # fmt: skip


def _port_message(error: Exception, host: str, port: int | None) -> str:
    """Why a port could not be opened, in one line."""
    number = DEFAULT_PORT if port is None else port
    if isinstance(error, OSError) and error.errno == errno.EADDRINUSE:
        return f"--port {number} is in use, by another z2p view perhaps; leave --port out, and a free one is taken"
    if isinstance(error, OSError) and error.errno == errno.EACCES:
        return f"--port {number} may not be opened; choose one above 1023, or leave --port out"
    return f"cannot listen on --host {host} --port {number}: {getattr(error, 'strerror', None) or error}"


class _Handler(BaseHTTPRequestHandler):
    """Answers one connection."""

    server: ViewServer
    protocol_version = "HTTP/1.1"
    timeout = SOCKET_SECONDS
    server_version, sys_version = "z2p", ""

    def do_GET(self) -> None:
        """The page and its description."""
        if not (place := self._place()):
            return
        if place == "/":
            page = files("z2p_renderer.pipeline").joinpath("templates/viewer.html").read_text(encoding="utf-8")
            nonce = secrets.token_urlsafe(TOKEN_BYTES)
            policy = (f"default-src 'none'; script-src 'nonce-{nonce}'; style-src 'unsafe-inline'; "
                      "img-src blob: data:; connect-src 'self'; base-uri 'none'; form-action 'none'")  # fmt: skip
            self._answer(page.replace("NONCE", nonce).encode(), "text/html; charset=utf-8",
                         {"Content-Security-Policy": policy})  # fmt: skip
        else:
            self._refuse(HTTPStatus.NOT_FOUND, "there is no such place")

    def do_POST(self) -> None:
        """Pictures, and what buttons do."""
        place = self._place()
        actions: dict[str, Callable[[dict[str, Any]], None]] = {
            "/description": self._describe, "/picture": self._picture, "/recipe": self._recipe, "/save": self._save,
            "/camera": self._camera, "/open": self._open, "/bye": self._bye,
        }  # fmt: skip
        if place and place not in actions:
            self._refuse(HTTPStatus.NOT_FOUND, "there is no such place")
        elif place and (body := self._body()) is not None:
            try:
                actions[place](body)
            except (UserError, OSError, MemoryError) as error:
                if isinstance(error, ConnectionError | TimeoutError):
                    raise
                self._refuse(HTTPStatus.BAD_REQUEST, " ".join(str(error).split()))

    def log_message(self, format: str, *args: Any) -> None:
        """Nothing: the terminal is for what the user must know."""

    def _place(self) -> str:
        """The path behind the token; empty if the request is refused."""
        path = self.path.partition("?")[0]
        _, token, place = [*path.split("/", 2), "", ""][:3]
        if not hmac.compare_digest(token.encode(), self.server.token.encode()):
            self._refuse(HTTPStatus.FORBIDDEN, "wrong address: open the one that z2p view printed")
        elif not self._is_own_host():
            self._refuse(HTTPStatus.FORBIDDEN, "requests from other sites are refused")
        else:
            return f"/{place}"
        return ""

    def _is_own_host(self) -> bool:
        """Whether the request names this server, and comes from its own page if it says where it comes from."""
        host, origin = self.headers.get("Host", ""), self.headers.get("Origin")
        name = host.rpartition(":")[0] if host.rpartition(":")[2].isdigit() else host
        known = {"localhost", "127.0.0.1", "[::1]", self.server.host}
        if self.server.is_on_loopback and name not in known:
            return False
        return origin is None or origin == f"http://{host}"

    def _body(self) -> dict[str, Any] | None:
        """The JSON object that was sent; None if it is refused."""
        try:
            length = int(self.headers.get("Content-Length", ""))
        except ValueError:
            length = -1
        if not 0 <= length <= MAX_BODY_BYTES:
            self._refuse(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"expected at most {MAX_BODY_BYTES} bytes")
            return None
        try:
            data = json.loads(self.rfile.read(length) or b"{}")
        except (ValueError, RecursionError):
            data = None
        if not isinstance(data, dict):
            self._refuse(HTTPStatus.BAD_REQUEST, "expected a JSON object")
            return None
        return data

    def _describe(self, body: dict[str, Any]) -> None:
        self._answer_json(self.server.describe(state_from_json(body.get("state", {})).weights))

    def _picture(self, body: dict[str, Any]) -> None:
        scans, state = self.server.scans, state_from_json(body.get("state"))
        pane, number = check_pane(scans.panes, body.get("pane")), body.get("number")
        page, index = str(body.get("page"))[:64], int(body["pane"])
        if type(number) is not int:
            raise SettingError("expected the picture's number")
        is_draft = body.get("draft") is True
        side = body["side"] if body.get("side") in DRAFT_SIDES else DRAFT_SIDES[0]
        self.server.is_stale(page, index, number)
        with scans.turn(is_draft):
            if self.server.is_stale(page, index, number):  # a newer one has been asked for while others were drawn
                self._answer(b"", "text/plain", status=HTTPStatus.NO_CONTENT)
                return
            view = scans.draft(pane, state, side) if is_draft else scans.full(pane, state)
        self._answer(
            encode_view(view, is_draft),
            "image/png",
            {"X-View": json.dumps({"azimuth": view.azimuth, "elevation": view.elevation, "note": view.note})},
        )

    def _recipe(self, body: dict[str, Any]) -> None:
        recipe = self.server.saver.recipe(state_from_json(body.get("state")))
        self._answer_json({"command": recipe.command, "call": recipe.call})

    def _save(self, body: dict[str, Any]) -> None:
        paths = self.server.saver.save_pictures(state_from_json(body.get("state")))
        self._answer_json({"paths": [str(path) for path in paths]})

    def _camera(self, body: dict[str, Any]) -> None:
        paths = self.server.saver.save_cameras(state_from_json(body.get("state")))
        self._answer_json({"paths": [str(path) for path in paths]})

    def _open(self, body: dict[str, Any]) -> None:
        self.server.count_page(str(body.get("page"))[:64], is_open=True)
        self._answer_json({"ends": self.server.ends_with_page})

    def _bye(self, body: dict[str, Any]) -> None:
        self.server.count_page(str(body.get("page"))[:64], is_open=False)
        self._answer_json({})

    def _answer_json(self, data: Any) -> None:
        self._answer(json.dumps(data).encode(), "application/json")

    def _refuse(self, status: HTTPStatus, message: str) -> None:
        self.close_connection = True  # the body may not have been read
        self._answer(json.dumps({"error": message}).encode(), "application/json", status=status)

    def _answer(
        self, content: bytes, kind: str, headers: dict[str, str] | None = None, status: HTTPStatus = HTTPStatus.OK
    ) -> None:  # fmt: skip
        self.send_response(status)
        closing = {"Connection": "close"} if self.close_connection else {}
        fixed = {"Content-Type": kind, "Content-Length": str(len(content)), "Cache-Control": "no-store",
                 "X-Content-Type-Options": "nosniff", "Referrer-Policy": "no-referrer"}  # fmt: skip
        for name, text in {**fixed, **closing, **(headers or {})}.items():
            self.send_header(name, text)
        self.end_headers()
        self.wfile.write(content)


def encode_view(view: View, is_draft: bool) -> bytes:
    """The PNG that the page shows; a full picture's pixels are those of the saved file."""
    if not is_draft:
        return encode_picture(view.image, ".png", view.background)
    import io

    from PIL import Image

    image = view.image
    if view.background is not None:
        from z2p_core.api.picture import opaque_over

        image = opaque_over(image, view.background)
    encoded = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(image)).save(encoded, "PNG", compress_level=1)
    return encoded.getvalue()
