"""Monitors of distance, force and pose end a run when they must, and only then."""

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from simrob_drake.blocks.contact_monitors import ContactMonitor, ForceLimitMonitor
from simrob_drake.blocks.pose_monitors import FallMonitor, WorkspaceMonitor

from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import xyz_quaternion_from_transform


def judged(monitor, value):
    """Return whether a monitor's condition holds at a value, by how much it is exceeded, and why."""
    context = monitor.CreateDefaultContext()
    monitor.get_input_port(0).FixValue(context, value)
    return monitor.holds(context), monitor.excess_port.Eval(context)[0], monitor.why(context)


@pytest.mark.parametrize(
    ("threshold", "distance", "holds"),
    [(0.0, 1e-6, False), (0.0, 0.0, True), (0.0, -0.01, True), (0.02, 0.03, False), (0.02, 0.01, True)],
)
def test_contact_is_where_the_distance_is_gone(threshold, distance, holds):
    found, excess, why = judged(ContactMonitor(names="tip and floor", threshold=threshold), [distance])
    assert found is holds
    assert excess == pytest.approx(threshold - distance)
    assert why == ("tip and floor touch" if threshold == 0 else "tip and floor are nearer than 20 mm")


@pytest.mark.parametrize(("force", "holds"), [([3, 0, -3.9], False), ([0, -3, 4], True), ([9, 9, 9], True)])
def test_a_force_counts_by_its_size(force, holds):
    found, excess, why = judged(ForceLimitMonitor(names="tip", limit=5.0), force)
    assert found is holds
    assert excess == pytest.approx(np.linalg.norm(force) - 5)
    assert why == "the force on tip reached the limit of 5 N"


def test_a_limit_of_a_body_region_is_named():
    _, _, why = judged(ForceLimitMonitor(names="tip", limit=65.0, region="face", hold=0.5), [0, 0, 70])
    assert why == "the force on tip reached the limit of 65 N of face for 0.5 s"


@pytest.mark.parametrize("monitor", [ContactMonitor(names="x"), ForceLimitMonitor(names="x", limit=1.0)])
def test_what_is_no_number_counts_as_exceeded(monitor):
    assert judged(monitor, np.full(monitor.get_input_port(0).size(), np.nan))[:2] == (True, np.inf)


def pose(point=(0.0, 0.0, 0.5), *, roll=0.0, pitch=0.0, yaw=0.0):
    return xyz_quaternion_from_transform(RigidTransform(RollPitchYaw(roll, pitch, yaw), np.array(point)))


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
    found, _, why = judged(WorkspaceMonitor(name="the tool", lower=[-1, -1, 0], upper=[1, 1, 1]), pose(point))
    assert found is (reason is not None)
    if reason:
        assert why == f"the tool left its workspace: {reason}"


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
    monitor = FallMonitor(name="robot", upright=RotationMatrix(), height=0.3, tilt=np.deg2rad(30))
    found, _, why = judged(monitor, where)
    assert found is (reason is not None)
    if reason:
        assert why == f"robot fell: {reason}"


def test_a_body_that_stands_on_its_side_leans_from_there():
    upright = RotationMatrix.MakeXRotation(np.pi / 2)
    monitor = FallMonitor(name="robot", upright=upright, tilt=0.2)
    assert not judged(monitor, pose(roll=np.pi / 2))[0]
    assert judged(monitor, pose(roll=np.pi / 2 + 0.25))[0]
    assert judged(monitor, pose())[0]


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan])
def test_a_bound_is_positive(bad):
    with pytest.raises(InvalidParameter, match=r"^limit is "):
        ForceLimitMonitor(names="x", limit=bad)
    with pytest.raises(InvalidParameter, match=r"^height is "):
        FallMonitor(name="x", upright=RotationMatrix(), height=bad)
    with pytest.raises(InvalidParameter, match=r"^tilt is "):
        FallMonitor(name="x", upright=RotationMatrix(), tilt=bad)


def test_bounds_that_bound_nothing_are_refused():
    with pytest.raises(InvalidParameter, match="a fall needs a bound"):
        FallMonitor(name="x", upright=RotationMatrix())
    with pytest.raises(InvalidParameter, match="below upper"):
        WorkspaceMonitor(name="x", lower=[0, 0, 0], upper=[1, 0, 1])
    with pytest.raises(InvalidParameter, match=r"^threshold is "):
        ContactMonitor(names="x", threshold=-0.1)
