"""The table of all postures for a pose: torque, room to the limits and collisions of each, against what moves find."""

import numpy as np
import pytest

from simrob_drake import Arm, Workcell
from simrob_drake.base.errors import InvalidParameter
from simrob_drake.programs.errors import JointLimitExceeded, PathCollision

DOWN = (0.0, 0.0, np.pi)


def test_each_branch_says_what_a_move_there_would(kinematic):
    found = kinematic.branches([0.3, 0.1, 0.35, *DOWN])

    assert len(found) == 8
    for branch in found:
        np.testing.assert_allclose(kinematic.pose(branch.posture)[:3], [0.3, 0.1, 0.35], atol=1e-8)
        np.testing.assert_array_equal(branch.torque, kinematic.inverse_dynamics(branch.posture))
        room, axis = branch.room
        rooms = np.minimum(
            branch.posture - kinematic.chain.lower, kinematic.chain.upper - branch.posture
        )
        assert room == rooms.min() == rooms[kinematic.axes.index(axis)]
        if room < 0:
            with pytest.raises(JointLimitExceeded):
                kinematic.plan.move_abs_j(branch.posture)
    assert found[0].usable

    kinematic.move_abs_j(found[0].posture)


def test_what_is_carried_counts(kinematic):
    pose = [0.3, 0.1, 0.35, *DOWN]
    before = kinematic.branches(pose)[0]
    kinematic.attach("weight", pose=[0, 0, 0.05, 0, 0, 0])
    kinematic.tool("load")

    after = next(
        branch for branch in kinematic.branches(pose) if np.allclose(branch.posture, before.posture)
    )

    assert after.load[0] > before.load[0]

    axis = kinematic.axes.index(after.load[1])
    limit = kinematic.cell.robot(kinematic.name).gains.torque_limit[axis]

    assert after.load[0] == pytest.approx(abs(after.torque[axis]) / limit)


def test_a_branch_in_the_table_is_told(kinematic):
    found = kinematic.branches([0.3, 0.15, -0.05, *DOWN], wobj="table")

    hit = [branch for branch in found if branch.collision]
    assert hit
    assert not any(branch.usable for branch in hit)
    with pytest.raises(PathCollision):
        kinematic.plan.move_abs_j(hit[0].posture, check="collision")


def test_the_table_reads_in_degrees_with_a_star_before_what_can_be_used(kinematic):
    lines = str(kinematic.branches([0.3, 0.1, 0.35, *DOWN])).splitlines()

    assert lines[0].split()[:6] == [f"joint_{axis}" for axis in range(1, 7)]
    assert lines[1].startswith("*")
    assert " % joint_" in lines[1]
    assert " deg joint_" in lines[1]
    assert sum(line.startswith("*") for line in lines) < len(lines) - 1
    assert str(kinematic.branches([3.0, 0.0, 0.35])) == "no posture reaches the pose"


def test_an_axis_too_many_is_held_at_each_of_several_places():
    arm = Arm("irb120_on_belt")
    found = arm.branches(arm.pose(), held={"belt": [0.0, 0.1]})

    assert len(found) == 16
    assert sorted({branch.posture[0] for branch in found}) == [0.0, 0.1]
    with pytest.raises(InvalidParameter, match="held: belt is far; it must be a finite number"):
        arm.branches(arm.pose(), held={"belt": "far"})
    with pytest.raises(InvalidParameter, match=r"held is \[0\.1\]; it must be a mapping of axes"):
        arm.branches(arm.pose(), held=[0.1])
    with pytest.raises(InvalidParameter, match="pose is 2 poses; it must be one pose"):
        arm.branches([arm.pose(), arm.pose()])


def test_a_branch_in_another_arm_is_told():
    cell = Workcell("two_arms")
    left, right = cell.arm("left"), cell.arm("right")

    found = left.branches(right.pose())

    assert all("right" in branch.collision for branch in found if branch.room[0] >= 0)
