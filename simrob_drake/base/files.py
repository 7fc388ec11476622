"""The files that a user names, of a size that somebody may have meant, and their CSV; where those that ship are."""

import csv
import io
import math
import os
import stat
from array import array
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from io import BufferedReader
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simrob_drake.base.errors import InvalidConfig, shortened
from simrob_drake.base.extension import addition_folders
from simrob_drake.base.file_cache import file_state
from simrob_drake.base.messages import Message, message

LARGEST_TEXT = 1_000_000  # of files that are written by hand [bytes]: a station's has some thousand


class NotRead(OSError):
    """A file that cannot or may not be read; the text says why, and is all that there is to say."""


class TooLarge(NotRead):
    """A file with more bytes than are read."""


def content_of(file: Path | str, largest: int = LARGEST_TEXT) -> bytes:
    """Return the bytes of a file. Devices and pipes, which may have no end, are not waited for.

    Raises NotRead: it is not there, is no regular file, or no file can have its name; TooLarge: it has more bytes than
    ``largest``.
    """
    with opened(file) as content:
        size = os.fstat(content.fileno()).st_size
        found = b"" if size > largest else content.read(largest + 1) or b""  # None where reading would wait
    if max(len(found), size) > largest:
        raise TooLarge(message("base.larger_than", "it is larger than {largest:g} MB", largest=largest / 1e6))
    return found


@contextmanager
def opened(file: Path | str) -> Iterator[BufferedReader]:
    """Open a file as :func:`content_of` reads it, for those that are read bit by bit; raises NotRead as that does."""
    file_state(file)  # for the caches of values that are made from this file
    try:
        with _open(file) as content:
            yield content
    except NotRead:
        raise
    except OSError as problem:
        raise NotRead(problem.strerror or str(problem)) from None


def _open(file: Path | str) -> BufferedReader:
    try:
        return open(file, "rb", opener=_at_once)
    except ValueError:  # of a surrogate, or the character 0
        raise NotRead(message("base.impossible_file_name", "no file can have this name")) from None


def _at_once(file: str, flags: int) -> int:
    """Open a regular file, and wait for no other."""
    descriptor = os.open(file, flags | os.O_NONBLOCK)
    kind = os.fstat(descriptor).st_mode
    if stat.S_ISREG(kind):
        return descriptor
    os.close(descriptor)
    raise NotRead(
        message("base.is_a_folder", "it is a folder")
        if stat.S_ISDIR(kind)
        else message("base.no_regular_file", "it is no regular file")
    )


def text_of(file: Path | str, largest: int = LARGEST_TEXT) -> str:
    """Return a file's text in UTF-8, lines ended by line feeds, without byte order mark; raises NotRead: it is none."""
    try:
        return content_of(file, largest).decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError as problem:
        raise NotRead(
            message(
                "base.no_utf8",
                "it is no text in UTF-8: {reason} in byte {start}",
                reason=problem.reason,
                start=problem.start,
            )
        ) from None


LARGEST_TABLE = 100_000_000  # of a file [bytes]: a million rows of seven columns
_LONGEST_LINE = 1_000_000  # letters


def read_columns(file: Path, names: Sequence[str]) -> tuple[NDArray[np.float64], list[int]]:
    """Return the columns of these names, which stand in the first line, in any order and among others.

    Empty lines do not count, nor does the mark that spreadsheets put before UTF-8.

    Returns:
        the values, shape (m, len(names)), and the number of each row's line, of length m.

    Raises:
        InvalidConfig: the file cannot be read, lacks a column or has it twice, or a row is longer than the first line
            or holds something that is no finite number.
    """
    rows = _rows(file)
    first, header = _header(rows, file)
    _check_header(header, names, file, first)
    places = [header.index(name) for name in names]
    values, lines = array("d"), array("q")  # a list of numbers takes five times as much
    for line, row in rows:
        if len(row) > len(header) and "".join(row[len(header) :]).strip():
            raise InvalidConfig(
                file,
                message("base.line", "line {line}", line=line),
                message(
                    "base.cells_and_columns",
                    "has {cells} cells, and the columns are {columns}",
                    cells=len(row),
                    columns=len(header),
                ),
            )
        values.extend(_numbers(row, places, file, line))
        lines.append(line)
    return np.array(values).reshape(-1, len(names)), lines.tolist()


def read_matrix(file: Path) -> NDArray[np.float64]:
    """Return the numbers of a table without names, shape (lines, columns).

    Raises InvalidConfig: the file cannot be read, holds no line, or one of another length than the first or with
    something that is no finite number.
    """
    rows = list[list[float]]()
    for line, row in _rows(file):
        rows.append(_numbers(row, list(range(len(row))), file, line))
        if len(row) != len(rows[0]):
            raise InvalidConfig(
                file,
                message("base.line", "line {line}", line=line),
                message(
                    "base.cells_unlike_first_line",
                    "has {cells} cells, and the first line {first_cells}",
                    cells=len(row),
                    first_cells=len(rows[0]),
                ),
            )
    if not rows:
        raise InvalidConfig(file, "", message("base.empty_table", "is empty; it must hold lines of numbers"))
    return np.array(rows)


def column_names(file: Path) -> list[str]:
    """Return the names in the first line that is not empty; raises InvalidConfig: no file to read, or an empty one."""
    return _header(_rows(file), file)[1]


def _header(rows: Iterator[tuple[int, list[str]]], file: Path) -> tuple[int, list[str]]:
    """Return the number and the names of the first line."""
    line, header = next(rows, (1, []))
    if not header:
        raise InvalidConfig(
            file,
            "",
            message(
                "base.empty_table_with_names", "is empty; it must hold a line of names, and lines of numbers below"
            ),
        )
    return line, [name.strip() for name in header]


def _rows(file: Path) -> Iterator[tuple[int, list[str]]]:
    """Yield the rows that are not empty, each with the number of its last line."""
    try:
        text = text_of(file, LARGEST_TABLE)
        first, lines = text.lstrip().partition("\n")[0], io.StringIO(text)
        separator = ";" if ";" in first and "," not in first else ","
        reader = csv.reader(iter(lambda: lines.readline(_LONGEST_LINE), ""), delimiter=separator)
        for row in reader:
            if "".join(row).strip():
                yield reader.line_num, [cell.replace(",", ".") for cell in row] if separator == ";" else row
    except (NotRead, csv.Error) as problem:
        raise InvalidConfig(
            file, "", message("base.cannot_be_read", "cannot be read ({problem})", problem=problem)
        ) from None


def _check_header(header: list[str], names: Sequence[str], file: Path, line: int) -> None:
    missing = [name for name in names if name not in header]
    if missing:
        other = next((mark for mark in (";", "\t") if any(mark in name for name in header)), None)
        hint = (
            message(
                "base.other_separator",
                "; it is separated by {other}, and must be by commas, with decimal points",
                other=repr(other),
            )
            if other
            else ""
        )
        lacking = message(
            "base.lacks_columns",
            "lacks the columns {missing}; needed: {names}{hint}",
            missing=", ".join(missing),
            names=", ".join(names),
            hint=hint,
        )
        raise InvalidConfig(file, message("base.line", "line {line}", line=line), lacking)
    twice = next((name for name in names if header.count(name) > 1), None)
    if twice is not None:
        raise InvalidConfig(
            file,
            message("base.line", "line {line}", line=line),
            message("base.column_twice", "names the column {twice} twice", twice=twice),
        )


def _numbers(row: list[str], places: list[int], file: Path, line: int) -> list[float]:
    try:
        values = [float(row[place]) for place in places]
    except (ValueError, IndexError):
        values = [math.nan]
    if not all(map(math.isfinite, values)):
        found = shortened(",".join(row))
        raise InvalidConfig(
            file,
            message("base.line", "line {line}", line=line),
            message("base.no_number_in_table", "holds something that is no number: {found}", found=found),
        )
    return values


ROBOT_FILE, PIECE_FILE, EXERCISE_FILE = "robot.yaml", "piece.yaml", "exercise.yaml"
"""What the files are called that describe a robot, a piece and an exercise of the course."""
_PACKAGE = Path(__file__).resolve().parents[1]


def data_root() -> Path:
    """Return the folder with ``models``, ``diagrams`` and ``course``: inside the wheel, or the top of a checkout."""
    installed = _PACKAGE / "data"
    return installed if installed.is_dir() else _PACKAGE.parent


def models_root() -> Path:
    """Return the folder with one folder a robot, and ``pieces``."""
    return data_root() / "models"


def diagrams_root() -> Path:
    """Return the folder with one YAML file a station."""
    return data_root() / "diagrams"


def description_message(kind: str, name: str, description: str) -> Message:
    """Make a message of the description of a station, robot or piece of the package, which other languages have.

    Args:
        kind: ``station``, ``robot`` or ``piece``.
        name: its name.
        description: the English text in its file.
    """
    # Braces would be fields of the template.
    template = description.replace("{", "{{").replace("}", "}}")
    return Message(f"descriptions.{kind}_{name}", template, {})


def station_files() -> dict[str, Path]:
    """Return the files of the stations that come with the package and with extensions, by name."""
    return _model_files("stations")


def robot_files() -> dict[str, Path]:
    """Return the files of the robots that come with the package and with extensions, by name."""
    return _model_files("robots")


def piece_files() -> dict[str, Path]:
    """Return the files of the pieces that come with the package and with extensions, by name."""
    return _model_files("pieces")


def model_file(point: str, name: str) -> Path | None:
    """Find the file of one station, robot or piece by its name; None if there is none of that name.

    It is quicker than a look at all files: extensions, which take a while to find, are asked for unknown names only.
    """
    own = _files_by_name(point, _own_folder(point)).get(name)
    return own if own is not None else _model_files(point).get(name)


def hidden_models(point: str, folder: Path) -> list[str]:
    """Find the models in an extension's folder that cannot be used, since their name means another file.

    Args:
        point: extension point: ``stations``, ``robots`` or ``pieces``.
        folder: a folder that an extension adds there.

    Returns:
        names that this package, or an extension before, has too.
    """
    files_in_use = _model_files(point)
    own_files = _files_by_name(point, folder)
    return [name for name, file in own_files.items() if files_in_use[name] != file]


def _model_files(point: str) -> dict[str, Path]:
    """Find the files of all stations, robots or pieces by name, in this package's folder and in those of extensions.

    Of several files with the same name the first is taken: this package's own file, if it has one.
    """
    found: dict[str, Path] = {}
    for folder in (_own_folder(point), *addition_folders(point)):
        found = _files_by_name(point, folder) | found  # the name of an earlier folder stays
    return dict(sorted(found.items()))


def _own_folder(point: str) -> Path:
    """Return this package's own folder of stations, robots or pieces."""
    return {"stations": diagrams_root(), "robots": models_root(), "pieces": models_root() / "pieces"}[point]


def _files_by_name(point: str, folder: Path) -> dict[str, Path]:
    """Find the files of stations, robots or pieces in one folder, by name.

    A station has the name of its file, a robot or a piece that of the folder of its file.
    """
    if point == "stations":
        return {file.stem: file for file in sorted(folder.glob("*.yaml"))}
    description = ROBOT_FILE if point == "robots" else PIECE_FILE
    return {file.parent.name: file for file in sorted(folder.glob(f"*/{description}"))}


def exercise_files() -> list[Path]:
    """Return the files of the exercises of the course that come with the package."""
    return sorted(data_root().glob(f"course/*/{EXERCISE_FILE}"))
