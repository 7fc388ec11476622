"""The script of a program is Python code, whatever the user has written in the program."""

import ast
from pathlib import Path

import pytest

from simrob_drake.programs.program import Program
from simrob_drake.programs.script import script


@pytest.mark.parametrize(
    "description", ["Pick and place", 'say """go"""', "back\\slash \\n", 'one "word"']
)
def test_the_docstring_of_a_script_has_the_description(description):
    """A description with triple quotes or backslashes neither ends the docstring nor changes in it."""
    program = Program(description=description, moves=({"wait": 1.0},))

    text = script(program, "kinova", {}, robot=None, legs=False, code=False, file=Path("pick.py"))

    docstring = ast.get_docstring(ast.parse(text))
    assert docstring == f"{description}; its signals are in pick-run/signals.csv."


def test_a_script_finds_a_station_in_its_own_folder_by_its_own_path():
    """Script and station can be moved to another folder together."""
    text = script(
        Program(moves=({"wait": 1.0},)),
        "/programs/cell.yaml",
        {"servo.kp": 300},
        robot=None,
        legs=False,
        code=False,
        file=Path("/programs/pick.py"),
    )

    assert (
        'station = load_station(Path(__file__).with_name("cell.yaml"), {"servo.kp": 300})' in text
    )
