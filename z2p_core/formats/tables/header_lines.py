"""What the first lines of a table say: how it is encoded, a comment, a count, the names of its columns or units."""

from __future__ import annotations

import codecs
import re

from z2p_core.formats.tables.axis_names import AxisColumns, axis_columns

COMMENT_SIGNS = ("//", "%", ";")
"""A first line that begins so is a comment, as one with ``#`` is anywhere, unless it names columns or holds numbers."""
_EXCEL_SEPARATOR_LINE = re.compile(r'\s*"?sep=[^\r\n]"?\s*', re.IGNORECASE)
"""A first line that tells Excel what parts the cells."""
_MISSING_WORDS = {"na", "n/a", "<na>", "none", "null"}
"""What R, Python and databases write for a number that is not there; ``nan`` is a number already."""
_UNIT_WORDS = {"m", "mm", "cm", "km", "um", "µm", "nm", "ft", "in", "us-ft", "feet", "metre", "metres", "meter",
          "meters", "-"}  # fmt: skip
_BRACKETED_UNIT = re.compile(r"[(\[][^)\]]*[)\]]")
_BRACKETED_INDEX = re.compile(r"\[([012])\]")
"""Which of three numbers a column holds, as in ``points[0]``."""
_NUMBERED_COLUMN = re.compile(r"(|v|var|x|c|col|column|f|field|variable|spalte)[_ ]?(\d+)")
"""A column that a program has named by its number alone: pandas, R, MATLAB, GDAL."""
_FORTRAN_NUMBER = re.compile(r"([+-]?(?:\d+[.,]?\d*|[.,]\d+))[dD]([+-]?\d+)")
"""A number as Fortran writes it in double precision: ``1.0D+00``."""


def text_encoding(head: bytes) -> str:
    """The encoding that a text's first bytes tell: Excel and PowerShell write UTF-16, older programs of Windows cp1252.

    UTF-8 where they tell none.
    """
    if head.startswith((codecs.BOM_UTF32_LE, codecs.BOM_UTF32_BE)):
        return "utf-32"
    if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)  # the last letter may be cut
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8-sig"


def column_names(line: str) -> list[tuple[str, ...]]:
    """The ways to read a line as names of columns, lower-case, without units, with x, y and z once in each.

    None if the line holds something else. An unnamed column has the name ``""``. There are several ways where blanks or
    an empty first name leave open how many columns are meant: ``;x;y;z`` names three or four.
    """
    readings = (_with_axis_names([cell.strip(" \t\"'").lower() for cell in cells]) for cells in _split_cells(line))
    return list(dict.fromkeys(names for names in readings if names))


def names_degrees(line: str) -> bool:
    """Whether a line that names columns names longitude and latitude as the places of its points."""
    return any(columns is not None and columns.degrees for columns in _axis_columns_by_separator(line))


def names_depth(line: str) -> bool:
    """Whether a line that names columns names a depth, and no height, beside the places of its points."""
    return any(columns is not None and columns.depth for columns in _axis_columns_by_separator(line))


def names_heights(line: str) -> bool:
    """Whether a line that names columns says that z points up: it is a height, or x and y are places on a map."""
    return any(columns is not None and columns.heights for columns in _axis_columns_by_separator(line))


def without_comment(line: str) -> str:
    """The line without what ``#`` begins, unless only with it it names columns, as ``Point #,x,y,z``."""
    content = line.split("#", 1)[0]
    if content != line and content.strip() and not column_names(content) and column_names(line):
        return line.replace("#", " ")
    return content


def is_comment(line: str) -> bool:
    """Whether a first line begins as comments do, and is no row of a table whose first cell is empty (``;1;2;3``).

    Excel's ``sep=;`` is a comment too: the rows show what parts them.
    """
    if _EXCEL_SEPARATOR_LINE.fullmatch(line):
        return True
    return line.lstrip().startswith(COMMENT_SIGNS) and not (line.count(";") > 1 and is_row(line))


def is_row(line: str) -> bool:
    """Whether a cell of the line holds numbers: what has none is a line of words."""
    return any(all(map(is_number, cell.split())) for cell in _split_cells(line)[0] if cell.strip(" \t\r\n\"'"))


def is_count(line: str) -> bool:
    """Whether a line holds one whole number alone, which before the rows says how many they are."""
    word = line.strip()
    return word.isascii() and word.isdigit()


def is_units(line: str) -> bool:
    """Whether a line holds units of length and nothing else: ``[m],[m],[m]`` or ``m m mm``."""
    words = re.split(r"[;,\s]+", _BRACKETED_UNIT.sub("-", line.replace('"', "")).strip(";, \t\r\n"))
    return all(word.lower() in _UNIT_WORDS for word in words)


def only_numbers_columns(line: str, below: str) -> bool:
    """Whether a line over the row `below` numbers the columns, as pandas (``0,1,2``), R (``V1``) and MATLAB (``Var1``)
    name those of a matrix, so that it says nothing of them; the first, of the rows' names, may have none.

    Bare numbers may as well be a row of whole ones: they count columns only above a row that has decimals.
    """
    cells = [cell.strip(" \t\r\"'").lower() for cell in _split_cells(line)[0]]
    cells = cells[1:] if cells[0] in ("", "unnamed: 0", "row") else cells
    parts = [_NUMBERED_COLUMN.fullmatch(cell) for cell in cells]
    words = {part[1] for part in parts if part}
    if len(cells) < 3 or not all(parts) or len(words) > 1:
        return False
    first = int(parts[0][2]) if parts[0] else 0
    counted = [int(part[2]) for part in parts if part] == list(range(first, first + len(cells)))
    if not counted or first > 1 or (words == {""} and first != 0):
        return False
    return is_row(below) and (words != {""} or re.search(r"\d[.,]\d*[1-9]", _split_cells(below)[0][-1]) is not None)


def is_missing(text: str) -> bool:
    """Whether the text stands for a number that is not there."""
    return text.strip(" \t\r\n\"'").lower() in _MISSING_WORDS


def is_number(text: str) -> bool:
    """Whether the text, perhaps quoted, is a number, with a point or a comma; ``nan`` is one too."""
    text = text.strip("\"'")
    try:
        float(text.replace(",", "."))
    except ValueError:
        return is_fortran_number(text)
    return True


def is_fortran_number(text: str) -> bool:
    """Whether the text is a number with a ``D`` for its exponent."""
    return _FORTRAN_NUMBER.fullmatch(text) is not None


def plain_exponents(line: str) -> str:
    """The line with an ``e`` for each such ``D``."""
    return _FORTRAN_NUMBER.sub(r"\1e\2", line)


def _split_cells(line: str) -> list[list[str]]:
    """Cells of the line between each separator that it holds; between any of them last."""
    line = _BRACKETED_INDEX.sub(r":\1", line)
    line = _BRACKETED_UNIT.sub("", line.rstrip("\r\n").removeprefix("//").removeprefix("%"))
    return [*(line.split(sign) for sign in ";,\t" if sign in line), re.split(r"[;,\s]+", line.strip(";, \t"))]


def _axis_columns_by_separator(line: str) -> list[AxisColumns | None]:
    return [axis_columns([cell.strip(" \t\"'").lower() for cell in cells]) for cells in _split_cells(line)]


def _with_axis_names(names: list[str]) -> tuple[str, ...]:
    """The names, with x, y and z for those of the columns that hold them; none where that is open."""
    columns = axis_columns(names)
    if columns is None:
        return ()
    others = ["" if name in ("x", "y", "z") else name for name in names]
    for axis, index in zip("xyz", columns.indices, strict=True):
        others[index] = axis
    return tuple(others)
