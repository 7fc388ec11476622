"""Columns of numbers in CSV files, with marks, empty lines and damage as they come."""

from pathlib import Path

import numpy as np
import pytest

from simrob_drake.base.errors import InvalidConfig
from simrob_drake.base.files import read_columns, read_matrix

NAMES = ["time", "joint_1"]
GOOD = "joint_1, time ,note\n1.5,0,a\n2.5,1e-1,b\n"


def written(folder: Path, content: str | bytes) -> Path:
    file = folder / "table.csv"
    file.write_bytes(content.encode() if isinstance(content, str) else content)
    return file


@pytest.mark.parametrize(
    ("content", "lines"),
    [
        (GOOD, [2, 3]),
        (b"\xef\xbb\xbf" + GOOD.encode(), [2, 3]),  # as spreadsheets write UTF-8
        (GOOD.replace("\n", "\r\n"), [2, 3]),
        (f"\n{GOOD.replace('2.5', f'{chr(10)},,{chr(10)}2.5')}\n\n", [3, 6]),
        (GOOD.replace("a\n", '"a\na"\n'), [3, 4]),
    ],
)
def test_columns_are_found_by_name_and_rows_know_their_lines(tmp_path, content, lines):
    values, numbers = read_columns(written(tmp_path, content), NAMES)
    np.testing.assert_array_equal(values, [[0, 1.5], [0.1, 2.5]])
    assert numbers == lines


@pytest.mark.parametrize(
    "content", ["1.5,2\n3,0.25\n", "1.5;2\n3;0.25\n", "1,5;2\n3;0,25\n", "\n1,5;2,0\r\n3,0;0,25\n"]
)
def test_a_table_without_names_may_have_decimal_commas_in_any_line(tmp_path, content):
    np.testing.assert_array_equal(read_matrix(written(tmp_path, content)), [[1.5, 2], [3, 0.25]])


def test_a_table_may_have_no_rows(tmp_path):
    values, numbers = read_columns(written(tmp_path, "time,joint_1\n"), NAMES)
    assert values.shape == (0, 2)
    assert numbers == []


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "table.csv: is empty; it must contain a line of names"),
        ("\n\ntime,joint_2\n0,0\n", "line 3: lacks the columns joint_1; required"),
        *(
            (GOOD.replace("2.5", bad), "line 3: contains a value that is not a number")
            for bad in ("x", "", "nan", "-inf")
        ),
        (
            GOOD.replace("\n2.5,1e-1,b", "\n\n\n2.5"),
            "line 5: contains a value that is not a number: 2.5",
        ),
        (b"\xff\xfe\x00", "cannot be read"),
        (GOOD.encode("utf-16"), "cannot be read"),
    ],
)
def test_damage_is_named_with_its_line(tmp_path, content, message):
    with pytest.raises(InvalidConfig, match=message):
        read_columns(written(tmp_path, content), NAMES)


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(InvalidConfig, match=r"nowhere\.csv: cannot be read"):
        read_columns(tmp_path / "nowhere.csv", NAMES)
