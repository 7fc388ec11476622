"""The measures of a walk, against motions whose figures are known."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix

from simrob_drake import LeggedRobot, load_station, simulate
from simrob_drake.base.frames import xyz_quaternion_from_transform
from simrob_drake.results.record.walks import (
    foot_slip,
    headings,
    legged_robots,
    locomotion,
    mechanical_work,
    robot_that_fell,
)
from simrob_drake.results.result import SimulationResult

TIMES = np.linspace(0.0, 2.0, 201)


def moved(name: str, poses: list[RigidTransform], **signals: float) -> SimulationResult:
    """Return the run of a robot whose trunk is led through poses while its joints rest, whatever forces would say."""
    run = simulate(load_station(f"{name}_dynamic", {"duration": 0.01}), progress=False)
    joint = next(
        joint
        for joint in run.final_state.joints
        if joint.endswith(f"/{run.plant.robots['robot'].model.root}")
    )
    plant = run.plant.plant
    places = plant.GetJointByName(joint.split("/")[1]).position_start() + np.arange(7)
    base = np.array([xyz_quaternion_from_transform(pose) for pose in poses])
    positions = np.tile(run.positions_at(np.zeros(1)), (len(poses), 1))
    positions[:, places] = np.hstack([base[:, 3:], base[:, :3]])
    values = np.tile(run.values[0], (len(poses), 1))
    values[
        :, [index for index, column in enumerate(run.names) if column.startswith(("tau.", "v."))]
    ] = 0.0
    for column, value in signals.items():
        values[:, run.names.index(column.replace("__", "."))] = value
    start = run.names.index("base.x")
    values[:, start : start + 7] = base
    changes = {
        "times": np.linspace(0.0, 2.0, len(poses)),
        "values": values,
        "positions_at": lambda at: positions[
            np.searchsorted(np.linspace(0.0, 2.0, len(poses)), at)
        ],
    }
    return SimulationResult(**{**run.__dict__, **changes})


def along(way: np.ndarray, height: float, turn: np.ndarray | float = 0.0) -> list[RigidTransform]:
    turns = np.broadcast_to(turn, len(TIMES))
    return [
        RigidTransform(RotationMatrix.MakeZRotation(angle), [*(part * way), height])
        for part, angle in zip(TIMES / 2.0, turns, strict=True)
    ]


@pytest.mark.parametrize(
    ("name", "facing"),
    [("humanoid", (0, -1)), ("roid1", (1, 0)), ("zjudancer", (0, 1)), ("yobotics", (1, 0))],
)
def test_ahead_is_where_the_robot_faces(name, facing):
    """Where they face is in the facts; the way is 0.3 m ahead and 0.1 m to the left."""
    ahead = np.array(facing, dtype=float)
    left = np.array([-ahead[1], ahead[0]])

    found = locomotion(moved(name, along(0.3 * ahead + 0.1 * left, 0.5)))

    assert found.upright
    assert found.tilt == pytest.approx(0.0, abs=1e-12)
    assert found.ahead == pytest.approx(0.3)
    assert found.drift == pytest.approx(0.1)
    assert found.distance == pytest.approx(np.hypot(0.3, 0.1))
    assert found.speed == pytest.approx(np.hypot(0.3, 0.1) / 2.0)
    assert found.yaw == pytest.approx(0.0, abs=1e-12)
    assert found.smallest_height == 0.5
    assert found.fall_time is None


def test_whole_turns_count():
    found = locomotion(moved("roid1", along(np.zeros(2), 0.3, 4.5 * np.pi * TIMES / 2.0)))
    assert found.yaw == pytest.approx(4.5 * np.pi)
    assert found.cost_of_transport is None  # it went nowhere


def test_the_way_counts_in_the_first_heading():
    found = locomotion(moved("roid1", along(np.array([0.2, 0.0]), 0.3, np.pi / 2)))
    assert found.ahead == pytest.approx(0.0, abs=1e-12)
    assert found.drift == pytest.approx(-0.2)


def test_a_robot_with_a_sliding_axis_faces_somewhere_too():
    result = simulate(
        load_station("irb120_on_belt", {"robot.base": [0, 0, 0.14, 0.4, 0, 0]}), duration=0.02
    )

    robot = result.plant.robots["robot"]
    assert any(robot.model.prismatic)
    np.testing.assert_allclose(headings(result.plant, robot, result.pose("base")), 0.4)


def test_feet_that_are_dragged_slip_and_those_in_the_air_do_not():
    low = moved("humanoid", along(np.array([0.0, -0.3]), 0.445))  # 1 mm deep

    assert foot_slip(low, "robot") == pytest.approx({"right_foot": 0.3, "left_foot": 0.3})
    assert [entry.value for entry in low.verdict["foot_slip"].entries] == pytest.approx([0.3, 0.3])
    assert (
        "slid 300 mm over the ground during one stance at 2.00 s (bound 20 mm; 1 more violation)"
        in low.warnings[0]
    )

    high = moved("humanoid", along(np.array([0.0, -0.3]), 0.447))
    assert foot_slip(high, "robot") == {"right_foot": 0.0, "left_foot": 0.0}


def test_a_ball_that_rolls_does_not_slip():
    """The quadruped tips about the place where its feet touch: its balls of 25 mm roll, their middles move."""
    radius, angles = 0.025, np.linspace(0.0, 0.05, 201)
    start = moved("yobotics", along(np.zeros(2), 0.31546))
    plant = start.plant.plant
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, start.positions_at(np.zeros(1))[0])
    ball = plant.GetFrameByName("FL_foot").CalcPoseInWorld(context) @ np.array([0.0, 0.0, radius])
    trunk = RigidTransform([0.0, 0.0, 0.31546])
    poses = []
    for angle in angles:
        middle = ball + np.array([radius * angle, 0.0, -0.0005])
        turn = RigidTransform(RotationMatrix.MakeYRotation(angle))
        poses.append(RigidTransform(middle) @ turn @ RigidTransform(-ball) @ trunk)

    slip = foot_slip(moved("yobotics", poses), "robot")["FL_foot"]

    assert slip < 0.01 * radius * angles[-1]


def test_the_largest_lean_is_the_tilt():
    leaning = [RigidTransform(RotationMatrix.MakeXRotation(0.3 * t), [0, 0, 0.3]) for t in TIMES]
    assert locomotion(moved("roid1", leaning)).tilt == pytest.approx(0.3 * TIMES[-1])


def test_work_and_torque_are_those_of_the_joints():
    run = moved(
        "humanoid", along(np.array([0.0, -0.5]), 0.45), tau__left_knee=-1.5, v__left_knee=2.0
    )
    found = locomotion(run)

    assert mechanical_work(run, "robot") == pytest.approx(1.5 * 2.0 * 2.0)
    # its mass: facts
    assert found.cost_of_transport == pytest.approx(6.0 / (2.292 * 9.80665 * 0.5), rel=1e-4)
    assert found.peak_torque == {"axis": "left_knee", "torque": 1.5, "limit": 3.0, "ratio": 0.5}
    assert found.saturated == 0.0
    assert (
        locomotion(moved("humanoid", along(np.zeros(2), 0.45), tau__left_knee=3.0)).saturated == 1.0
    )


@pytest.mark.long
def test_a_walk_is_measured_in_the_summary():
    result = LeggedRobot("roid1_dynamic").walk(4)
    found = result.summary()["locomotion"]

    base = result.pose("base")

    assert found["ahead"] == pytest.approx(base[-1, 0] - base[0, 0], abs=1e-4)
    assert 0.05 < found["ahead"] < 0.3
    assert 0 < found["peak_torque"]["ratio"] <= 1 + 1e-9
    assert 0.1 < found["cost_of_transport"] < 50
    assert set(found["foot_slip"]) == {"r_foot", "l_foot"}
    assert max(found["foot_slip"].values()) < 0.03


def test_who_falls_is_told_when():
    push = {"forces.push": {"start": 0.2, "duration": 0.3, "force": [0, -40, 0]}, "duration": 3.0}
    result = simulate(load_station("humanoid_dynamic", push), progress=False)

    assert result.stopped_by == "fall"
    assert robot_that_fell(result) == "robot"
    assert robot_that_fell(replace(result, stopped_by=None)) is None

    watched = result.config.monitors["fall"].model_copy(update={"piece": "box"})
    config = result.config.model_copy(update={"monitors": {"fall": watched}})

    assert robot_that_fell(replace(result, config=config)) is None  # a box fell, and no robot

    found = result.summary()["locomotion"]
    assert found["fall_time"] == result.stop_time
    assert 0.2 < found["fall_time"] < 2.0


@pytest.mark.parametrize("station", ["irb120_dynamic", "humanoid_fixed", "bouncing_ball"])
def test_who_does_not_walk_has_no_measures(station):
    result = simulate(load_station(station), duration=0.02, progress=False)
    assert legged_robots(result) == []
    assert result.summary()["locomotion"] is None
