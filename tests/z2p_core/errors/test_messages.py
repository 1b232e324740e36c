"""Messages fit on one line of a terminal, whatever they quote."""

import pickle

import pytest

from z2p_core.config import ConfigError
from z2p_core.errors.messages import MAX_MESSAGE_CHARACTERS, MAX_REASON_CHARACTERS, UserError, error_reason, one_line
from z2p_core.interfaces import ScanError, SettingError
from z2p_renderer.storage.images.image_files import PictureError
from z2p_renderer.storage.models.checkpoints import WeightsError
from z2p_renderer.storage.shards import ShardError


@pytest.mark.parametrize("text", ["", "expected x, got 'é' — 点群", "a" * MAX_MESSAGE_CHARACTERS])
def test_printable_text_is_unchanged(text):
    assert one_line(text) == text == str(UserError(text))


def test_unprintable_characters_are_escaped():
    assert one_line("a\nb\r\nc\0d\x1b[2Je\ud800f\u202eg") == "a b c\\x00d\\x1b[2Je\\ud800f\\u202eg"


def test_long_messages_lose_their_middle():
    message = one_line("expected a number, got " + "9" * 10_000 + "; give one")
    assert len(message) == MAX_MESSAGE_CHARACTERS
    assert message.startswith("expected a number, got 99") and message.endswith("99; give one")


@pytest.mark.parametrize("kind", [ScanError, SettingError, ConfigError, WeightsError, PictureError, ShardError])
def test_user_errors_are_one_line_and_can_be_pickled(kind):
    error = kind("got\n" + "x" * 5000)
    assert "\n" not in str(error) and len(str(error)) == MAX_MESSAGE_CHARACTERS and isinstance(error, ValueError)
    assert str(pickle.loads(pickle.dumps(error))) == str(error)


def test_a_librarys_error_is_quoted_in_short_or_by_its_type() -> None:
    assert error_reason(ValueError("bad\n  header")) == "bad header"
    assert error_reason(KeyError()) == "KeyError"
    assert len(error_reason(ValueError("long " * 1000))) <= MAX_REASON_CHARACTERS
