"""Rows as tables: CSV, and Parquet where pyarrow is there."""

import csv
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from simrob_drake.folders import replaced_at_once
from simrob_drake.tuning.trial import Row


def write_rows(file: Path, rows: list[Row]) -> None:
    """Write rows as a table with a column for whatever one of them has; what a run has not stays empty.

    Args:
        file: whose name ends in ``.csv``; beside it comes one that ends in ``.parquet``, where pyarrow is there.
        rows: of the table.

    Raises:
        OutputError: the disk does not take it.
    """
    columns = list(dict.fromkeys(name for row in rows for name in row if name != "message"))
    columns += ["message"] if any("message" in row for row in rows) else []
    with replaced_at_once(file) as work, work.open("w", newline="", encoding="utf-8") as lines:
        writer = csv.DictWriter(lines, columns)
        writer.writeheader()
        writer.writerows(rows)
    if find_spec("pyarrow") is not None:
        _write_parquet(file.with_suffix(".parquet"), columns, rows)


def _write_parquet(file: Path, columns: list[str], rows: list[Row]) -> None:
    from pyarrow import parquet, table

    values = {name: _of_one_kind([row.get(name) for row in rows]) for name in columns}
    with replaced_at_once(file) as work:
        parquet.write_table(table(values), work)


def _of_one_kind(values: list[Any]) -> list[Any]:
    """Return the values of a column, whose kind Parquet keeps: numbers, truths or texts; mixed ones become texts."""
    kinds = {float if type(value) is int else type(value) for value in values if value is not None}
    if len(kinds) == 1 and kinds <= {float, bool, str}:
        return values
    return [None if value is None else str(value) for value in values]
