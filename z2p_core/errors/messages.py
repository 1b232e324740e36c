"""Errors that users can mend: told in one line that any terminal shows, whatever a message quotes."""

from __future__ import annotations

MAX_MESSAGE_CHARACTERS = 1200
"""Characters of a message; of a longer one the middle goes, for what is wrong stands first, and what to do last."""
KEPT_END_CHARACTERS = 300
MAX_REASON_CHARACTERS = 160
"""Characters that a message quotes of a library's own error."""


class UserError(ValueError):
    """An error whose message is one line; what it quotes of files and settings may be anything."""

    def __init__(self, message: object = "") -> None:
        super().__init__(one_line(str(message)))


def one_line(text: str) -> str:
    """The text on one line of at most `MAX_MESSAGE_CHARACTERS`; characters that no terminal shows are written as escapes."""
    if not text.isprintable():
        words = " ".join(text.splitlines())
        text = "".join(sign if sign.isprintable() else ascii(sign)[1:-1] for sign in words)
    if len(text) <= MAX_MESSAGE_CHARACTERS:
        return text
    return f"{text[: MAX_MESSAGE_CHARACTERS - KEPT_END_CHARACTERS - 5]} ... {text[-KEPT_END_CHARACTERS:]}"


def error_reason(error: BaseException) -> str:
    """What a library's error says, on one line of at most `MAX_REASON_CHARACTERS` characters; its type where it says nothing."""
    return " ".join(str(error).split())[:MAX_REASON_CHARACTERS] or type(error).__name__
