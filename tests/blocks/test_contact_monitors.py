"""Monitors of distance, force and pose end a run when they must, and only then."""

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from simrob_drake import load_station
from simrob_drake.base.errors import SimrobError
from simrob_drake.base.frames import xyz_quaternion_from_transform
from simrob_drake.stations.resolve import resolve


def condition(kind, station="irb120_force_stop", overrides=None, **keys):
    """Condition of a monitor's section of a station."""
    config = load_station(
        station, {**(overrides or {}), "monitors": {"watch": {"kind": kind, **keys}}}
    )
    return config.monitors["watch"].condition("watch", resolve(config))


def judged(found, value):
    """Return whether a condition holds at a value, by how much it is exceeded, and why."""
    excess = found.excess(np.asarray(value, dtype=float))
    return excess >= 0, excess, found.why(np.asarray(value, dtype=float))


@pytest.mark.parametrize(
    ("threshold", "distance", "holds"),
    [
        (0.0, 1e-6, False),
        (0.0, 0.0, True),
        (0.0, -0.01, True),
        (0.02, 0.03, False),
        (0.02, 0.01, True),
    ],
)
def test_contact_is_where_the_distance_is_gone(threshold, distance, holds):
    touching = condition("contact", distance=threshold)
    found, excess, why = judged(touching, [distance])

    assert touching.watched == {"distance.gap": 1}
    assert found is holds
    assert excess == pytest.approx(threshold - distance)
    assert why == (
        "tip and floor touch" if threshold == 0 else "tip and floor are closer than 20 mm"
    )


@pytest.mark.parametrize(
    ("force", "holds"), [([3, 0, -3.9], False), ([0, -3, 4], True), ([9, 9, 9], True)]
)
def test_a_force_counts_by_its_size(force, holds):
    pressing = condition("force_limit", limit=5)
    found, excess, why = judged(pressing, force)

    assert pressing.watched == {"force.touch": 3}
    assert found is holds
    assert excess == pytest.approx(np.linalg.norm(force) - 5)
    assert why == "the force on tip reached the limit of 5 N"


def test_a_limit_of_a_body_region_is_named():
    _, _, why = judged(condition("force_limit", limit="hands_and_fingers", hold=0.5), [0, 0, 150])
    assert why == "the force on tip reached the limit of 140 N (hands and fingers) for 0.5 s"


def test_what_is_no_number_counts_as_exceeded():
    box = condition("workspace", lower=[-1, -1, 0], upper=[1, 1, 1])
    for found in (
        condition("contact"),
        condition("force_limit", limit=1),
        box,
        condition("fall", height=1),
    ):
        (size,) = found.watched.values()
        assert judged(found, np.full(size, np.nan))[:2] == (True, np.inf)


def pose(point=(0.0, 0.0, 0.5), *, roll=0.0, pitch=0.0, yaw=0.0):
    return xyz_quaternion_from_transform(
        RigidTransform(RollPitchYaw(roll, pitch, yaw), np.array(point))
    )


@pytest.mark.parametrize(
    ("point", "reason"),
    [
        ((0.0, 0.0, 0.5), None),
        ((0.99, -0.99, 0.01), None),
        ((1.1, 0.0, 0.5), "x above 1 m"),
        ((0.0, -1.2, 0.5), "y below -1 m"),
        ((0.0, 0.0, -0.1), "z below 0 m"),
    ],
)
def test_a_point_that_leaves_its_box(point, reason):
    found, _, why = judged(condition("workspace", lower=[-1, -1, 0], upper=[1, 1, 1]), pose(point))
    assert found is (reason is not None)
    if reason:
        assert why == f"the tool left its workspace: {reason}"


BOX = {"lower": [-1, -1, 0], "upper": [1, 1, 1]}


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_pose_that_is_not_finite_leaves_no_side_of_the_box(bad, axis):
    where = pose()
    where[axis] = bad
    assert judged(condition("workspace", **BOX), where) == (
        True,
        np.inf,
        "the pose of the tool is not finite: the simulation has diverged",
    )


def test_a_box_is_for_the_tool_in_use_a_named_one_or_a_free_piece():
    offset = {"robot.tcp_offset": [0, 0, 0.1, 0, 0, 0]}
    for found, output, who in (
        (condition("workspace", **BOX), "tcp_pose", "the tool"),
        (condition("workspace", tool="tool0", **BOX), "tcp_pose.tool0", "tool0"),
        (condition("workspace", tool="tip", **BOX), "tcp_pose.tip", "tip"),
        (condition("workspace", overrides=offset, tool="tcp", **BOX), "tcp_pose.tcp", "tcp"),
        (
            condition("workspace", "two_irb120", robot="left", **BOX),
            "left.tcp_pose",
            "left.the tool",
        ),
        (condition("workspace", "bouncing_ball", **BOX), "piece_pose.ball", "ball"),
    ):
        assert found.watched == {output: 7}
        assert found.why(pose((0, 0, 2))) == f"{who} left its workspace: z above 1 m"
    for tool in (
        "tool1",
        "tcp",
    ):  # without an offset the centre point in use has no name of its own
        with pytest.raises(
            SimrobError, match=rf"tool is {tool or None}; it must be a tool of robot"
        ):
            condition("workspace", tool=tool, **BOX)


@pytest.mark.parametrize(
    ("where", "reason"),
    [
        (pose(), None),
        (pose(yaw=3.0, roll=0.49), None),
        (pose((0, 0, 0.31)), None),
        (pose((0, 0, 0.29)), "its height is below 0.3 m"),
        (pose(roll=0.53), "it leans by more than 30 deg"),
        (pose(pitch=-2.0), "it leans by more than 30 deg"),
    ],
)
def test_a_fall_is_low_or_leans(where, reason):
    falls = condition("fall", height=0.3, tilt_deg=30)
    found, _, why = judged(falls, where)

    assert falls.watched == {"base_pose": 7}
    assert found is (reason is not None)
    if reason:
        assert why == f"robot fell: {reason}"


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("place", [2, 3, 6])
def test_a_body_that_is_nowhere_has_fallen(bad, place):
    where = pose(roll=0.1, yaw=0.1)
    where[place] = bad
    assert judged(condition("fall", height=0.3, tilt_deg=30), where) == (
        True,
        np.inf,
        "the pose of robot is not finite: the simulation has diverged",
    )


def test_a_body_that_stands_on_its_side_leans_from_there():
    on_its_side = {"pieces.ball.pose": [0, 0, 1, 0, 0, np.pi / 2]}
    falls = condition("fall", "bouncing_ball", on_its_side, tilt_deg=float(np.rad2deg(0.2)))

    assert falls.watched == {"piece_pose.ball": 7}
    assert not judged(falls, pose(roll=np.pi / 2))[0]
    assert judged(falls, pose(roll=np.pi / 2 + 0.25))[0]
    assert judged(falls, pose())[0]
    assert judged(falls, pose(roll=np.pi / 2 + 0.25))[1] == pytest.approx(0.25 / 0.2 - 1)


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan])
@pytest.mark.parametrize(
    ("kind", "key"), [("force_limit", "limit"), ("fall", "height"), ("fall", "tilt_deg")]
)
def test_a_bound_is_positive(kind, key, bad):
    with pytest.raises(SimrobError, match=rf"monitors\.watch\.{key}: "):
        condition(kind, **{key: bad})


def test_bounds_that_bound_nothing_are_refused():
    with pytest.raises(
        SimrobError, match=r"monitors\.watch: a fall monitor needs a bound: height or tilt_deg"
    ):
        condition("fall")
    with pytest.raises(SimrobError, match=r"it must be below upper, \[1\.0, 0\.0, 1\.0\]"):
        condition("workspace", lower=[0, 0, 0], upper=[1, 0, 1])
    with pytest.raises(SimrobError, match=r"monitors\.watch\.distance: "):
        condition("contact", distance=-0.1)
