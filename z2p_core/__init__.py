"""Pure heart of z2p: camera, interfaces, network, losses, metrics. Touches no file, imports no luigi, h5py or bpy.

>>> import z2p_core
>>> picture = z2p_core.render(points, color="teal")  # doctest: +SKIP
>>> picture.save("points.png")  # doctest: +SKIP
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from z2p_core.api.animate import animate as animate
    from z2p_core.api.picture import Picture as Picture
    from z2p_core.api.previewer import Previewer as Previewer
    from z2p_core.api.read_cameras import read_cameras as read_cameras
    from z2p_core.api.render import RenderWarning as RenderWarning
    from z2p_core.api.render import render as render
    from z2p_core.api.view import view as view
    from z2p_core.interfaces import ScanError as ScanError
    from z2p_core.interfaces import SettingError as SettingError
    from z2p_core.pinhole import PinholeCamera as PinholeCamera
    from z2p_core.pinhole import look_at as look_at
    from z2p_core.pinhole import pinhole_camera as pinhole_camera

__version__ = "0.1.0"

_LATE = {
    "render": "z2p_core.api.render", "view": "z2p_core.api.view", "animate": "z2p_core.api.animate",
    "Picture": "z2p_core.api.picture", "Previewer": "z2p_core.api.previewer",
    "RenderWarning": "z2p_core.api.render", "ScanError": "z2p_core.interfaces", "SettingError": "z2p_core.interfaces",
    "PinholeCamera": "z2p_core.pinhole", "look_at": "z2p_core.pinhole", "pinhole_camera": "z2p_core.pinhole",
    "read_cameras": "z2p_core.api.read_cameras",
}  # fmt: skip
"""Public name -> module; imported when first used, so that `z2p --help` waits for none of it."""


def __getattr__(name: str) -> Any:
    if name in _LATE:
        return getattr(import_module(_LATE[name]), name)
    raise AttributeError(f"module 'z2p_core' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *_LATE])
