"""Files that a user names, with a limit of their size; tables in CSV; and the files that come with the package.

Files may be named by anybody, for instance in a station that was downloaded. So devices and pipes are refused, which
may have no end, and files that are much larger than such a file can be.

*Models* are stations, robots and pieces. They come with the package, or with its extensions.
"""

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
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from simrob_drake.base.errors import InvalidConfig, shorten
from simrob_drake.base.extension import addition_folders
from simrob_drake.base.file_cache import file_state
from simrob_drake.base.messages import Message, message
from simrob_drake.base.renaming import former_names_of

LARGEST_TEXT = 1_000_000
"""Largest size of a file that is written by hand [bytes]. A station's file has some thousand."""


class NotRead(OSError):
    """Raised when a file cannot or may not be read. Its text is the reason, without the name of the file."""


class TooLarge(NotRead):
    """Raised when a file has more bytes than are read."""


def content_of(file: Path | str, largest: int = LARGEST_TEXT) -> bytes:
    """Read the bytes of a file.

    Args:
        file: the file.
        largest: largest size [bytes].

    Raises:
        NotRead: the file cannot be read: there is none, it is no regular file, no file can have its name, or the system
            refuses it.
        TooLarge: the file is larger.
    """
    with open_regular(file) as stream:
        size = os.fstat(stream.fileno()).st_size
        content = b""
        # A file that is too large is not read at all: it could fill the memory.
        if size <= largest:
            # One byte more than allowed: the file may have grown. The result is None if reading would block.
            content = stream.read(largest + 1) or b""
    if max(len(content), size) > largest:
        raise TooLarge(
            message("base.larger_than", "it is larger than {largest:g} MB", largest=largest / 1e6)
        )
    return content


@contextmanager
def open_regular(file: Path | str) -> Iterator[BufferedReader]:
    """Open a regular file for reading bytes, for files that are not read as a whole. It is closed after the body.

    Raises:
        NotRead: there is no such file, it is no regular file, no file can have its name, or the system refuses to open
            it; also if the body raises an OSError, such as one of reading.
    """
    # A cache that makes a value from this file at the moment records its state.
    file_state(file)
    try:
        with _open(file) as content:
            yield content
    except NotRead:
        raise
    except OSError as problem:
        raise NotRead(problem.strerror or str(problem)) from None


def _open(file: Path | str) -> BufferedReader:
    """Open a regular file. Raises NotRead if it is another kind of file, and OSError as Python's own open."""
    try:
        return open(file, "rb", opener=_open_without_waiting)
    # The name contains a surrogate, or the character 0.
    except ValueError:
        raise NotRead(message("base.impossible_file_name", "no file can have this name")) from None


def _open_without_waiting(file: str, flags: int) -> int:
    """Open a regular file for Python's function open, and return its descriptor. Raises NotRead for others.

    Opening a pipe would wait until another process writes to it, hence O_NONBLOCK.
    """
    descriptor = os.open(file, flags | os.O_NONBLOCK)
    # The type is read from the open descriptor. Between a check of the name and its opening, the file could change.
    mode = os.fstat(descriptor).st_mode
    if stat.S_ISREG(mode):
        return descriptor
    os.close(descriptor)
    if stat.S_ISDIR(mode):
        raise NotRead(message("base.is_a_folder", "it is a folder"))
    raise NotRead(message("base.no_regular_file", "it is not a regular file"))


def text_of(file: Path | str, largest: int = LARGEST_TEXT) -> str:
    """Read a text file in UTF-8, without byte order mark. Lines of the result end with line feeds.

    Args:
        file: the file.
        largest: largest size [bytes].

    Raises:
        NotRead: the file cannot be read, is too large, or contains no UTF-8.
    """
    try:
        # Editors on Windows begin a file with a byte order mark, and end its lines with carriage return and line feed.
        text = content_of(file, largest).decode("utf-8-sig")
        return text.replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError as problem:
        raise NotRead(
            message(
                "base.no_utf8",
                "it is not text in UTF-8: {reason} in byte {start}",
                reason=problem.reason,
                start=problem.start,
            )
        ) from None


LARGEST_TABLE = 100_000_000
"""Largest size of a file with a table [bytes]: a million rows of seven columns."""

_LONGEST_LINE = 1_000_000
"""Largest length of a line of a table [characters]. A longer one is read in pieces."""


class Columns(NamedTuple):
    """Columns of a table.

    Attributes:
        values: the numbers, shape (m, k).
        lines: number of the line of each row in the file, from 1, length m.
    """

    values: NDArray[np.float64]
    lines: list[int]


class _Row(NamedTuple):
    """Row of a table.

    Attributes:
        line: number of its last line in the file, from 1. A cell in quotes may contain line feeds.
        cells: texts of its cells.
    """

    line: int
    cells: list[str]


def read_columns(file: Path, names: Sequence[str]) -> Columns:
    """Read columns of a table by the names in its first line, which may be in any order and among others.

    Empty lines do not count.

    Args:
        file: the CSV file.
        names: names of the k columns.

    Raises:
        InvalidConfig: the file cannot be read, lacks one of the columns or has it twice; or a row has something in a
            cell beyond the first line's, or no finite number in one of the columns.
    """
    rows = _rows(file)
    # The rows come from one iterator: taking the header leaves the rows of numbers.
    header = _header(rows, file)
    _check_header(header, names, file)
    indices = [header.cells.index(name) for name in names]
    # Arrays of Python's standard library: a list of numbers takes five times as much memory.
    values = array("d")
    lines = array("q")
    for row in rows:
        # Spreadsheets write empty cells beyond the last column.
        further_cells = row.cells[len(header.cells) :]
        if "".join(further_cells).strip():
            raise InvalidConfig(
                file,
                message("base.line", "line {line}", line=row.line),
                message(
                    "base.cells_and_columns",
                    "has {cells} cells, but the table has {columns} columns",
                    cells=len(row.cells),
                    columns=len(header.cells),
                ),
            )
        values.extend(_numbers(row, indices, file))
        lines.append(row.line)
    return Columns(np.array(values).reshape(-1, len(names)), lines.tolist())


def read_matrix(file: Path) -> NDArray[np.float64]:
    """Read a table without names, shape (lines, columns).

    Cells are separated by semicolons if the first line has any, and their numbers may then have decimal commas.
    Otherwise commas separate the cells.

    Raises:
        InvalidConfig: the file cannot be read, has no line, or has a line with another count of cells than the first or
            with something that is no finite number.
    """
    values = list[list[float]]()
    for row in _rows(file, has_names=False):
        # The numbers are checked first: in a table with text, a wrong count of cells is the smaller problem.
        values.append(_numbers(row, range(len(row.cells)), file))
        if len(row.cells) != len(values[0]):
            raise InvalidConfig(
                file,
                message("base.line", "line {line}", line=row.line),
                message(
                    "base.cells_unlike_first_line",
                    "has {cells} cells, but the first line has {first_cells}",
                    cells=len(row.cells),
                    first_cells=len(values[0]),
                ),
            )
    if not values:
        raise InvalidConfig(
            file, "", message("base.empty_table", "is empty; it must contain lines of numbers")
        )
    return np.array(values)


def column_names(file: Path) -> list[str]:
    """Read the names of a table's columns, in its first line that is not empty.

    Raises:
        InvalidConfig: the file cannot be read, or is empty.
    """
    return _header(_rows(file), file).cells


def _header(rows: Iterator[_Row], file: Path) -> _Row:
    """Take the first row, whose cells are the names of the columns. Raises InvalidConfig if there is none.

    Args:
        rows: rows of the table. Its first one is consumed.
        file: the file, for the error.
    """
    header = next(rows, None)
    if header is None:
        raise InvalidConfig(
            file,
            "",
            message(
                "base.empty_table_with_names",
                "is empty; it must contain a line of names, and lines of numbers below it",
            ),
        )
    return header._replace(cells=[name.strip() for name in header.cells])


def _rows(file: Path, *, has_names: bool = True) -> Iterator[_Row]:
    """Yield the rows of a table that are not empty, a line of names among them.

    Cells are separated by commas, or by semicolons, as spreadsheets write tables in languages with decimal commas. The
    first line decides which. In a table with semicolons, decimal commas become points.

    Args:
        file: the file.
        has_names: whether the first line contains the names of the columns. Otherwise it contains numbers.

    Raises:
        InvalidConfig: the file cannot be read.
    """
    try:
        text = text_of(file, LARGEST_TABLE)
        first_line = text.lstrip().partition("\n")[0]
        has_semicolons = ";" in first_line
        # Names have no decimal commas, so a comma between them is a separator, and a semicolon is a part of a name. No
        # number contains a semicolon, so between numbers it is always the separator.
        if has_names and "," in first_line:
            has_semicolons = False
        # Each call of readline gives a line, or an empty text at the end of the file. A file in which no line ends is
        # read in pieces, since the reader refuses a cell of such a length.
        stream = io.StringIO(text)
        lines = iter(lambda: stream.readline(_LONGEST_LINE), "")
        reader = csv.reader(lines, delimiter=";" if has_semicolons else ",")
        for cells in reader:
            if not "".join(cells).strip():
                continue
            # Tables with semicolons have decimal commas.
            numbers = [cell.replace(",", ".") for cell in cells] if has_semicolons else cells
            yield _Row(reader.line_num, numbers)
    except (NotRead, csv.Error) as problem:
        raise InvalidConfig(
            file, "", message("base.cannot_be_read", "cannot be read ({problem})", problem=problem)
        ) from None


def _check_header(header: _Row, names: Sequence[str], file: Path) -> None:
    """Check that a table has each of some columns once.

    Args:
        header: the names of its columns.
        names: names of the needed columns.
        file: the file, for the error.

    Raises:
        InvalidConfig: a column is missing, or is there twice.
    """
    line = message("base.line", "line {line}", line=header.line)
    missing = [name for name in names if name not in header.cells]
    if missing:
        lacking = message(
            "base.lacks_columns",
            "lacks the columns {missing}; required: {names}{hint}",
            missing=", ".join(missing),
            names=", ".join(names),
            hint=_separator_hint(header.cells),
        )
        raise InvalidConfig(file, line, lacking)
    # Two columns of the same name: it is not clear which of them is meant.
    twice = next((name for name in names if header.cells.count(name) > 1), None)
    if twice is not None:
        raise InvalidConfig(
            file, line, message("base.column_twice", "has the column {twice} twice", twice=twice)
        )


def _separator_hint(names: Sequence[str]) -> str:
    """Hint that a table has another separator than a comma, to be appended to a message. Empty if it has not.

    Args:
        names: names of the columns. Wrong separators are parts of a name.
    """
    # A table that has another separator has a single column, whose name is the whole first line.
    for separator in (";", "\t"):
        if any(separator in name for name in names):
            return message(
                "base.other_separator",
                "; the separator is {other}, but it must be a comma, with decimal points",
                other=repr(separator),
            )
    return ""


def _numbers(row: _Row, indices: Sequence[int], file: Path) -> list[float]:
    """Read the numbers in some cells of a row.

    Args:
        row: the row.
        indices: indices of the cells.
        file: the file, for the error.

    Raises:
        InvalidConfig: there is no such cell, or it contains no finite number.
    """
    try:
        # float() reads "nan" and "inf" without an error; they are refused below, together with all other texts.
        values = [float(row.cells[index]) for index in indices]
    except (ValueError, IndexError):
        values = [math.nan]
    if not all(map(math.isfinite, values)):
        found = shorten(",".join(row.cells))
        raise InvalidConfig(
            file,
            message("base.line", "line {line}", line=row.line),
            message(
                "base.no_number_in_table",
                "contains a value that is not a number: {found}",
                found=found,
            ),
        )
    return values


# Each robot, each piece and each exercise of the course has a folder of its own, with one of these files in it.
ROBOT_FILE = "robot.yaml"
"""Name of the file that describes a robot."""

PIECE_FILE = "piece.yaml"
"""Name of the file that describes a piece."""

EXERCISE_FILE = "exercise.yaml"
"""Name of the file that describes an exercise."""

_PACKAGE = Path(__file__).resolve().parents[1]
"""Folder of the Python package."""


def data_root() -> Path:
    """Folder with ``models``, ``diagrams`` and ``course``: inside the wheel, or the top of a checkout."""
    # The wheel contains these folders as `data`. A checkout has them next to the package.
    installed = _PACKAGE / "data"
    return installed if installed.is_dir() else _PACKAGE.parent


def models_root() -> Path:
    """Folder with one folder for each robot, and the folder ``pieces``."""
    return data_root() / "models"


def diagrams_root() -> Path:
    """Folder with one YAML file for each station."""
    return data_root() / "diagrams"


def description_message(kind: str, name: str, description: str) -> Message:
    """Make a message of the description of a model of the package, for which other languages have a text.

    Args:
        kind: ``station``, ``robot`` or ``piece``.
        name: its name.
        description: the English text in its file.
    """
    # Braces would be fields of the template.
    template = description.replace("{", "{{").replace("}", "}}")
    return Message(f"descriptions.{kind}_{name}", template, {})


def station_files() -> dict[str, Path]:
    """Files of the stations that come with the package and with extensions, by name."""
    return _model_files("stations")


def robot_files() -> dict[str, Path]:
    """Files of the robots that come with the package and with extensions, by name."""
    return _model_files("robots")


def piece_files() -> dict[str, Path]:
    """Files of the pieces that come with the package and with extensions, by name."""
    return _model_files("pieces")


def model_file(point: str, name: str) -> Path | None:
    """Find the file of one model by its name. Returns None if no model has this name.

    This is quicker than listing all files: extensions, which take long to find, are searched for unknown names only.

    Args:
        point: extension point: ``stations``, ``robots`` or ``pieces``.
        name: name of the model.
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
        # The right operand of | wins: the name of an earlier folder stays.
        found = _files_by_name(point, folder) | found
    return dict(sorted(found.items()))


def _own_folder(point: str) -> Path:
    """This package's own folder of stations, robots or pieces."""
    folders = {
        "stations": diagrams_root(),
        "robots": models_root(),
        "pieces": models_root() / "pieces",
    }
    return folders[point]


def _files_by_name(point: str, folder: Path) -> dict[str, Path]:
    """Find the files of stations, robots or pieces in one folder, by name.

    A station has the name of its file, a robot or a piece that of the folder of its file.
    """
    if point == "stations":
        return {file.stem: file for file in sorted(folder.glob("*.yaml"))}
    description = ROBOT_FILE if point == "robots" else PIECE_FILE
    return {file.parent.name: file for file in sorted(folder.glob(f"*/{description}"))}


def exercise_files() -> list[Path]:
    """Files of the exercises of the course that come with the package."""
    return sorted(data_root().glob(f"course/*/{EXERCISE_FILE}"))


if not TYPE_CHECKING:
    # The type checker does not see the former names, so that this package cannot use them.
    __getattr__ = former_names_of(__name__, {"opened": "open_regular"})
