"""Errors of users have one traceback, whose last line says what is wrong: no chain of causes that add nothing."""

import traceback

import pytest

from simrob_drake import Arm, Workcell, load_station, simulate
from simrob_drake.base.errors import SimrobError


def overridden(**overrides):
    return load_station(
        "irb120_dynamic", {key.replace("__", "."): value for key, value in overrides.items()}
    )


def broken_file(tmp_path, text):
    file = tmp_path / "station.yaml"
    file.write_text(text)
    return load_station(file)


MISTAKES = {
    "wrong joint": lambda path: overridden(robot__initial_deg={"joint_9": 5}),
    "wrong key": lambda path: overridden(servo__kq=5),
    "wrong value": lambda path: overridden(servo__kp="many"),
    "wrong length": lambda path: overridden(reference__target_deg=[1, 2]),
    "wrong station": lambda path: load_station("irb120_dynamik"),
    "no station file": lambda path: load_station(path / "none.yaml"),
    "no program file": lambda path: Workcell("irb120_dynamic").perform(path / "none.yaml"),
    "broken YAML": lambda path: broken_file(path, "robot: {model: irb120\n"),
    "text in place of a number": lambda path: broken_file(
        path, "robot: {model: irb120}\nduration: abc\n"
    ),
    "unit in a time": lambda path: simulate("irb120_dynamic", duration="5 s"),
    "push with two components": lambda path: simulate(
        "humanoid_dynamic", pushes={"a": {"force": [1, 2]}}
    ),
    "push that is a number": lambda path: simulate("humanoid_dynamic", pushes={"a": 5}),
    "joints of a move": lambda path: Arm("irb120_dynamic").move_abs_j([1, 2, 3]),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_of_a_user_has_one_traceback(tmp_path, mistake):
    with pytest.raises(SimrobError) as raised:
        MISTAKES[mistake](tmp_path)
    error = raised.value
    assert error.__cause__ is None
    assert error.__context__ is None or error.__suppress_context__

    shown = "".join(traceback.format_exception(error))
    assert shown.count("Traceback (most recent call last)") == 1


def test_a_wrong_push_says_which_key_is_wrong():
    with pytest.raises(
        SimrobError, match=r"pushes: a is .*as under forces: in a station \(force: .*3"
    ):
        simulate("humanoid_dynamic", pushes={"a": {"force": [1, 2]}})
