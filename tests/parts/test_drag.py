"""A drag pulls a point by a spring: against the weight that hangs on it, its own equation, and from run to run."""

from typing import Any

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame, SpatialInertia, UnitInertia

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import SimrobError
from simrob_drake.parts.forces import DragSpring

MASS, GRAVITY = 0.9048, 9.80665
FREE = {"pieces.ball.pose": [0, 0, 1, 0, 0, 0], "floor": None, "contact": None, "sensors": {}}


def ball(drag: dict[str, Any], *, until: float, **more: Any) -> Any:
    forces = {"pull": {"kind": "drag", "at": "ball", **drag}}
    return simulate(load_station("bouncing_ball", {**FREE, **more, "forces": forces}), duration=until, progress=False)


@pytest.mark.long
@pytest.mark.parametrize("scheme", ["cenic", "radau3"])
def test_a_ball_comes_to_hang_where_the_spring_carries_its_weight(scheme: str) -> None:
    result = ball(
        {"targets": [[0.2, 0.0, 1.5]], "each": 10.0, "stiffness": 50.0}, until=10.0, **{"solver.scheme": scheme}
    )
    sag = MASS * GRAVITY / 50.0
    ends = [result[f"piece.ball.{axis}"][-1] for axis in "xyz"]
    np.testing.assert_allclose(ends, [0.2, 0.0, 1.5 - sag], atol=2e-4)


def test_without_a_stiffness_a_quarter_of_a_metre_pulls_with_the_weight() -> None:
    result = ball({"targets": [[0.0, 0.0, 1.25]], "each": 5.0}, until=5.0)
    assert result["piece.ball.z"][-1] == pytest.approx(1.0, abs=1e-3)


def test_targets_follow_each_other_and_let_go() -> None:
    """After the last one the ball is free: it moves on evenly where nothing weighs."""
    result = ball(
        {"start": 0.5, "targets": [[0.1, 0.0, 1.0], [0.0, 0.2, 1.0]], "each": 0.25}, until=1.5, **{"gravity": 0}
    )
    times, pull = result.times, np.array([result[f"applied_force.pull.{axis}"] for axis in "xyz"]).T
    assert not pull[times < 0.5].any()
    assert not pull[times > 1.02].any()
    first, second = pull[(times > 0.52) & (times < 0.74)], pull[(times > 0.77) & (times < 0.99)]
    assert (np.abs(first[:, 1]) < 1e-9).all()
    assert first[0, 0] > 0
    assert (second[:, 1] > 0).any()
    speed = result["piece.ball.vx"][times > 1.02]
    assert np.ptp(speed) < 1e-6
    assert abs(speed[0]) > 1e-3


def test_the_equation_at_a_point_of_a_turned_moving_frame() -> None:
    plant = MultibodyPlant(0.0)
    inertia = SpatialInertia(2.0, np.zeros(3), UnitInertia.SolidSphere(0.1))
    body = plant.AddRigidBody("body", inertia)
    offset = RigidTransform(RollPitchYaw(0.3, -0.2, 0.9), [0.1, 0.2, 0.3])
    frame = plant.AddFrame(FixedOffsetFrame("handle", body.body_frame(), offset))
    plant.Finalize()
    point, target = np.array([0.05, -0.02, 0.4]), np.array([1.0, 2.0, 3.0])
    spring = DragSpring(period=0.01, plant=plant, frame=frame, point=point, gains=(70.0, 3.0))
    context = plant.CreateDefaultContext()
    pose = RigidTransform(RollPitchYaw(1.0, 0.5, -0.3), [0.4, 0.1, -0.2])
    plant.SetFreeBodyPose(context, body, pose)
    omega, speed = np.array([0.5, -1.0, 2.0]), np.array([0.1, 0.3, -0.4])
    plant.SetVelocities(context, np.concatenate([omega, speed]))
    state = plant.GetPositionsAndVelocities(context)
    force = spring.sample({}, {"target": np.array([1.0, *target]), "state": state})["force"]
    arm = pose.rotation() @ (offset @ point)
    expected = 70.0 * (target - pose.translation() - arm) - 3.0 * (speed + np.cross(omega, arm))
    turned = (pose.rotation() @ offset.rotation()).inverse() @ expected
    np.testing.assert_allclose(force, turned, rtol=1e-12)
    assert not np.any(spring.sample({}, {"target": np.zeros(4), "state": state})["force"])


def test_a_drag_needs_a_target_and_a_body_that_is_there() -> None:
    with pytest.raises(SimrobError, match="targets"):
        ball({"targets": []}, until=1.0)
    with pytest.raises(SimrobError, match="bal"):
        ball({"at": "bal", "targets": [[0, 0, 1]]}, until=1.0)
