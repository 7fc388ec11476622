"""Read columns of numbers from CSV files, as measuring instruments and spreadsheets write them."""

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from simrob_drake.errors import InvalidConfig
from simrob_drake.frames import Vector


def read_columns(file: Path, names: Sequence[str]) -> tuple[Vector, list[int]]:
    """Return the columns of these names, which stand in the first line, in any order and among others.

    Empty lines do not count, nor does the mark that spreadsheets put before UTF-8.

    Returns:
        the values, shape (m, len(names)), and the number of each row's line, of length m.

    Raises:
        InvalidConfig: the file cannot be read, lacks a column, or holds something that is no finite number.
    """
    try:
        with file.open(newline="", encoding="utf-8-sig") as lines:
            reader = csv.reader(lines)
            rows = [(reader.line_num, row) for row in reader if any(cell.strip() for cell in row)]
    except (OSError, ValueError, csv.Error) as problem:
        raise InvalidConfig(file, "", f"cannot be read ({problem})") from problem
    first, header = rows[0] if rows else (1, [])
    header = [name.strip() for name in header]
    missing = [name for name in names if name not in header]
    if missing:
        lacking = f"lacks the columns {', '.join(missing)}; needed: {', '.join(names)}"
        raise InvalidConfig(file, f"line {first}", lacking)
    places = [header.index(name) for name in names]
    values = np.array([_numbers(row, places, file, line) for line, row in rows[1:]]).reshape(-1, len(names))
    return values, [line for line, _ in rows[1:]]


def _numbers(row: list[str], places: list[int], file: Path, line: int) -> list[float]:
    try:
        values = [float(row[place]) for place in places]
    except (ValueError, IndexError):
        values = [np.nan]
    if not np.isfinite(values).all():
        raise InvalidConfig(file, f"line {line}", f"holds something that is no number: {','.join(row)}")
    return values
