"""The skeleton's arrays against Drake's own plant."""

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import MultibodyForces

from simrob_drake.kinematics.skeleton import skeleton_of
from simrob_drake.programs.gaits import zmp
from simrob_drake.programs.gaits.biped import walk
from simrob_drake.programs.gaits.phases import SAMPLE
from simrob_drake.programs.gaits.zmp import whole_body_zmp
from simrob_drake.robots.parse import add_urdf
from simrob_drake.robots.urdf import with_absolute_meshes

LEGGED = ("humanoid", "roid1", "zjudancer", "yobotics")


def drake_plant(name):
    model = skeleton_of(name).model
    plant = MultibodyPlant(0.0)
    urdf = with_absolute_meshes(model.element, model.folder)
    add_urdf(plant, urdf, name=name, where=name, collision=False)
    plant.Finalize()
    return plant


def posed(plant, name, root, angles):
    model, context = skeleton_of(name).model, plant.CreateDefaultContext()
    plant.SetFreeBodyPose(context, plant.GetFrameByName(model.root).body(), root)
    for axis, angle in zip(model.axes.values(), angles, strict=True):
        plant.GetJointByName(axis.joint).set_angle(context, axis.sign * angle)
    return context


@pytest.mark.parametrize("name", LEGGED)
def test_frames_mass_and_inertia_are_those_of_drake(name):
    skeleton, plant = skeleton_of(name), drake_plant(name)
    rng = np.random.default_rng(5)
    angles = rng.uniform(-1, 1, len(skeleton.model.axes))
    root = RigidTransform(RollPitchYaw(*rng.uniform(-1, 1, 3)), rng.uniform(-1, 1, 3))
    context = posed(plant, name, root, angles)

    frames = skeleton.frames(angles[np.newaxis], root.GetAsMatrix4())
    for link in skeleton.links:
        pose = plant.GetFrameByName(link).CalcPoseInWorld(context).GetAsMatrix4()
        np.testing.assert_allclose(skeleton.link_poses(link, frames)[0], pose, atol=1e-12)

    com = plant.CalcCenterOfMassPositionInWorld(context)
    assert skeleton.mass == pytest.approx(plant.CalcTotalMass(context), rel=1e-12)

    points = skeleton.mass_points(frames)[0]
    np.testing.assert_allclose(
        np.average(points, axis=0, weights=skeleton.point_masses), com, atol=1e-12
    )

    second = np.einsum("k,kx,ky->xy", skeleton.point_masses, points, points)
    inertia = np.trace(second) * np.eye(3) - second
    bodies = [body.index() for body in (plant.get_body(i) for i in plant.GetBodyIndices(plant.GetModelInstanceByName(
        plant.GetModelInstanceName(plant.GetFrameByName(skeleton.model.root).model_instance()))))]  # fmt: skip

    exact = (
        plant.CalcSpatialInertia(context, plant.world_frame(), bodies)
        .CalcRotationalInertia()
        .CopyToFullMatrix3()
    )
    np.testing.assert_allclose(inertia, exact, rtol=1e-9, atol=1e-12)


def test_the_zero_moment_point_is_that_of_inverse_dynamics():
    """The wrench that the floor must give a walking robot, by Drake, turns about no horizontal axis there."""
    name, motion = "zjudancer", walk("zjudancer", 4)
    skeleton, plant = skeleton_of(name), drake_plant(name)
    ours = whole_body_zmp(skeleton, motion.root, motion.positions, SAMPLE)

    body = plant.GetFrameByName(skeleton.model.root).body()

    for row in range(60, len(motion.times) - 60, 37):
        states = []
        for sample in (row - 1, row, row + 1):
            root = RigidTransform(motion.root[sample, :3, 3])  # this trunk does not turn
            context = posed(plant, name, root, motion.positions[sample])
            states.append(plant.GetPositions(context).copy())
        context = posed(plant, name, RigidTransform(motion.root[row, :3, 3]), motion.positions[row])
        plant.SetVelocities(
            context, plant.MapQDotToVelocity(context, (states[2] - states[0]) / (2 * SAMPLE))
        )
        rates = plant.MapQDotToVelocity(
            context, (states[2] - 2 * states[1] + states[0]) / SAMPLE**2
        )
        forces = MultibodyForces(plant)
        plant.CalcForceElementsContribution(context, forces)
        wrench = plant.CalcInverseDynamics(context, rates, forces)[
            body.floating_velocities_start_in_v() :
        ][:6]
        moment = wrench[:3] + np.cross(motion.root[row, :3, 3], wrench[3:])
        exact = np.array([-moment[1], moment[0]]) / wrench[5]
        np.testing.assert_allclose(ours[row], exact, atol=2e-4)  # differences of the second order


@pytest.mark.parametrize("chunk", [1, 7, 40])
def test_the_zero_moment_point_does_not_depend_on_how_many_postures_are_computed_at_once(
    monkeypatch: pytest.MonkeyPatch, chunk: int
) -> None:
    skeleton = skeleton_of("zjudancer")
    motion = walk("zjudancer", 2)
    rows = slice(100, 140)  # in the middle of a step
    root = motion.root[rows]
    positions = motion.positions[rows]
    at_once = whole_body_zmp(skeleton, root, positions, SAMPLE)

    monkeypatch.setattr(zmp, "_CHUNK", chunk)
    in_chunks = whole_body_zmp(skeleton, root, positions, SAMPLE)

    assert np.ptp(at_once, axis=0).max() > 0.001  # the point moves
    assert in_chunks == pytest.approx(at_once, abs=1e-12)
