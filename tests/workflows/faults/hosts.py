"""Hosts in network namespaces on one bridge: real interfaces that can be cut, on one machine. Needs root on Linux."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager

NETWORK = "10.213.77"


class Hosts:
    """A bridge at ``NETWORK.1`` and hosts 1, 2, ... at ``NETWORK.11``, ``.12``, ..."""

    address = f"{NETWORK}.1"

    def __init__(self, count: int) -> None:
        self.tag = f"z2p{os.getpid() % 10000}"
        self.count = count

    def build(self) -> None:
        """
        Raises:
            subprocess.CalledProcessError: namespaces are not allowed here.
        """
        _ip("link", "add", self.tag, "type", "bridge")
        _ip("addr", "add", f"{self.address}/24", "dev", self.tag)
        _ip("link", "set", self.tag, "up")
        for number in range(1, self.count + 1):
            space, outer, inner = self._names(number)
            _ip("netns", "add", space)
            _ip("link", "add", outer, "type", "veth", "peer", "name", inner)
            _ip("link", "set", outer, "master", self.tag, "up")
            _ip("link", "set", inner, "netns", space)
            _ip("-n", space, "addr", "add", f"{NETWORK}.{10 + number}/24", "dev", inner)
            _ip("-n", space, "link", "set", inner, "up")
            _ip("-n", space, "link", "set", "lo", "up")

    def command(self, number: int, words: list[str]) -> list[str]:
        """The words as run on a host."""
        return ["ip", "netns", "exec", self._names(number)[0], *words]

    def cut(self, number: int) -> None:
        """Take a host off the network, as when its cable is pulled."""
        _ip("link", "set", self._names(number)[1], "down")

    def remove(self) -> None:
        for number in range(1, self.count + 1):
            _ip("netns", "del", self._names(number)[0], check=False)
            _ip("link", "del", self._names(number)[1], check=False)
        _ip("link", "del", self.tag, check=False)

    def _names(self, number: int) -> tuple[str, str, str]:
        return f"{self.tag}-{number}", f"{self.tag}o{number}", f"{self.tag}i{number}"


@contextmanager
def hosts(count: int) -> Iterator[Hosts | None]:
    """Hosts on a network of their own; None where namespaces are not allowed."""
    found = Hosts(count)
    try:
        try:
            found.build()
        except (OSError, subprocess.CalledProcessError):
            yield None
        else:
            yield found
    finally:
        found.remove()


def _ip(*words: str, check: bool = True) -> None:
    try:
        subprocess.run(["ip", *words], check=check, capture_output=True)
    except FileNotFoundError:
        if check:
            raise
