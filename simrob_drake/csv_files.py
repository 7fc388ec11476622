"""Read columns of numbers from CSV files, as measuring instruments and spreadsheets write them."""

import csv
import io
import math
from array import array
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from simrob_drake.errors import InvalidConfig, shortened
from simrob_drake.files import NotRead, text_of
from simrob_drake.frames import Vector

LARGEST_TABLE = 100_000_000
"""Of a file [bytes]: a million rows of seven columns."""
_LONGEST_LINE = 1_000_000  # letters


def read_columns(file: Path, names: Sequence[str]) -> tuple[Vector, list[int]]:
    """Return the columns of these names, which stand in the first line, in any order and among others.

    Empty lines do not count, nor does the mark that spreadsheets put before UTF-8.

    Returns:
        the values, shape (m, len(names)), and the number of each row's line, of length m.

    Raises:
        InvalidConfig: the file cannot be read, lacks a column or has it twice, or a row is longer than the first line
            or holds something that is no finite number.
    """
    rows = _rows(file)
    first, header = next(rows, (1, []))
    header = [name.strip() for name in header]
    _check_header(header, names, file, first)
    places = [header.index(name) for name in names]
    values, lines = array("d"), array("q")  # a list of numbers takes five times as much
    for line, row in rows:
        if len(row) > len(header) and "".join(row[len(header) :]).strip():
            raise InvalidConfig(file, f"line {line}", f"has {len(row)} cells, and the columns are {len(header)}")
        values.extend(_numbers(row, places, file, line))
        lines.append(line)
    return np.array(values).reshape(-1, len(names)), lines.tolist()


def column_names(file: Path) -> list[str]:
    """Return the names in the first line that is not empty.

    Raises:
        InvalidConfig: the file cannot be read.
    """
    _, header = next(_rows(file), (1, []))
    return [name.strip() for name in header]


def _rows(file: Path) -> Iterator[tuple[int, list[str]]]:
    """Yield the rows that are not empty, each with the number of its last line."""
    try:
        lines = io.StringIO(text_of(file, LARGEST_TABLE))
        reader = csv.reader(iter(lambda: lines.readline(_LONGEST_LINE), ""))
        for row in reader:
            if "".join(row).strip():
                yield reader.line_num, row
    except (NotRead, csv.Error) as problem:
        raise InvalidConfig(file, "", f"cannot be read ({problem})") from problem


def _check_header(header: list[str], names: Sequence[str], file: Path, line: int) -> None:
    missing = [name for name in names if name not in header]
    if missing:
        other = next((mark for mark in (";", "\t") if any(mark in name for name in header)), None)
        told = f"; it is separated by {other!r}, and must be by commas, with decimal points" if other else ""
        lacking = f"lacks the columns {', '.join(missing)}; needed: {', '.join(names)}{told}"
        raise InvalidConfig(file, f"line {line}", lacking)
    twice = next((name for name in names if header.count(name) > 1), None)
    if twice is not None:
        raise InvalidConfig(file, f"line {line}", f"names the column {twice} twice")


def _numbers(row: list[str], places: list[int], file: Path, line: int) -> list[float]:
    try:
        values = [float(row[place]) for place in places]
    except (ValueError, IndexError):
        values = [math.nan]
    if not all(map(math.isfinite, values)):
        found = shortened(",".join(row))
        raise InvalidConfig(file, f"line {line}", f"holds something that is no number: {found}")
    return values
