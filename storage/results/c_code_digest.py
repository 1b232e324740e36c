"""Digests of C source: of its preprocessor tokens, so that comments and layout do not matter."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from functools import lru_cache

SPLICE = re.compile(r"\\[ \t]*\r?\n")
"""A line that continues in the next one; compilers join them first."""
TOKEN = re.compile(
    r"""
    (?P<header> (?<=include)[ \t]*<[^>\n]*> )
    | (?P<comment> /\*.*?\*/ | //[^\n]* )
    | (?P<line> \n )
    | (?P<space> [ \t\r\f\v]+ )
    | (?P<text> (?:u8|[LuU])? (?: "(?:\\.|[^"\\\n])*" | '(?:\\.|[^'\\\n])*' ) )
    | (?P<number> \.?\d (?: [eEpP][+-] | [\w.] )* )
    | (?P<name> \w+ )
    | (?P<sign> <<= | >>= | \.\.\. | -> | \+\+ | -- | << | >> | && | \|\| | \#\# | [-+*/%&|^!=<>]= | . )
    """,
    re.VERBOSE | re.DOTALL,
)


@lru_cache(maxsize=256)
def c_digest(source: str) -> str:
    """sha256 (64 hex digits) of C source without comments and layout; literals count as they are."""
    text = "\n".join(_join_tokens(line) for line in _token_lines(SPLICE.sub("", source)))
    return hashlib.sha256(text.encode()).hexdigest()


def _token_lines(source: str) -> Iterator[list[str]]:
    """The source's tokens: one list for each preprocessor directive (which ends with its line) and one for each
    stretch of code between directives (where line ends have no meaning)."""
    held: list[str] = []
    directive, blank = False, True
    for token in TOKEN.finditer(source):
        kind, text = token.lastgroup, token.group()
        if kind == "line" and directive:
            yield held
            held, directive = [], False
        elif kind == "sign" and text == "#" and blank:
            yield held
            held, directive = [text], True
        elif kind in ("space", "comment", "line"):
            if directive and held[-1] != " ":
                held.append(" ")  # `#define A(x)` and `#define A (x)` are not the same
        else:
            held.append(text.strip() if kind == "header" else text)
        blank = kind == "line" or (blank and kind in ("space", "comment"))
    yield held


def _join_tokens(tokens: list[str]) -> str:
    """The tokens, separated by zero bytes: ``a - -b`` is not ``a--b``, and ``int a`` is not ``inta``."""
    return "\0".join(tokens).removesuffix("\0 ")
