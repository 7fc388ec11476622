"""A station's MuJoCo model is the very robot of the station: masses, inertias, feet, servos, limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.framework import Context

from simrob_drake import load_station
from simrob_drake.extensions.mujoco.runner import MujocoRunner
from simrob_drake.parts.station_plant import StationPlant

mujoco = pytest.importorskip("mujoco", reason="a cross-check, installed with the extra dev")


@dataclass
class Both:
    """One robot in Drake and in MuJoCo, in the same random posture."""

    station: StationPlant
    context: Context
    model: mujoco.MjModel
    data: mujoco.MjData


@pytest.fixture(scope="module", params=["humanoid_dynamic", "roid1_dynamic"])
def both(request: pytest.FixtureRequest) -> Both:
    from simrob_drake.extensions.mujoco.built import BuiltStation

    built = BuiltStation.of(load_station(request.param))
    station, model = built.ports.plant, built.model
    (robot,) = station.robots.values()
    data, context = mujoco.MjData(model), station.plant.CreateDefaultContext()
    random = np.random.default_rng(1)
    pose = RigidTransform(RollPitchYaw(random.uniform(-1, 1, 3)), random.uniform(-1, 1, 3))
    station.plant.SetFreeBodyPose(context, robot.root.body(), pose)
    data.qpos[:3], data.qpos[3:7] = pose.translation(), pose.rotation().ToQuaternion().wxyz()
    for joint in robot.joints:
        angle = random.uniform(joint.position_lower_limit(), joint.position_upper_limit())
        joint.set_angle(context, angle)
        data.joint(joint.name()).qpos[0] = angle
    mujoco.mj_forward(model, data)
    return Both(station, context, model, data)


def velocity_map(both: Both) -> np.ndarray:
    """Return the matrix from MuJoCo's velocities to Drake's: ours turns the base about the axes of the world."""
    (robot,) = both.station.robots.values()
    matrix = np.zeros((both.model.nv, both.model.nv))
    base = robot.root.body().floating_velocities_start_in_v()
    matrix[base : base + 3, 3:6] = both.data.xmat[both.model.body(robot.root.name()).id].reshape(
        3, 3
    )
    matrix[base + 3 : base + 6, :3] = np.eye(3)
    for joint in robot.joints:
        matrix[joint.velocity_start(), both.model.joint(joint.name()).dofadr[0]] = 1
    return matrix


def test_mass_and_centre_of_mass_are_the_same(both: Both) -> None:
    plant = both.station.plant
    assert both.model.body_mass.sum() == pytest.approx(plant.CalcTotalMass(both.context), rel=1e-6)
    centre = plant.CalcCenterOfMassPositionInWorld(both.context)
    np.testing.assert_allclose(both.data.subtree_com[0], centre, atol=1e-6)


def test_the_inertia_matrix_is_the_same_in_a_random_posture(both: Both) -> None:
    theirs = np.zeros((both.model.nv, both.model.nv))
    mujoco.mj_fullM(both.model, both.data, theirs)
    turn = velocity_map(both)
    ours = turn.T @ both.station.plant.CalcMassMatrix(both.context) @ turn
    np.testing.assert_allclose(theirs, ours, atol=1e-6 * np.abs(ours).max())
    joints = np.s_[6:, 6:]
    np.testing.assert_allclose(theirs[joints], ours[joints], rtol=1e-6, atol=1e-9)


def test_the_feet_are_where_they_are_in_the_plant(both: Both) -> None:
    (robot,) = both.station.robots.values()
    feet = [
        f"{link}_contact_{number}"
        for link in robot.feet.links
        for number in range(len(robot.feet.points[link]))
    ]
    spheres = [both.model.geom(name).id for name in feet]
    expected = [
        both.station.plant.GetFrameByName(link).CalcPoseInWorld(both.context) @ np.array(point)
        for link in robot.feet.links
        for point in robot.feet.points[link]
    ]
    np.testing.assert_allclose(both.data.geom_xpos[spheres], expected, atol=1e-6)
    np.testing.assert_allclose(both.model.geom_size[spheres, 0], robot.feet.radius)
    pairs = [row for row in range(both.model.npair) if both.model.pair_geom2[row] in spheres]
    assert len(pairs) == len(spheres)
    np.testing.assert_allclose(both.model.pair_friction[pairs, 0], robot.feet.friction[1])


def test_servos_damping_and_limits_are_those_of_the_plant(both: Both) -> None:
    (robot,) = both.station.robots.values()
    speeds = np.linspace(-0.01, 0.01, len(robot.joints))
    for joint, speed in zip(robot.joints, speeds, strict=True):
        both.data.joint(joint.name()).qvel[0] = speed
    away = np.linspace(-0.1, 0.1, len(robot.axes))
    both.data.ctrl[:] = (
        robot.axis_map.signs * [joint.get_angle(both.context) for joint in robot.joints] + away
    )
    mujoco.mj_forward(both.model, both.data)
    limit = robot.gains.torque_limit
    wanted = robot.gains.kp * away - robot.gains.kd * robot.axis_map.signs * speeds
    assert (np.abs(wanted) > limit).any()
    assert (np.abs(wanted) < limit).any()
    torques = robot.axis_map.signs * np.clip(wanted, -limit, limit)
    for joint, torque, speed in zip(robot.joints, torques, speeds, strict=True):
        there = both.data.joint(joint.name())
        assert there.qfrc_actuator[0] == pytest.approx(torque)
        assert there.qfrc_passive[0] == pytest.approx(-joint.default_damping() * speed)
        limits = joint.position_lower_limit(), joint.position_upper_limit()
        np.testing.assert_allclose(both.model.joint(joint.name()).range, limits)


def test_what_quick_roll_outs_leave_out_is_told():
    with_imu = load_station("humanoid_dynamic", {"sensors": {"head": {"kind": "imu"}}})
    assert any(
        "head are left out" in text for text in MujocoRunner(with_imu).run(duration=0.02).warnings
    )
    assert MujocoRunner(load_station("humanoid_dynamic")).run(duration=0.02).warnings == []
