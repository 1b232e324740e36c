"""Errors that users can mend: told in one line that any terminal shows, whatever a message quotes."""

from __future__ import annotations

MOST_CHARACTERS = 1200
"""Characters of a message; of a longer one the middle goes, for what is wrong stands first, and what to do last."""
_END_CHARACTERS = 300
MOST_REASON = 160
"""Characters that a message quotes of a library's own error."""


class UsersError(ValueError):
    """An error whose message is one line; what it quotes of files and settings may be anything."""

    def __init__(self, message: object = "") -> None:
        super().__init__(one_line(str(message)))


def one_line(text: str) -> str:
    """The text on one line of at most `MOST_CHARACTERS`; characters that no terminal shows are written as escapes."""
    if not text.isprintable():
        words = " ".join(text.splitlines())
        text = "".join(sign if sign.isprintable() else ascii(sign)[1:-1] for sign in words)
    if len(text) <= MOST_CHARACTERS:
        return text
    return f"{text[: MOST_CHARACTERS - _END_CHARACTERS - 5]} ... {text[-_END_CHARACTERS:]}"


def reason_of(error: BaseException) -> str:
    """What a library's error says, on one line of at most `MOST_REASON` characters; its type where it says nothing."""
    return " ".join(str(error).split())[:MOST_REASON] or type(error).__name__
