"""Parses the first lines of a table: encoding, comments, number of rows, column names and units."""

from __future__ import annotations

import codecs
import re

from z2p_core.formats.tables.axis_names import AxisColumns, axis_columns

COMMENT_SIGNS = ("//", "%", ";")
"""First lines with these signs are comments, unless they name columns or hold numbers; ``#`` begins one anywhere."""
_EXCEL_SEPARATOR_LINE = re.compile(r'\s*"?sep=[^\r\n]"?\s*', re.IGNORECASE)
"""A first line that tells Excel the delimiter."""
_MISSING_WORDS = {"na", "n/a", "<na>", "none", "null"}
"""Words for a missing number in R, Python and databases; ``nan`` is parsed as a number."""
_UNIT_WORDS = {"m", "mm", "cm", "km", "um", "µm", "nm", "ft", "in", "us-ft", "feet", "metre", "metres", "meter",
          "meters", "-"}  # fmt: skip
_BRACKETED_UNIT = re.compile(r"[(\[][^)\]]*[)\]]")
_NAME_AND_UNIT = re.compile(r"""([^\s,;()\[\]]+)[ \t]*[(\[]([^)\]\d][^)\]]*)[)\]]""")
"""A name and the unit behind it: ``height [m]``."""
_BRACKETED_INDEX = re.compile(r"\[([012])\]")
"""Index of a vector component in a column name, as in ``points[0]``."""
_NUMBERED_COLUMN = re.compile(r"(|v|var|x|c|col|column|f|field|variable|spalte)[_ ]?(\d+)")
"""Name of a column by its number alone, as pandas, R, MATLAB and GDAL write it."""
_FORTRAN_NUMBER = re.compile(r"([+-]?(?:\d+[.,]?\d*|[.,]\d+))[dD]([+-]?\d+)")
"""A number in Fortran's double-precision notation: ``1.0D+00``."""


def text_encoding(head: bytes) -> str:
    """Detects the encoding of a text from its first bytes.

    Excel and PowerShell write UTF-16, older Windows programs cp1252; the default is UTF-8.
    """
    if head.startswith((codecs.BOM_UTF32_LE, codecs.BOM_UTF32_BE)):
        return "utf-32"
    if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)  # the last character may be incomplete
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8-sig"


def column_names(line: str) -> list[tuple[str, ...]]:
    """The possible readings of a line as column names, lower-case, without units, each with x, y and z once.

    Empty if the line holds something else. An unnamed column has the name ``""``. There are several readings if blanks
    or an empty first name leave the number of columns open: ``;x;y;z`` names three or four columns.
    """
    readings = (_with_axis_names([cell.strip(" \t\"'").lower() for cell in cells]) for cells in _split_cells(line))
    return list(dict.fromkeys(names for names in readings if names))


def column_titles(line: str) -> dict[str, str]:
    """The names on a line of column names as they are written there, by the lower-case ones of `column_names`."""
    cells = (cell.strip(" \t\"'") for cells in _split_cells(line) for cell in cells)
    return {cell.lower(): cell for cell in cells}


def column_units(line: str) -> dict[str, str]:
    """The units in brackets behind names on a line of column names, by the names as they are written there."""
    return {name.strip(" \t\"'"): unit.strip() for name, unit in _NAME_AND_UNIT.findall(line) if unit.strip()}


def names_degrees(line: str) -> bool:
    """Whether a line of column names has longitude and latitude as coordinates."""
    return any(columns is not None and columns.degrees for columns in _axis_columns_by_separator(line))


def names_depth(line: str) -> bool:
    """Whether a line of column names has a depth, and no height, as a coordinate."""
    return any(columns is not None and columns.depth for columns in _axis_columns_by_separator(line))


def names_heights(line: str) -> bool:
    """Whether a line of column names implies that z points up: it is a height, or x and y are map coordinates."""
    return any(columns is not None and columns.heights for columns in _axis_columns_by_separator(line))


def without_comment(line: str) -> str:
    """The line without a ``#`` comment; kept whole if it names columns only as a whole, as ``Point #,x,y,z``."""
    content = line.split("#", 1)[0]
    if content != line and content.strip() and not column_names(content) and column_names(line):
        return line.replace("#", " ")
    return content


def is_comment(line: str) -> bool:
    """Whether a first line is a comment, and no row of a table whose first cell is empty (``;1;2;3``).

    Excel's ``sep=;`` counts as a comment: the delimiter is detected from the rows.
    """
    if _EXCEL_SEPARATOR_LINE.fullmatch(line):
        return True
    return line.lstrip().startswith(COMMENT_SIGNS) and not (line.count(";") > 1 and is_row(line))


def is_row(line: str) -> bool:
    """Whether at least one cell of the line holds numbers."""
    return any(all(map(is_number, cell.split())) for cell in _split_cells(line)[0] if cell.strip(" \t\r\n\"'"))


def is_count(line: str) -> bool:
    """Whether a line holds a single integer: before the rows it is their number."""
    word = line.strip()
    return word.isascii() and word.isdigit()


def is_units(line: str) -> bool:
    """Whether a line holds units of length and nothing else: ``[m],[m],[m]`` or ``m m mm``."""
    words = re.split(r"[;,\s]+", _BRACKETED_UNIT.sub("-", line.replace('"', "")).strip(";, \t\r\n"))
    return all(word.lower() in _UNIT_WORDS for word in words)


def only_numbers_columns(line: str, below: str) -> bool:
    """Whether a line above the row `below` only numbers the columns, as pandas (``0,1,2``), R (``V1``) and MATLAB
    (``Var1``) do for a matrix; the column of row names may have no number.

    Plain numbers could be a row of integers, so they count as column numbers only above a row with decimals.
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
    """Whether the text is a word for a missing number."""
    return text.strip(" \t\r\n\"'").lower() in _MISSING_WORDS


def is_number(text: str) -> bool:
    """Whether the text, perhaps quoted, is a number with a decimal point or comma; ``nan`` is one, too."""
    text = text.strip("\"'")
    try:
        float(text.replace(",", "."))
    except ValueError:
        return is_fortran_number(text)
    return True


def is_fortran_number(text: str) -> bool:
    """Whether the text is a number whose exponent is written with ``D``."""
    return _FORTRAN_NUMBER.fullmatch(text) is not None


def plain_exponents(line: str) -> str:
    """The line with ``e`` instead of ``D`` in exponents."""
    return _FORTRAN_NUMBER.sub(r"\1e\2", line)


def _split_cells(line: str) -> list[list[str]]:
    """The cells of a line, once for each separator that it contains, and last for any separator or blanks."""
    line = _BRACKETED_INDEX.sub(r":\1", line)
    line = _BRACKETED_UNIT.sub("", line.rstrip("\r\n").removeprefix("//").removeprefix("%"))
    return [*(line.split(sign) for sign in ";,\t" if sign in line), re.split(r"[;,\s]+", line.strip(";, \t"))]


def _axis_columns_by_separator(line: str) -> list[AxisColumns | None]:
    return [axis_columns([cell.strip(" \t\"'").lower() for cell in cells]) for cells in _split_cells(line)]


def _with_axis_names(names: list[str]) -> tuple[str, ...]:
    """The names, with x, y and z in place of the names of these columns; empty if they are not unique."""
    columns = axis_columns(names)
    if columns is None:
        return ()
    others = ["" if name in ("x", "y", "z") else name for name in names]
    for axis, index in zip("xyz", columns.indices, strict=True):
        others[index] = axis
    return tuple(others)
