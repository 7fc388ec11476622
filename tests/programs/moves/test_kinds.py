"""What all kinds of moves declare: keys, words, entries of files; and a kind from outside."""

from importlib import import_module
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from simrob_drake import Arm, LeggedRobot, Program, Workcell
from simrob_drake.base.errors import InvalidConfig, InvalidParameter
from simrob_drake.base.sections import Strict
from simrob_drake.programs import moves
from simrob_drake.programs.moves.grip import FingerMove
from simrob_drake.programs.moves.kinds import KINDS, check_move
from simrob_drake.programs.moves.motion import ArmMotion, ToolMotion
from simrob_drake.programs.moves.move import Move, Outlook, field_of
from simrob_drake.programs.moves.move_l import plan_move_l
from simrob_drake.programs.moves.walk import GaitMove

ENTRIES = [
    {"target_deg": {"left_knee": 10.0}, "duration": 1.0},
    {"walk": {"steps": 4}},
    {"walk": {"steps": 4, "ramp_steps": 0}},
    {"go": {"ahead": 0.1}},
    {"act": "bow"},
    {"act": {"name": "bow", "repeat": 2}},
    {"kick": {}},
    {"get_up": {}},
    {"get_up": {"attempts": 2}},
    {"kick": {"ball": "ball", "speed": 0.5, "foot": "left_foot"}},
    {"attach": "parcel"},
    {"attach": {"piece": "parcel", "tool": "left_hand"}},
    {"release": {"piece": "parcel", "fixed": True}},
    {"wait": 2.0},
    {"play": 5.0},
    {"move_abs_j": [0.0, 0.1]},
    {"move_j": {"targets": [0.1, 0.2, 0.3], "wobj": "rook"}},
    {"move_l": {"targets_deg": [0.1, 0.2, 0.3, 0.0, 0.0, 90.0], "speed": 0.1}},
    {"move_c": {"targets": [0.1, 0.2, 0.3], "via": [0.0, 0.2, 0.3]}},
    {"tool": "pencil"},
    {
        "together": [
            {"move_j": [0.1, 0.2, 0.3]},
            {"move_abs_j": {"targets": [0.1], "robot": "belt"}},
        ],
        "duration": 2.0,
    },
]


def test_every_kind_that_there_is_is_in_the_list():
    for file in Path(moves.__file__).parent.glob("*.py"):
        import_module(f"{moves.__name__}.{file.stem}".removesuffix(".__init__"))

    def below(kind):
        return {kind} | {one for child in kind.__subclasses__() for one in below(child)}

    shipped = {kind for kind in below(Move) if kind.__module__.startswith("simrob_drake.")}
    # which are no kinds themselves
    assert shipped - set(KINDS.values()) == {
        Move,
        ArmMotion,
        GaitMove,
        FingerMove,
    }


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_each_kind_says_what_it_is(kind):
    assert kind.of_arms or kind.of_legs
    assert kind.perform is not Move.perform or not kind.of_arms
    assert kind.stage is not Move.stage or not kind.of_legs


@pytest.mark.parametrize("entry", ENTRIES, ids=str)
def test_an_entry_of_a_file_comes_back_as_it_was(entry):
    program = Program.model_validate({"moves": [entry]})

    assert program.moves[0].entry() == entry
    assert Program.of_text(program.text()) == program
    assert check_move(entry) == program.moves[0]


class Circle(ToolMotion, ArmMotion):
    """A tool that goes out and back."""

    key: ClassVar[str] = "out_and_back"
    title: ClassVar[str] = "Out and back"

    def plan(self, planning):
        home = planning.pose[:3, 3].tolist()
        return plan_move_l(planning, [self.rows(planning), home], **self.how)


def test_a_kind_from_outside_runs_as_those_of_the_package_do():
    class Extended(Strict):
        moves: tuple[field_of(*KINDS.values(), Circle), ...]

    (move,) = Extended.model_validate({"moves": [{"out_and_back": [0.35, 0.1, 0.3]}]}).moves
    arm = Arm("irb120_kinematic")
    arm.move_abs_j([0, 0, 0, 0, np.pi / 2, 0])
    before = arm.pose()
    result = arm.do(move)
    way = result.pose("tcp")[:, :3]
    assert np.abs(way - [0.35, 0.1, 0.3]).max(axis=1).min() < 1e-6
    np.testing.assert_allclose(arm.pose(), before, atol=1e-9)


def test_one_verb_for_arms_and_legs():
    arm, again = Arm("irb120_kinematic"), Arm("irb120_kinematic")
    done = arm.do({"move_abs_j": [0.1, 0, 0, 0, 0, 0]})

    np.testing.assert_array_equal(done.values, again.move_abs_j([0.1, 0, 0, 0, 0, 0]).values)
    assert arm.do({"tool": "tool0"}) is None
    with pytest.raises(InvalidParameter, match=r"walk.*a move for arms, not for robots with legs"):
        arm.do({"walk": {"steps": 2}})

    legs = LeggedRobot("humanoid_fixed")
    assert legs.do({"wait": 0.1}, store=True).stop_time == pytest.approx(0.1)
    assert legs.program.moves[0].entry() == {"wait": 0.1}
    with pytest.raises(
        InvalidParameter, match=r"move_l.*a move for robots with legs, not for arms"
    ):
        legs.do({"move_l": [0, 0, 1]})


def test_what_a_move_leaves_is_known_before_it_is_done():
    robot = LeggedRobot(Workcell("humanoid_box"))
    outlook = Outlook(robot.cell.config)

    check_move({"attach": {"piece": "parcel", "pose": [0, 0, -0.05, 0, 0, 0]}}).stage(
        robot, outlook, "the move"
    )

    assert outlook.changed
    assert outlook.station.pieces["parcel"].parent == "robot"
    assert robot.cell.config.pieces["parcel"].parent != "robot"  # nothing was done


def test_what_is_no_move_is_said():
    with pytest.raises(InvalidConfig, match="wlak: unknown key; did you mean 'walk'"):
        check_move({"wlak": {"steps": 2}})
