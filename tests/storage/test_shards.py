"""Shards: what goes in comes out; damage of any kind is told, never read."""

import json
import os

import h5py
import numpy as np
import pytest

from z2p_core.scene import SceneDescription
from z2p_renderer.storage.shards import Record, Shard, ShardError, write_shard

CONTROLS = [{"name": "color", "version": "1", "size": 3}, {"name": "elevation", "version": "1", "size": 1}]
ATTRIBUTES = {"mesh": "blob", "controls": CONTROLS, "resolution": 16}
NAMES = ("rgba", "coverage", "settings", "mirrored_settings", "scene")


def records_of(count, side=16, seed=0):
    rng = np.random.default_rng(seed)
    return [
        Record(
            rng.integers(0, 256, (side, side, 4), dtype=np.uint8),
            rng.integers(0, 256, (side, side), dtype=np.uint8),
            rng.random(4, dtype=np.float32),
            rng.random(4, dtype=np.float32),
            SceneDescription(
                elevation=rng.uniform(0, 80), light=tuple(rng.uniform(1, 4, 3).tolist()), lift=rng.uniform(0, 0.4),
                material={"Base Color": (0.1, 0.2, 0.3, 1.0)}, rotation=tuple(map(tuple, rng.random((3, 3)).tolist())),
            ),
        )
        for _ in range(count)
    ]


POOL = np.random.default_rng(1).random((100, 3), dtype=np.float32)


@pytest.fixture
def shard(tmp_path):
    path = tmp_path / "blob.h5"
    write_shard(path, records_of(5), POOL, ATTRIBUTES)
    return path


def read_all(path):
    opened = Shard(path)
    try:
        return [opened.read(row) for row in range(len(opened))], opened.pool, opened.elevations, opened.attributes
    finally:
        opened.close()


def assert_whole(contents):
    records, pool, elevations, attributes = contents
    assert len(records) == 5
    for record, expected in zip(records, records_of(5), strict=True):
        for name in NAMES:
            np.testing.assert_array_equal(getattr(record, name), getattr(expected, name))
    np.testing.assert_array_equal(pool, POOL)
    np.testing.assert_array_equal(elevations, [record.scene.elevation for record in records])
    assert attributes == {**ATTRIBUTES, "schema": 3}


def test_what_goes_in_comes_out(shard):
    assert_whole(read_all(shard))
    with pytest.raises(IndexError):
        Shard(shard).read(5)


def test_equal_records_give_equal_bytes_and_no_other_files(shard, tmp_path):
    first = shard.read_bytes()
    digests = {write_shard(shard, records_of(5), POOL, ATTRIBUTES) for _ in range(2)}
    assert len(digests) == 1 and shard.read_bytes() == first
    assert [path.name for path in tmp_path.iterdir()] == ["blob.h5"]


def test_a_failed_write_leaves_no_file(tmp_path):
    def failing():
        yield from records_of(2)
        raise OSError("the disk is full")

    for records in (failing(), [], records_of(2, side=8)):
        with pytest.raises((OSError, ShardError)):
            write_shard(tmp_path / "new.h5", records, POOL, ATTRIBUTES)
    assert not list(tmp_path.iterdir())


def test_a_scene_that_does_not_fit_is_refused(tmp_path):
    (record,) = records_of(1)
    record.scene.material = {f"Input {number}": 0.5 for number in range(100)}
    with pytest.raises(ShardError, match="scene: expected at most 1024 bytes"):
        write_shard(tmp_path / "new.h5", [record], POOL, ATTRIBUTES)


def test_truncated_anywhere(shard):
    whole = shard.read_bytes()
    for share in (0.0, 0.1, 0.5, 0.9, 0.999):
        shard.write_bytes(whole[: int(len(whole) * share)])
        with pytest.raises(ShardError, match=r"blob\.h5"):
            read_all(shard)


@pytest.mark.slow
def test_a_flipped_bit_anywhere_is_told_or_harmless(shard):
    whole = shard.read_bytes()
    rng, told = np.random.default_rng(0), 0
    for place in rng.integers(0, len(whole), 150):
        flipped = bytearray(whole)
        flipped[place] ^= 1 << int(rng.integers(8))
        shard.write_bytes(flipped)
        try:
            assert_whole(read_all(shard))
        except ShardError:
            told += 1
    assert told > 75


def test_a_flipped_bit_in_a_picture(shard):
    with h5py.File(shard) as file:
        place = file["rgba"].id.get_chunk_info(3).byte_offset + 20
    flipped = bytearray(shard.read_bytes())
    flipped[place] ^= 1
    shard.write_bytes(flipped)
    opened = Shard(shard)
    opened.read(2)
    with pytest.raises(ShardError, match="damaged"):
        opened.read(3)


def rewrite(path, name, make):
    """The shard with data set `name` replaced by what `make(file)` makes."""
    with h5py.File(path, "r+", libver="latest") as file:
        del file[name]
        make(file)


def test_external_virtual_linked_and_unwritten_data_are_refused(shard, tmp_path):
    (tmp_path / "raw").write_bytes(bytes(80))
    whole = shard.read_bytes()
    layout = h5py.VirtualLayout((5, 4), np.float32)
    layout[:] = h5py.VirtualSource("other.h5", "settings", (5, 4), np.float32)
    cases = {
        "external": lambda file: file.create_dataset("settings", (5, 4), "f4", external=[("raw", 0, 80)]),
        "virtual": lambda file: file.create_virtual_dataset("settings", layout),
        "soft link": lambda file: file.__setitem__("settings", h5py.SoftLink("/coverage")),
        "external link": lambda file: file.__setitem__("settings", h5py.ExternalLink("other.h5", "/settings")),
        "unwritten": lambda file: file.create_dataset("settings", (5, 4), "f4", chunks=(1, 4)),
        "other type": lambda file: file.create_dataset("settings", data=np.zeros((5, 4)), chunks=(1, 4)),
        "missing": lambda file: None,
    }
    for name, make in cases.items():
        shard.write_bytes(whole)
        rewrite(shard, "settings", make)
        with pytest.raises(ShardError):
            Shard(shard)
            pytest.fail(name)


def test_sizes_larger_than_the_file_are_refused_unread(shard):
    rewrite(shard, "pool", lambda file: file.create_dataset("pool", (2**33, 3), "f4", chunks=(2**20, 3)))
    with pytest.raises(ShardError, match="declares"):
        Shard(shard)


def test_not_a_shard_missing_and_other_schema(shard, tmp_path):
    (tmp_path / "text.h5").write_text("hello")
    with pytest.raises(ShardError, match="not a shard"):
        Shard(tmp_path / "text.h5")
    with pytest.raises(ShardError, match="no such shard"):
        Shard(tmp_path / "absent.h5")
    write_shard(shard, records_of(1), POOL, {**ATTRIBUTES, "schema": 99})
    with pytest.raises(ShardError, match="expected schema 3, got 99"):
        Shard(shard)


def test_a_forked_child_opens_its_own_file(shard):
    opened = Shard(shard)
    opened.read(0)
    child = os.fork()
    if child == 0:
        try:
            good = np.array_equal(opened.read(1).rgba, records_of(5)[1].rgba)
        finally:
            os._exit(0 if good else 1)
    assert os.waitpid(child, 0)[1] == 0
    np.testing.assert_array_equal(opened.read(1).rgba, records_of(5)[1].rgba)


@pytest.mark.parametrize("key, value", [
    ("controls", 3), ("controls", [3]), ("controls", [{"name": "a", "version": "1"}]), ("resolution", "16"),
    ("resolution", 10**30), ("resolution", True), ("mesh", None), ("mesh", ["blob"]), ("schema", 3.5), ("schema", None),
])  # fmt: skip
def test_attributes_of_another_kind_are_damage(shard, key, value):
    with h5py.File(shard, "r+") as file:
        file.attrs["z2p"] = np.bytes_(json.dumps({**ATTRIBUTES, "schema": 3, key: value}))
    with pytest.raises(ShardError, match=f"{key}.*expected"):
        Shard(shard)


@pytest.mark.parametrize("text", [b"", b"[]", b"3", b"[" * 50_000, b"9" * 5000, b"\xff"])
def test_attributes_that_are_no_object_are_damage(shard, text):
    with h5py.File(shard, "r+") as file:
        file.attrs["z2p"] = np.bytes_(text or b" ")
    with pytest.raises(ShardError):
        Shard(shard)


@pytest.mark.parametrize("key, value", [
    ("material", []), ("material", {"Metallic": "1"}), ("light", [1, 2]), ("rotation", [[1, 0, 0]] * 2), ("lift", None),
    ("elevation", float("nan")), ("floor", "low"),
])  # fmt: skip
def test_a_scene_that_cannot_be_is_damage(shard, key, value):
    scene = {**records_of(1)[0].scene.to_json(), key: value}
    with h5py.File(shard, "r+") as file:
        file["scene"][0] = np.bytes_(json.dumps(scene))
    with pytest.raises(ShardError, match=rf"scene\.{key}"):
        Shard(shard).read(0)
    with pytest.raises(ShardError, match=rf"scene\.{key}"):
        _ = Shard(shard).elevations


@pytest.mark.parametrize("name", ["settings", "mirrored_settings", "pool"])
def test_numbers_that_are_not_finite_are_damage(shard, name):
    with h5py.File(shard, "r+") as file:
        file[name][0] = np.nan
    with pytest.raises(ShardError, match=f"{name} holds numbers that are not finite"):
        _ = Shard(shard).pool if name == "pool" else Shard(shard).read(0)


@pytest.mark.parametrize("name", ["rgba", "pool", "scene"])
def test_a_single_number_in_place_of_a_data_set_is_damage(shard, name):
    with h5py.File(shard, "r+") as file:
        del file[name]
        file[name] = 3.0
    with pytest.raises(ShardError):
        Shard(shard)


def layout_versions(content: bytes) -> set[int]:
    """Versions of the data sets' layout messages: newer ones are what older libraries cannot read."""
    found, at = set(), content.find(b"OHDR")
    while at >= 0:
        flags = content[at + 5]
        place = at + 6 + (16 if flags & 0x20 else 0) + (4 if flags & 0x10 else 0)
        width = 1 << (flags & 3)
        end = place + width + int.from_bytes(content[place : place + width], "little")
        place += width
        while place + 4 <= end:
            kind, size = content[place], int.from_bytes(content[place + 1 : place + 3], "little")
            place += 6 if flags & 4 else 4
            if kind == 8:
                found.add(content[place])
            place += size
        at = content.find(b"OHDR", at + 4)
    return found


def test_every_hdf5_from_1_10_on_can_read_a_shard(shard, tmp_path):
    content = shard.read_bytes()
    assert content[8] == 3 and layout_versions(content) == {4}
    with h5py.File(tmp_path / "latest.h5", "w", libver="latest") as file:
        file.create_dataset("a", (4,), "u1", chunks=(2,), compression="gzip")
    if h5py.version.hdf5_version_tuple >= (2, 0, 0):
        assert layout_versions((tmp_path / "latest.h5").read_bytes()) == {5}, "what this library calls its latest"
