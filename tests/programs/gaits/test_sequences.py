"""Postures one after the other, and the thesis's march."""

import numpy as np
import pytest

from simrob_drake import load_station
from simrob_drake.base.errors import InvalidParameter, UnknownName
from simrob_drake.kinematics.skeleton import skeleton_of
from simrob_drake.programs.gaits.registry import load_gaits
from simrob_drake.programs.gaits.sequences import march, posing, standing_height
from simrob_drake.programs.gaits.walker import exchange_sides, feet_of
from simrob_drake.robots.catalog import load_robot
from simrob_drake.stations.resolve import resolve

ALL = [
    (robot, name)
    for robot in ("humanoid", "roid1", "zjudancer", "yobotics")
    for name in load_gaits(robot).sequences
]


@pytest.mark.parametrize("robot", ["humanoid", "roid1", "zjudancer", "yobotics"])
def test_the_height_at_which_a_robot_stands_is_that_of_its_station(robot):
    config = load_station(f"{robot}_dynamic")
    entry = config.robots["robot"]

    angles = resolve(config).robots["robot"].initial

    assert standing_height(skeleton_of(robot), angles, entry.feet) == pytest.approx(
        entry.base[2], abs=1e-5
    )


def test_left_and_right_change_places_and_turns_their_sense():
    model = load_robot("roid1")
    values = model.axis_vector(
        {"left_knee": 10, "right_hip_yaw": 5, "torso_yaw": 3, "right_hip_roll": 2}, "values"
    )

    wanted = model.axis_vector(
        {"right_knee": 10, "left_hip_yaw": -5, "torso_yaw": -3, "left_hip_roll": 2}, "values"
    )

    np.testing.assert_array_equal(exchange_sides(model, values), wanted)


@pytest.mark.parametrize(("robot", "name"), ALL)
def test_sequences_stay_within_the_joints_limits(robot, name):
    lower, upper = load_robot(robot).axis_limits
    positions = posing(robot, name).positions

    assert (positions >= lower - 1e-9).all()
    assert (positions <= upper + 1e-9).all()


def test_a_sequence_is_where_it_shall_be_when_it_shall_be():
    motion = posing("humanoid", "step")
    at = {
        round(time, 2): np.rad2deg(row)
        for time, row in zip(motion.times, motion.positions, strict=True)
    }

    index = load_robot("humanoid").axis_index

    assert at[0.5][index("CadIF")] == pytest.approx(30)  # straight lines, as in the thesis
    assert at[1.0][index("RodI")] == pytest.approx(60)
    assert at[2.0][index("TobD")] == pytest.approx(-30)
    np.testing.assert_allclose(at[4.0], 0, atol=1e-9)


def test_the_soles_of_the_march_stay_flat():
    motion = march("humanoid", 4)
    skeleton = skeleton_of("humanoid")

    frames = skeleton.frames(motion.positions, motion.root)

    for foot in feet_of(skeleton, 0.0):
        tilt = np.arccos(np.clip(skeleton.link_poses(foot.link, frames)[:, 2, 2], -1, 1))
        assert np.rad2deg(tilt).max() < 1.01


def test_figures_of_sequences_and_marches_can_be_changed():
    assert march("humanoid", 4, move_time=0.5).duration == pytest.approx(
        (march("humanoid", 4).duration - 1) / 2 + 1
    )
    assert posing("humanoid", "bow", rest=0).duration == pytest.approx(
        posing("humanoid", "bow").duration - 1
    )


def test_the_march_scales_with_its_amplitude():
    whole, half = march("humanoid", 3).positions, march("humanoid", 3, amplitude=0.5).positions
    np.testing.assert_allclose(half - half[0], 0.5 * (whole - whole[0]), atol=1e-12)


@pytest.mark.parametrize(
    ("plan", "error", "says"),
    [
        (lambda: posing("humanoid", "jump"), UnknownName, "jump"),
        (
            lambda: posing("humanoid", "bow", targets=[{"time": 1, "target_deg": {}}] * 2),
            InvalidParameter,
            "targets",
        ),
        (lambda: march("roid1", 4), UnknownName, "march"),
        (lambda: march("humanoid", 0), InvalidParameter, "steps"),
        (lambda: march("humanoid", 4, amplitude=0), InvalidParameter, "amplitude"),
    ],
)
def test_what_cannot_be_is_refused(plan, error, says):
    with pytest.raises(error, match=says):
        plan()
