"""A page in headless Chromium, driven over its debugging protocol with the standard library alone."""

from __future__ import annotations

import base64
import json
import os
import shutil
import socket
import struct
import subprocess
import time
import urllib.request
from pathlib import Path
from typing import Any

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
"""The browser's program; None where there is none."""


class Page:
    """One page, opened at an address."""

    def __init__(self, address: str, profile: Path) -> None:
        assert CHROMIUM is not None
        words = ["--headless", "--no-sandbox", "--disable-gpu", "--remote-debugging-port=0", "--window-size=1200,760"]
        self.process = subprocess.Popen([CHROMIUM, *words, f"--user-data-dir={profile}", "about:blank"],
                                        stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)  # fmt: skip
        assert self.process.stderr is not None
        line = next(line for line in self.process.stderr if "DevTools listening" in line)
        port = int(line.split("127.0.0.1:")[1].split("/")[0])
        pages = json.load(urllib.request.urlopen(f"http://127.0.0.1:{port}/json", timeout=30))
        url = next(one["webSocketDebuggerUrl"] for one in pages if one["type"] == "page")
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=60)
        key = base64.b64encode(os.urandom(16)).decode()
        self._socket.sendall((f"GET {url.split(f':{port}')[1]} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n"
                              "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
                              f"Sec-WebSocket-Key: {key}\r\n\r\n").encode())  # fmt: skip
        head = b""
        while b"\r\n\r\n" not in head:
            head += self._read(1)
        self._number = 0
        self.send("Page.navigate", url=address)

    def send(self, method: str, **params: Any) -> Any:
        """The result of a command of the protocol."""
        self._number += 1
        data = json.dumps({"id": self._number, "method": method, "params": params}).encode()
        length = bytes([128 | len(data)]) if len(data) < 126 else bytes([254]) + struct.pack(">H", len(data))
        self._socket.sendall(bytes([129]) + length + bytes(4) + data)  # a mask of zeros
        while (answer := self._message()).get("id") != self._number:
            pass
        assert "error" not in answer, answer
        return answer["result"]

    def run(self, script: str) -> Any:
        """The JSON-able value of JavaScript."""
        answer = self.send("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def wait(self, condition: str, seconds: float = 60) -> None:
        """Return once the condition, in JavaScript, is true."""
        end = time.monotonic() + seconds
        while not self.run(f"Boolean({condition})"):
            assert time.monotonic() < end, condition
            time.sleep(0.05)

    def drag(self, x: float, y: float, right: int, down: int) -> None:
        """Press the mouse at a place, move it in ten steps, and release it."""
        for kind, step in (
            ("mousePressed", 0),
            *(("mouseMoved", step) for step in range(1, 11)),
            ("mouseReleased", 10),
        ):
            self.send("Input.dispatchMouseEvent", type=kind, x=x + right * step / 10, y=y + down * step / 10,
                      button="left", buttons=0 if kind == "mouseReleased" else 1, clickCount=1)  # fmt: skip

    def close(self) -> None:
        """End the browser."""
        self._socket.close()
        self.process.terminate()
        self.process.wait(30)

    def _message(self) -> Any:
        data, is_last = b"", False
        while not is_last:
            head = self._read(2)
            length, is_last = head[1] & 127, bool(head[0] & 128)
            if length > 125:
                length = int.from_bytes(self._read(2 if length == 126 else 8))
            data += self._read(length)
        return json.loads(data)

    def _read(self, count: int) -> bytes:
        data = b""
        while len(data) < count:
            part = self._socket.recv(count - len(data))
            assert part, "the browser closed the connection"
            data += part
        return data
