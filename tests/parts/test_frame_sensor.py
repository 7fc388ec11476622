"""Frame sensor: values against differences of poses, and signals in the results of a station."""

from typing import NamedTuple

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import InvalidConfig
from simrob_drake.base.frames import Vector, transform_from_xyz_quaternion
from simrob_drake.parts.sensors.frames import AttachedFrame, RelativeMotion

STEP = 1e-6
"""Time between two poses of a difference [s]."""
HAND = RigidTransform(RollPitchYaw(0.3, -0.5, 0.9), [0.1, -0.2, 0.3])
ELBOW = RigidTransform(RollPitchYaw(-1.1, 0.4, 0.2), [0.05, 0.3, -0.1])


@pytest.fixture
def arm(add_irb120):
    from pydrake.systems.framework import DiagramBuilder

    plant = add_irb120(DiagramBuilder())
    plant.Finalize()
    return plant


def evaluate(block, output, state):
    """Evaluate an output of a block of the sensor in a state of the plant."""
    context = block.CreateDefaultContext()
    block.GetInputPort("state").FixValue(context, state)
    return block.GetOutputPort(output).Eval(context)


class Poses(NamedTuple):
    """Poses of an arm with the positions of one moment.

    Attributes:
        base: pose of the sensor's base in the world.
        frame: pose of the measured frame in the world.
    """

    base: RigidTransform
    frame: RigidTransform

    @property
    def between(self) -> Vector:
        """Vector from the base to the frame in the world's axes, shape (3,) [m]."""
        return self.frame.translation() - self.base.translation()

    @property
    def frame_in_base(self) -> Vector:
        """Rotation of the frame in the base, shape (3, 3)."""
        return (self.base.inverse() @ self.frame).rotation().matrix()

    def axes(self, name: str) -> Vector:
        """Rotation of the axes in which the sensor gives vectors, shape (3, 3)."""
        rotations = {
            "world": np.eye(3),
            "base": self.base.rotation().matrix(),
            "frame": self.frame.rotation().matrix(),
        }
        return rotations[name]


@pytest.mark.parametrize("axes", ["world", "base", "frame"])
def test_pose_and_velocity_are_those_of_the_kinematics(arm, axes):
    """Velocities are compared with differences of poses a little before and after."""
    random = np.random.default_rng(4)
    context = arm.CreateDefaultContext()
    base = arm.GetFrameByName("link_2")
    hand = arm.GetFrameByName("link_6")
    ends = {"base": AttachedFrame(base, ELBOW), "frame": AttachedFrame(hand, HAND)}
    turning = RelativeMotion(plant=arm, **ends, axes=axes, turning=True)
    not_turning = RelativeMotion(plant=arm, **ends, axes=axes, turning=False)

    def poses_at(positions):
        arm.SetPositions(context, positions)
        return Poses(
            base=base.CalcPoseInWorld(context) @ ELBOW, frame=hand.CalcPoseInWorld(context) @ HAND
        )

    for _ in range(3):
        positions = random.uniform(-1, 1, 6)
        velocities = random.uniform(-2, 2, 6)
        state = np.concatenate([positions, velocities])

        pose = evaluate(turning, "pose", state)
        velocity = evaluate(turning, "velocity", state)
        velocity_without_turning = evaluate(not_turning, "velocity", state)

        before = poses_at(positions - STEP * velocities)
        now = poses_at(positions)
        after = poses_at(positions + STEP * velocities)
        to_axes = now.axes(axes).T
        np.testing.assert_allclose(pose[:3], to_axes @ now.between, atol=1e-12)
        orientation = transform_from_xyz_quaternion(pose).rotation().matrix()
        np.testing.assert_allclose(orientation, now.frame_in_base, atol=1e-12)

        # Relative to axes that turn: the difference of the vectors in these axes.
        vector_before = before.axes(axes).T @ before.between
        vector_after = after.axes(axes).T @ after.between
        linear = (vector_after - vector_before) / (2 * STEP)
        np.testing.assert_allclose(velocity[:3], linear, atol=1e-7)
        # Relative to axes that do not turn: the difference in the world, then in the axes.
        linear = to_axes @ (after.between - before.between) / (2 * STEP)
        np.testing.assert_allclose(velocity_without_turning[:3], linear, atol=1e-7)

        # dR/dt R' is the matrix of the cross product with the angular velocity of the frame in the base.
        change = (after.frame_in_base - before.frame_in_base) / (2 * STEP)
        spin = change @ now.frame_in_base.T
        angular_in_base = [spin[2, 1], spin[0, 2], spin[1, 0]]
        angular = to_axes @ now.base.rotation().matrix() @ angular_in_base
        np.testing.assert_allclose(velocity[3:], angular, atol=1e-7)


def test_a_station_records_it_and_a_signal_flow_can_read_it():
    tip = {"kind": "frame", "frame": "lower_link", "offset": [0.3, 0, 0, 0, 0, 0]}
    drive = {
        "kind": "signal_flow",
        "blocks": {},
        "torque": {"joint_1": {"frame.tip.z": -0.2, "frame.tip.vz": 0.01}},
    }
    changes = {
        "servo.kp": 0,
        "servo.kd": 0,
        "robot.initial_deg": [80, 0],
        "sensors": {"tip": tip},
        "duration": 0.5,
    }
    config = load_station("double_pendulum", {**changes, "controllers": {"drive": drive}})

    result = simulate(config, progress=False)

    height = result["frame.tip.z"]
    speed = result["frame.tip.vz"]
    gradient = np.gradient(height, result.times)
    np.testing.assert_allclose(gradient[2:-2], speed[2:-2], atol=0.02 * np.abs(speed).max())
    np.testing.assert_allclose(result["tau.joint_1"], -0.2 * height + 0.01 * speed, atol=1e-9)


def test_an_error_in_the_code_of_a_block_is_no_divergence(monkeypatch):
    """The run fails, and its message names the error and the time."""

    def fail(*_):
        return dict[str, int]()["absent"]

    monkeypatch.setattr(RelativeMotion, "_motion_in_world", fail)
    tip = {"kind": "frame", "frame": "lower_link"}
    drive = {"kind": "signal_flow", "blocks": {}, "torque": {"joint_1": {"frame.tip.z": 1.0}}}
    station = load_station(
        "double_pendulum", {"sensors": {"tip": tip}, "controllers": {"drive": drive}}
    )

    result = simulate(station, duration=0.1, progress=False)

    assert result.ending == "failed"
    assert "an error in the code at 0 s: KeyError: 'absent'" in result.message


def test_an_unknown_frame_is_refused():
    with pytest.raises(InvalidConfig, match=r"no frame for sensors\.tip\.frame"):
        load_station("double_pendulum", {"sensors": {"tip": {"kind": "frame", "frame": "lowr"}}})
