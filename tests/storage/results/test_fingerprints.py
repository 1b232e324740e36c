"""Fingerprints change with meaning and with nothing else."""

import hashlib

import pytest

from z2p_core.registry import load, names
from z2p_renderer.storage.results.code_digest import code_digest
from z2p_renderer.storage.results.fingerprints import file_digest, fingerprint, plugin_fields, stage_fields

CODE = '''
class Gloss:
    """Doc."""
    size = 1
    """What it is."""

    def encode(self, value):
        """Doc."""
        return value * 2  # twice
'''


def test_key_order_and_tuples_do_not_matter_but_values_do():
    one = fingerprint({"a": 1, "b": (1.5, "x")})
    assert one == fingerprint({"b": [1.5, "x"], "a": 1})
    assert len(one) == 64
    assert one != fingerprint({"a": 1, "b": [1.5, "y"]})
    assert one != fingerprint({"a": 1, "b": ["x", 1.5]})


def test_a_float_that_is_not_finite_is_refused():
    with pytest.raises(ValueError):
        fingerprint({"a": float("nan")})


@pytest.mark.parametrize(
    "edited",
    [
        CODE.replace("# twice", "# doubled, as ever"),
        CODE.replace('"""Doc."""', '"""Another text."""'),
        CODE.replace('"""What it is."""', '"""Something else."""'),
        CODE.replace("value * 2", "(value\n                * 2)"),
        "# a licence\n\n" + CODE,
    ],
)
def test_comments_docstrings_and_layout_change_nothing(edited):
    assert edited != CODE
    assert code_digest(edited) == code_digest(CODE)


@pytest.mark.parametrize(
    "edited",
    [
        CODE.replace("* 2", "* 3"),
        CODE.replace("size = 1", "size = 2"),
        CODE.replace("value", "x"),
        CODE + "\nX = 'text'",
    ],
)
def test_code_changes_the_digest(edited):
    assert code_digest(edited) != code_digest(CODE)


def test_a_function_of_docstring_alone_still_parses():
    assert code_digest('def f():\n    """Doc."""\n') == code_digest('def f():\n    """Other."""\n')


def test_every_built_in_control_has_its_own_code_digest():
    digests = [plugin_fields(load("controls", name))["code"] for name in names("controls")]
    assert len(digests) >= 5
    assert len(set(digests)) == len(digests)


def test_file_digest_is_of_the_bytes(tmp_path):
    path = tmp_path / "mesh.ply"
    path.write_bytes(b"ply\n" * 100_000)
    assert file_digest(path) == hashlib.sha256(b"ply\n" * 100_000).hexdigest()


def test_an_unknown_stage_has_no_fields():
    assert stage_fields("render")["stage"] == "render"
    with pytest.raises(KeyError):
        stage_fields("rendering")
