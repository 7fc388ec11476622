"""The start of a robot that is held by its root: clear of the floor and of itself, and within its motors' torques."""

import numpy as np
import pytest

from simrob_drake.stations.clear_start import ClearStart, Start
from simrob_drake.stations.clearance import reduce_own_overlaps
from simrob_drake.stations.collisions import OWN_TOLERANCE
from simrob_drake.stations.draft import draft_station
from simrob_drake.stations.load import load_station
from tests.stations.conftest import joint, link

GRAVITY = 9.80665
BASE = link("base", "0.1 0.1 0.2", "0 0 0.1")
BAR = "0.4 0.05 0.05", "0.2 0 0"  # a bar that lies level at zero


def start_of(clearance, *, torque=False) -> Start:
    return ClearStart(clearance, clearance.station.robots["robot"], 1.5, torque=torque).find()


def tip_heights(shoulder: float, lift: np.ndarray, elbow: np.ndarray) -> np.ndarray:
    """Heights of the ends of two bars of 0.4 m in a row, which are turned downward by angles [rad]."""
    middle = shoulder - 0.4 * np.sin(lift)
    return np.minimum(middle, middle - 0.4 * np.sin(lift + elbow)) - 0.025


def test_the_first_move_of_an_outstretched_arm_stays_over_the_floor(robot_of, tmp_path):
    """Both joints turned by +20 deg from zero, its tip would be 0.2 m below the floor."""
    swing = tip_heights(0.2, *np.deg2rad([[20.0], [20.0]]))

    assert swing[0] < -0.2

    urdf = robot_of(
        BASE,
        link("upper", *BAR),
        link("lower", *BAR),
        joint("upper", "base", "0 0 0.2"),
        joint("lower", "upper", "0.4 0 0"),
    )
    text = draft_station(urdf, folder=tmp_path)
    (file := tmp_path / "first.yaml").write_text(text)
    config = load_station(file)
    begin = config.robots["robot"].initial_deg or 0.0
    axes = ("upper_joint", "lower_joint")
    first = np.array([begin.get(axis, 0.0) for axis in axes] if begin else [0.0, 0.0])
    target = config.reference.target_deg

    last = np.array([target[axis] for axis in axes] if isinstance(target, dict) else [target] * 2)

    assert (np.abs(last - first) > 5).any()
    way = np.deg2rad(first + np.linspace(0, 1, 50)[:, np.newaxis] * (last - first))
    assert tip_heights(0.2, *way.T).min() > 0.0
    assert "no collision with the floor or between links" in text


def test_a_posture_is_found_that_weak_motors_hold(robot_of, clearance_of):
    weight = GRAVITY * 1.0 * 0.2  # N m, of a level bar
    urdf = robot_of(BASE, link("bar", *BAR), joint("bar", "base", "0 0 0.6", effort=0.7 * weight))

    start = start_of(clearance_of(urdf), torque=True)

    for angle in (start.posture[0], start.target[0]):
        assert weight * np.cos(angle) < 0.9 * 0.7 * weight
    assert any(
        "Not in the home posture, in which the robot is too heavy for its motors" in remark
        for remark in start.remarks
    )


@pytest.mark.long
def test_many_weak_motors_are_eased_one_after_the_other(robot_of, clearance_of):
    """Each of six level bars has to be turned by 51 deg of the 63 deg that it can: chance finds no such posture."""
    weight = GRAVITY * 0.2
    names = [f"bar{number}" for number in range(6)]
    hinges = [
        joint(name, "base", f"0 {0.2 * place} 1", span=(-1.1, 1.1), effort=0.7 * weight)
        for place, name in enumerate(names)
    ]

    start = start_of(
        clearance_of(robot_of(BASE, *(link(name, *BAR) for name in names), *hinges)), torque=True
    )

    for posture in (start.posture, start.target):
        assert (weight * np.cos(posture) <= 0.9 * 0.7 * weight).all()
    assert not any("No start" in remark for remark in start.remarks)


def test_without_a_posture_that_holds_the_draft_says_what_is_lacking(robot_of, clearance_of):
    weight = GRAVITY * 0.2
    urdf = robot_of(
        BASE,
        link("bar", *BAR),
        joint("bar", "base", "0 0 0.6", span=(-0.1, 0.1), effort=0.5 * weight),
    )

    start = start_of(clearance_of(urdf), torque=True)

    np.testing.assert_array_equal(start.target, start.posture)
    (remark,) = [
        remark for remark in start.remarks if "No start without faults was found" in remark
    ]
    assert "a motor that needs" in remark
    assert "in itself" not in remark


def test_a_base_that_reaches_below_its_root_is_raised(robot_of, clearance_of):
    urdf = robot_of(link("base", "0.1 0.1 0.3"), link("bar", *BAR), joint("bar", "base", "0 0 0.4"))
    start = start_of(clearance_of(urdf))

    assert start.height == pytest.approx(0.15, abs=1e-9)
    assert "The root is raised by 0.15 m, so that the robot stands on the floor." in start.remarks


def test_links_that_cannot_all_be_high_are_just_over_the_floor(robot_of, clearance_of):
    """Two bars on one hinge, 35 mm over the floor: what lifts the one, lowers the other."""
    thin = link("base", "0.02 0.02 0.035", "0 0 0.0175")
    bars = link("left", "0.2 0.01 0.01", "0.2 0 0"), link("right", "0.2 0.01 0.01", "-0.2 0 0", 0.5)
    urdf = robot_of(
        thin,
        *bars,
        joint("left", "base", "0 0 0.035", span=(-0.05, 0.05)),
        joint("right", "left", "0 0 0", span=(-1e-3, 1e-3)),
    )

    start = start_of(clearance_of(urdf))

    assert not any("No start" in remark for remark in start.remarks)
    for tilt in np.linspace(start.posture[0], start.target[0], 20):
        assert 0.035 - 0.005 - 0.3 * np.sin(abs(tilt)) > 0


def test_what_hangs_is_held_over_the_floor(robot_of, clearance_of):
    urdf = robot_of(
        link("base", "0.1 0.1 0.1"),
        link("rod", "0.03 0.03 0.6", "0 0 -0.3"),
        joint("rod", "base", "0 0 0"),
    )
    start = start_of(clearance_of(urdf))

    assert start.height > 0.6
    assert any(remark.startswith("The root is held ") for remark in start.remarks)


FINGERS = [link(name, "0.02 0.02 0.2", "0 0 0.1") for name in ("one", "two")]


def test_fingers_in_each_other_are_turned_apart(robot_of, clearance_of):
    """Fingers of 20 mm, whose joints are 15 mm apart, overlap by 5 mm unless one turns away."""
    hinges = [
        joint(name, "base", f"0 {y} 0.4", "1 0 0") for name, y in (("one", 0.0), ("two", 0.013))
    ]
    clearance = clearance_of(robot_of(BASE, *FINGERS, *hinges))

    (overlap,) = clearance.overlaps()

    assert (overlap.bodies, overlap.robot) == (("one", "two"), "robot")
    assert overlap.depth == pytest.approx(7e-3, abs=1e-6)

    robot = clearance.station.robots["robot"]
    posture = reduce_own_overlaps(clearance, robot, np.zeros(2), {1})

    assert posture[0] == 0.0
    assert posture[1] < 0  # about x: away from the other, which stands upright

    clearance.place_robots({"robot": posture})
    assert all(overlap.depth <= OWN_TOLERANCE for overlap in clearance.overlaps())


def test_sockets_do_not_count(robot_of, clearance_of):
    """A ball overlaps its socket, two joints before it, in all postures, and so is no collision."""
    ball = link("ball", "0.06 0.06 0.06")
    ring = link("ring", "0.001 0.001 0.001", mass=0.1)
    urdf = robot_of(
        BASE, ring, ball, joint("ring", "base", "0 0 0.15", "0 0 1"), joint("ball", "ring", "0 0 0")
    )

    clearance = clearance_of(urdf)

    assert clearance.policy.permanent_overlaps == {("ball", "base"): "robot"}
    assert clearance.overlaps() == []


def test_of_a_robot_without_shapes_nothing_is_said_to_be_clear(robot_of, clearance_of):
    bare = [part.partition("<collision>")[0] + "</link>" for part in (BASE, link("bar", *BAR))]
    remarks = start_of(
        clearance_of(robot_of(*bare, joint("bar", "base", "0 0 0.2"))), torque=True
    ).remarks

    assert remarks[0] == "Collisions were not checked, since the robot has no collision shapes."
    assert not any("no collision with" in remark for remark in remarks)
    assert "to hold the robot" in remarks[-1]
