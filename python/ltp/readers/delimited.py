"""Owns reading of text tables (CSV and its relatives, plain or gzipped): decoding, delimiter, header, rows.

The first line that is neither blank nor a comment (`#` or `%`) is the header; a commented header, as numpy writes it,
is understood. The delimiter is found among comma, semicolon, tab and white space.
"""

from __future__ import annotations

import codecs
import csv
import gzip
import re
import zlib
from pathlib import Path

from ltp._ltp import InputError
from ltp.files import read_bytes
from ltp.readers.table import Column, Table, as_number, has_decimal_comma

SUFFIXES = (".csv", ".csv.gz", ".tsv", ".tsv.gz", ".txt", ".txt.gz")

_GZIP = b"\x1f\x8b"
# In a header of words parted by white space, a bracketed unit belongs to the word before it.
_HEADER_WORD = re.compile(r"[^\s\[(]\S*(?:\s*[\[(][^\])]*[\])])?")
_CONTROL = re.compile("[\x00-\x08\x0e-\x1f\x7f]")

# A line of the file that holds a row: its number (the first line is 1) and its text.
_Line = tuple[int, str]


def read(path: Path) -> Table:
    """The table in a text file. Raises `InputError` with file and row for anything that is not one."""
    text = _decode(path, _unpacked(path))
    lines, comments = _content(text)
    if not lines and not comments:
        raise InputError(f"{path}: the file is empty; a header row and rows of numbers are expected")
    header, lines = _header(path, lines, comments)
    delimiter = _delimiter(header[1], lines[0][1] if lines else "")
    names = _cells(path, [header], delimiter, in_header=True)[0]
    while len(names) > 1 and not names[-1]:
        names.pop()
    rows = _cells(path, lines, delimiter)
    _check_first_row(path, lines, rows)
    _check_widths(path, lines, rows, len(names))
    columns = zip(*rows, strict=True) if rows else [()] * len(names)
    return Table(
        source=str(path),
        columns=tuple(Column.named(name, cells) for name, cells in zip(names, columns, strict=True)),
        rows=[number for number, _ in lines],
    )


def _unpacked(path: Path) -> bytes:
    data = read_bytes(path)
    if data.startswith(_GZIP):  # told by its content: some programs forget the suffix
        try:
            return gzip.decompress(data)
        except (OSError, EOFError, zlib.error) as error:
            raise InputError(
                f"{path}: the gzip data cannot be unpacked ({error}); it is damaged or cut short: copy the file again"
            ) from None
    if path.suffix.lower() == ".gz" and data:
        raise InputError(
            f"{path}: the name ends in .gz but the content is not gzip (it begins with {data[:4]!r}); "
            "rename it to what it is, or copy the file again"
        )
    return data


def _decode(path: Path, data: bytes) -> str:
    encoding = "utf-16" if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) else "utf-8-sig"
    try:
        text = data.decode(encoding)
    except UnicodeDecodeError:
        text = data.decode("latin-1")  # never fails; a degree sign from an old program comes through
    rubbish = _CONTROL.search(text)
    if rubbish:
        raise InputError(
            f"{path}: not a table: binary content (byte value {ord(rubbish[0])} at character {rubbish.start()}); "
            f"expected rows of numbers as text; if it is another format, give it its own suffix (.npz, .mat)"
        )
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _content(text: str) -> tuple[list[_Line], list[_Line]]:
    """The lines that hold rows, and the comment lines before the first of them."""
    lines: list[_Line] = []
    comments: list[_Line] = []
    for number, line in enumerate(text.split("\n"), start=1):
        stripped = line.strip()
        if stripped.startswith(("#", "%")):
            if not lines:
                comments.append((number, stripped.lstrip("#% \t")))
        elif stripped:
            lines.append((number, line))
    return lines, comments


def _header(path: Path, lines: list[_Line], comments: list[_Line]) -> tuple[_Line, list[_Line]]:
    """The header line and the lines below it."""
    if not lines:
        return comments[-1], []
    if not _all_numbers(lines[0][1]):
        return lines[0], lines[1:]
    width = len(_split(lines[0][1]))
    for comment in reversed(comments):
        if len(_split(comment[1], in_header=True)) == width:
            return comment, lines
    number, first = lines[0]
    raise InputError(
        f"{path}: row {number}: no header, the first row is numbers already ({first.strip()[:40]!r}); "
        f"put a row with the names of its {width} columns on top, such as t,u,y"
    )


def _all_numbers(line: str) -> bool:
    return all(as_number(cell) is not None for cell in _split(line))


def _split(line: str, in_header: bool = False) -> list[str]:
    delimiter = _delimiter(line, "")
    if delimiter is None:
        return _HEADER_WORD.findall(line) if in_header else line.split()
    return next(csv.reader([line], delimiter=delimiter), [])


def _delimiter(header: str, first: str) -> str | None:
    """Comma, semicolon or tab, whichever parts both lines most often and equally; None for white space."""
    best: tuple[int, str | None] = (0, None)
    for candidate in (";", "\t", ","):
        in_header, in_first = header.count(candidate), first.count(candidate)
        # A decimal comma must not win over the semicolon that parts the cells: the header knows.
        count = in_header if in_first or not first else 0
        if count > best[0]:
            best = (count, candidate)
    return best[1]


def _cells(path: Path, lines: list[_Line], delimiter: str | None, in_header: bool = False) -> list[list[str]]:
    if delimiter is None:
        return [_HEADER_WORD.findall(line) if in_header else line.split() for _, line in lines]
    rows: list[list[str]] = []
    reader = csv.reader((line for _, line in lines), delimiter=delimiter, skipinitialspace=True)
    while len(rows) < len(lines):
        number = lines[len(rows)][0]
        try:
            rows.append([cell.strip() for cell in next(reader)])
        except csv.Error as error:
            raise InputError(f"{path}: row {number}: {error}; correct the row") from None
        if reader.line_num != len(rows):  # the row ran on into the next line
            raise InputError(f"{path}: row {number}: a quotation mark is opened and not closed; correct the row")
    return rows


def _check_first_row(path: Path, lines: list[_Line], rows: list[list[str]]) -> None:
    if rows and all(as_number(cell) is None and not has_decimal_comma(cell) for cell in rows[0]):
        shown = ", ".join(repr(cell[:20]) for cell in rows[0][:4])
        raise InputError(
            f"{path}: row {lines[0][0]}: not a table of numbers, no cell of the first row below the header is a number "
            f"(found {shown}); if it is a row of units, write them into the header as 'theta [deg]'"
        )


def _check_widths(path: Path, lines: list[_Line], rows: list[list[str]], width: int) -> None:
    for (number, _), row in zip(lines, rows, strict=True):
        while len(row) > width and not row[-1]:  # a delimiter at the end of a line adds nothing
            row.pop()
        if len(row) != width:
            raise InputError(
                f"{path}: row {number}: {len(row)} cells, but the header names {width} columns; "
                "complete the row (an empty cell is a gap) or remove it"
            )
