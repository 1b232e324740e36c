"""Error messages for users: one printable line of bounded length, whatever text the message quotes."""

from __future__ import annotations

MAX_MESSAGE_CHARACTERS = 1200
"""Longer messages lose their middle: what is wrong stands at the beginning, and what to do at the end."""
KEPT_END_CHARACTERS = 300
"""Characters that are kept of the end of a message that is too long."""
MAX_REASON_CHARACTERS = 160
"""Characters that a message quotes of a library's own error."""


class UserError(ValueError):
    """Base of the errors that a user can mend; its message is one line, whatever it quotes of files and settings."""

    def __init__(self, message: object = "") -> None:
        super().__init__(one_line(str(message)))


def one_line(text: str) -> str:
    """The text on one line of at most `MAX_MESSAGE_CHARACTERS`; unprintable characters become escape sequences."""
    if not text.isprintable():
        joined = " ".join(text.splitlines())
        text = "".join(character if character.isprintable() else ascii(character)[1:-1] for character in joined)
    if len(text) <= MAX_MESSAGE_CHARACTERS:
        return text
    return f"{text[: MAX_MESSAGE_CHARACTERS - KEPT_END_CHARACTERS - 5]} ... {text[-KEPT_END_CHARACTERS:]}"


def error_reason(error: BaseException) -> str:
    """An error's message on one line of at most `MAX_REASON_CHARACTERS`; the name of its type if it has no message."""
    return " ".join(str(error).split())[:MAX_REASON_CHARACTERS] or type(error).__name__
