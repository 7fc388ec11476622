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

MASS = 0.9048  # kg, of the ball
GRAVITY = 9.80665  # m/s²
FREE = {"pieces.ball.pose": [0, 0, 1, 0, 0, 0], "floor": None, "contact": None, "sensors": {}}


def ball(drag: dict[str, Any], *, until: float, **more: Any) -> Any:
    forces = {"pull": {"kind": "drag", "at": "ball", **drag}}
    return simulate(
        load_station("bouncing_ball", {**FREE, **more, "forces": forces}),
        duration=until,
        progress=False,
    )


@pytest.mark.long
@pytest.mark.parametrize("scheme", ["cenic", "radau3"])
def test_a_ball_comes_to_hang_where_the_spring_carries_its_weight(scheme: str) -> None:
    """The spring is longer by m g / k than the distance to its target."""
    stiffness = 50.0  # N/m
    drag = {"targets": [[0.2, 0.0, 1.5]], "each": 10.0, "stiffness": stiffness}

    result = ball(drag, until=10.0, **{"solver.scheme": scheme})

    sag = MASS * GRAVITY / stiffness
    ends = [result[f"piece.ball.{axis}"][-1] for axis in "xyz"]
    np.testing.assert_allclose(ends, [0.2, 0.0, 1.5 - sag], atol=2e-4)


def test_without_a_stiffness_a_quarter_of_a_metre_pulls_with_the_weight() -> None:
    result = ball({"targets": [[0.0, 0.0, 1.25]], "each": 5.0}, until=5.0)
    assert result["piece.ball.z"][-1] == pytest.approx(1.0, abs=1e-3)


def test_targets_follow_each_other_and_let_go() -> None:
    """After the last one the ball is free: it moves on evenly where nothing weighs."""
    drag = {"start": 0.5, "targets": [[0.1, 0.0, 1.0], [0.0, 0.2, 1.0]], "each": 0.25}

    result = ball(drag, until=1.5, gravity=0)

    times = result.times
    pull = np.array([result[f"applied_force.pull.{axis}"] for axis in "xyz"]).T
    # The drag samples every 0.01 s, so the force is late by up to that.
    of_first_target = pull[(times > 0.52) & (times < 0.74)]
    of_second_target = pull[(times > 0.77) & (times < 0.99)]
    assert not pull[times < 0.5].any()
    assert not pull[times > 1.02].any()
    assert (np.abs(of_first_target[:, 1]) < 1e-9).all()
    assert of_first_target[0, 0] > 0
    assert (of_second_target[:, 1] > 0).any()
    speed = result["piece.ball.vx"][times > 1.02]
    assert np.ptp(speed) < 1e-6
    assert abs(speed[0]) > 1e-3


def test_the_equation_at_a_point_of_a_turned_moving_frame() -> None:
    """The force is k (target - p) - c dp/dt in the axes of the frame, and zero without a target."""
    stiffness = 70.0  # N/m
    damping = 3.0  # N·s/m
    target = np.array([1.0, 2.0, 3.0])
    plant = MultibodyPlant(0.0)
    body = plant.AddRigidBody(
        "body", SpatialInertia(2.0, np.zeros(3), UnitInertia.SolidSphere(0.1))
    )
    body_from_frame = RigidTransform(RollPitchYaw(0.3, -0.2, 0.9), [0.1, 0.2, 0.3])
    frame = plant.AddFrame(FixedOffsetFrame("handle", body.body_frame(), body_from_frame))
    plant.Finalize()
    point = np.array([0.05, -0.02, 0.4])
    spring = DragSpring(
        period=0.01, plant=plant, frame=frame, point=point, stiffness=stiffness, damping=damping
    )

    context = plant.CreateDefaultContext()
    pose = RigidTransform(RollPitchYaw(1.0, 0.5, -0.3), [0.4, 0.1, -0.2])
    omega = np.array([0.5, -1.0, 2.0])  # rad/s
    velocity = np.array([0.1, 0.3, -0.4])  # m/s, of the body's origin
    plant.SetFreeBodyPose(context, body, pose)
    plant.SetVelocities(context, np.concatenate([omega, velocity]))
    state = plant.GetPositionsAndVelocities(context)

    force = spring.sample({}, {"target": np.array([1.0, *target]), "state": state})["force"]
    force_without_target = spring.sample({}, {"target": np.zeros(4), "state": state})["force"]

    # from the body's origin to the point, in the world
    arm = pose.rotation() @ (body_from_frame @ point)
    point_velocity = velocity + np.cross(omega, arm)
    force_in_world = stiffness * (target - pose.translation() - arm) - damping * point_velocity
    world_from_frame = pose.rotation() @ body_from_frame.rotation()
    np.testing.assert_allclose(force, world_from_frame.inverse() @ force_in_world, rtol=1e-12)
    assert not np.any(force_without_target)


def test_a_drag_needs_a_target_and_a_body_that_is_there() -> None:
    with pytest.raises(SimrobError, match="targets"):
        ball({"targets": []}, until=1.0)
    with pytest.raises(SimrobError, match="bal"):
        ball({"at": "bal", "targets": [[0, 0, 1]]}, until=1.0)
