"""JSON of strangers is read within bounds."""

import pytest

from z2p_renderer.storage.files.bounded_json import MAX_DEPTH, JsonError, read_json


def test_usual_json_is_read():
    assert read_json('{"a": [1, -2.5e3, true, null, "[[[["]}') == {"a": [1, -2500.0, True, None, "[[[["]}
    assert read_json(b"[]") == [] and read_json("[" * MAX_DEPTH + "]" * MAX_DEPTH)


@pytest.mark.parametrize("text, words", [
    ("[NaN]", "finite numbers, got NaN"), ("-Infinity", "got -Infinity"), ("[1e999]", "finite numbers, got 1e999"),
    ("9" * 5000, "at most 40 digits, got 5,000"), ("[" * 100 + "]" * 100, "nested"), ("[" * 200_000, "nested"),
    ('{"a":' * 50_000 + "1" + "}" * 50_000, "nested"), ("{", "not JSON"), ("", "not JSON"), (b"\xff", "not JSON"),
    (" " * 2_000_000, "at most 1,048,576 bytes"),
])  # fmt: skip
def test_json_beyond_the_limits_is_refused(text, words):
    with pytest.raises(JsonError, match=words):
        read_json(text)
