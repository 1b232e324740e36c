"""Names that no file can have are refused as those of files that are not there, by everything that takes one."""

from pathlib import Path

import pytest

from z2p_core.config import ConfigError
from z2p_core.interfaces import ScanError, SettingError
from z2p_renderer.storage.cameras import read_camera
from z2p_renderer.storage.configs import read_config_text
from z2p_renderer.storage.files.printable_names import is_file, is_folder, path_exists
from z2p_renderer.storage.images.image_files import PictureError, read_record
from z2p_renderer.storage.meshes import find_meshes
from z2p_renderer.storage.models.checkpoints import WeightsError, find_weights, load_checkpoint, load_weights
from z2p_renderer.storage.scans.clouds import find_scans, read_clouds

IMPOSSIBLE = ["x" * 3000, "x" * 300 + "/y", "a\0b", "\ud800"]
TAKERS = {
    "a scan": (read_clouds, ScanError), "scans": (lambda path: find_scans([str(path)], False), ScanError),
    "meshes": (find_meshes, ScanError), "weights": (load_weights, WeightsError),
    "names of weights": (find_weights, WeightsError), "a camera": (read_camera, SettingError),
    "a record": (read_record, PictureError), "a config": (read_config_text, ConfigError),
}  # fmt: skip


@pytest.mark.parametrize("name", IMPOSSIBLE, ids=["long", "long folder", "zero byte", "half a pair"])
@pytest.mark.parametrize("taker", TAKERS)
def test_an_impossible_name_counts_as_missing(taker, name):
    take, error = TAKERS[taker]
    for suffix in ("", ".ply", ".laz", ".png", ".ply.gz"):
        with pytest.raises(error):
            take(Path(name + suffix))


@pytest.mark.parametrize("name", IMPOSSIBLE)
def test_missing_names_are_reported_as_missing(name):
    path = Path(name)
    assert not is_file(path) and not is_folder(path) and not path_exists(path) and load_checkpoint(path) is None


def test_existing_files_and_folders_are_detected(tmp_path):
    (tmp_path / "a").touch()
    assert is_file(tmp_path / "a") and not is_folder(tmp_path / "a") and path_exists(tmp_path / "a")
    assert is_folder(tmp_path) and not is_file(tmp_path) and path_exists(tmp_path) and not path_exists(tmp_path / "b")
