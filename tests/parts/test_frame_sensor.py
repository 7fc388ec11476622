"""What a frame sensor tells, against differences of poses, and in a station's results."""

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from simrob_drake import load_station, simulate
from simrob_drake.base.errors import InvalidConfig
from simrob_drake.base.frames import transform_from_xyz_quaternion
from simrob_drake.parts.sensors.frames import AttachedFrame, RelativeMotion

STEP = 1e-6
HAND, ELBOW = (RigidTransform(RollPitchYaw(*turn), place) for turn, place in (
    ((0.3, -0.5, 0.9), [0.1, -0.2, 0.3]), ((-1.1, 0.4, 0.2), [0.05, 0.3, -0.1])
))  # fmt: skip


@pytest.fixture
def arm(add_irb120):
    from pydrake.systems.framework import DiagramBuilder

    plant = add_irb120(DiagramBuilder())
    plant.Finalize()
    return plant


def read(block, state):
    context = block.CreateDefaultContext()
    block.GetInputPort("state").FixValue(context, state)
    return tuple(block.GetOutputPort(part).Eval(context) for part in ("pose", "velocity"))


@pytest.mark.parametrize("axes", ["world", "base", "frame"])
def test_pose_and_velocity_are_those_of_the_kinematics(arm, axes):
    random = np.random.default_rng(4)
    context = arm.CreateDefaultContext()
    base, hand = (arm.GetFrameByName(name) for name in ("link_2", "link_6"))
    ends = {"base": AttachedFrame(base, ELBOW), "frame": AttachedFrame(hand, HAND)}
    turning, still = (
        RelativeMotion(plant=arm, **ends, axes=axes, turning=turns) for turns in (True, False)
    )
    for _ in range(3):
        q, v = random.uniform(-1, 1, 6), random.uniform(-2, 2, 6)
        seen = []
        for side in (-1, 0, 1):
            arm.SetPositions(context, q + side * STEP * v)
            b, f = base.CalcPoseInWorld(context) @ ELBOW, hand.CalcPoseInWorld(context) @ HAND
            turn = {
                "world": np.eye(3),
                "base": b.rotation().matrix(),
                "frame": f.rotation().matrix(),
            }[axes]
            seen.append(
                (turn, f.translation() - b.translation(), (b.inverse() @ f).rotation().matrix(), b)
            )
        turns, between, relative = ([entry[part] for entry in seen] for part in range(3))
        told = [entry[0].T @ entry[1] for entry in seen]
        pose, velocity = read(turning, np.concatenate([q, v]))
        np.testing.assert_allclose(pose[:3], told[1], atol=1e-12)
        orientation = transform_from_xyz_quaternion(pose).rotation().matrix()
        np.testing.assert_allclose(orientation, relative[1], atol=1e-12)
        np.testing.assert_allclose(velocity[:3], (told[2] - told[0]) / (2 * STEP), atol=1e-7)
        # of the frame in the base, in its axes
        spin = (relative[2] - relative[0]) / (2 * STEP) @ relative[1].T
        in_axes = turns[1].T @ seen[1][3].rotation().matrix() @ [spin[2, 1], spin[0, 2], spin[1, 0]]
        np.testing.assert_allclose(velocity[3:], in_axes, atol=1e-7)
        of_world = turns[1].T @ (between[2] - between[0]) / (2 * STEP)
        np.testing.assert_allclose(read(still, np.concatenate([q, v]))[1][:3], of_world, atol=1e-7)


def test_a_station_tells_it_and_a_flow_can_read_it():
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
    result = simulate(
        load_station("double_pendulum", {**changes, "controllers": {"drive": drive}}),
        progress=False,
    )
    z, vz = result["frame.tip.z"], result["frame.tip.vz"]
    np.testing.assert_allclose(
        np.gradient(z, result.times)[2:-2], vz[2:-2], atol=0.02 * np.abs(vz).max()
    )
    np.testing.assert_allclose(result["tau.joint_1"], -0.2 * z + 0.01 * vz, atol=1e-9)


def test_a_slip_of_the_program_within_a_block_is_no_divergence(monkeypatch):
    """A flow reads a sensor whose code fails: that is not what a solver does, and the place of it is named."""

    def slip(*_):
        return dict[str, int]()["absent"]

    monkeypatch.setattr(RelativeMotion, "_motion_in_world", slip)
    tip = {"kind": "frame", "frame": "lower_link"}
    drive = {"kind": "signal_flow", "blocks": {}, "torque": {"joint_1": {"frame.tip.z": 1.0}}}
    station = load_station(
        "double_pendulum", {"sensors": {"tip": tip}, "controllers": {"drive": drive}}
    )
    result = simulate(station, duration=0.1, progress=False)
    assert result.ending == "failed"
    assert "an error in the code at 0 s: KeyError: 'absent'" in result.message


def test_an_unknown_frame_is_told():
    with pytest.raises(InvalidConfig, match=r"no frame for sensors\.tip\.frame"):
        load_station("double_pendulum", {"sensors": {"tip": {"kind": "frame", "frame": "lowr"}}})
