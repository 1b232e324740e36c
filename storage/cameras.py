"""Cameras on disk: a viewpoint as JSON, or out of a picture that z2p wrote."""

from __future__ import annotations

import json
from pathlib import Path

from storage.meshes import shown
from storage.pictures import FORMATS, PictureError, read_record
from storage.whole import write_whole
from z2p_core.interfaces import SettingError
from z2p_core.viewpoint import Viewpoint, viewpoint_from_json


def write_camera(viewpoint: Viewpoint, path: Path) -> None:
    """Write a viewpoint as a JSON file, whole or not at all."""
    write_whole((json.dumps(viewpoint.to_json(), indent=2) + "\n").encode(), path)


def read_camera(path: Path) -> Viewpoint:
    """The viewpoint of a JSON file that `write_camera` wrote, or the one that a picture was taken with.

    Raises:
        SettingError: no such file, no JSON, a picture without a record, or no camera in it.
    """
    try:
        picture = path.suffix.lower() in (*FORMATS, ".gif")
        data = read_record(path)["camera"] if picture else json.loads(path.read_text("utf-8"))
        return viewpoint_from_json(data)
    except OSError as error:
        raise SettingError(f"camera {shown(path)}: {error.strerror or error}; write one with --save-camera") from error
    except (KeyError, PictureError, SettingError) as error:
        raise SettingError(f"camera {shown(path)}: {str(error).removeprefix(f'{shown(path)}: ')}") from error
    except ValueError as error:  # neither UTF-8 nor JSON
        raise SettingError(f"camera {shown(path)}: not JSON ({error}); write one with --save-camera") from error
