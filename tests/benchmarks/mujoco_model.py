"""A robot of a station as a MuJoCo model, made from the station's own finalized plant."""

from __future__ import annotations

import mujoco
import numpy as np
from pydrake.geometry import ProximityProperties
from pydrake.math import RigidTransform
from pydrake.multibody.plant import CalcContactFrictionFromSurfaceProperties
from pydrake.multibody.tree import RevoluteJoint, RigidBody

from simrob_drake.parts.site import StationRobot
from simrob_drake.stations.plant import StationPlant


def mujoco_spec(station: StationPlant, robot: StationRobot) -> mujoco.MjSpec:
    """Return a robot with a free base and contact spheres on a floor, as it stands in a plant.

    Its servos come in the robot's axis order and with its signs: controls are its references [rad]. Steps, solver and
    how soft contacts and joint limits are stay at MuJoCo's defaults. Shapes other than those of the feet are left out.
    """
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.option.gravity = station.plant.gravity_field().gravity_vector()
    root = robot.root.body()
    pose = station.plant.GetFreeBodyPose(station.plant.CreateDefaultContext(), root)
    _add_body(spec.worldbody, root, pose).add_freejoint(name=root.name())
    _add_descendants(spec, station, root)
    _add_contacts(spec, station, robot)
    _add_servos(spec, robot)
    return spec


def _add_descendants(spec: mujoco.MjSpec, station: StationPlant, root: RigidBody) -> None:
    """Add the bodies that hang on ``root`` by hinges, each after the one that carries it."""
    plant, waiting = station.plant, [root]
    joints = [plant.get_joint(index) for index in plant.GetJointIndices(root.model_instance())]
    while waiting:
        parent = waiting.pop(0)
        for joint in (joint for joint in joints if joint.parent_body() is parent):
            assert isinstance(joint, RevoluteJoint), f"{joint.name()}: links that are welded are one body"
            on_child = joint.frame_on_child().GetFixedPoseInBodyFrame()
            pose = joint.frame_on_parent().GetFixedPoseInBodyFrame() @ on_child.inverse()
            body = _add_body(spec.body(parent.name()), joint.child_body(), pose)
            _add_hinge(body, joint, on_child)
            waiting.append(joint.child_body())


def _add_body(parent: mujoco.MjsBody, link: RigidBody, pose: RigidTransform) -> mujoco.MjsBody:
    inertia = link.default_spatial_inertia()
    about_centre = inertia.Shift(inertia.get_com()).CalcRotationalInertia()
    return parent.add_body(
        name=link.name(),
        pos=pose.translation(),
        quat=pose.rotation().ToQuaternion().wxyz(),
        mass=inertia.get_mass(),
        ipos=inertia.get_com(),
        fullinertia=np.concatenate([about_centre.get_moments(), about_centre.get_products()]),
        explicitinertial=True,
    )


def _add_hinge(body: mujoco.MjsBody, joint: RevoluteJoint, on_child: RigidTransform) -> None:
    body.add_joint(
        name=joint.name(),
        type=mujoco.mjtJoint.mjJNT_HINGE,
        pos=on_child.translation(),
        axis=on_child.rotation() @ joint.revolute_axis(),
        damping=[joint.default_damping(), 0, 0],
        limited=mujoco.mjtLimited.mjLIMITED_TRUE,
        range=[joint.position_lower_limit(), joint.position_upper_limit()],
    )


def _add_contacts(spec: mujoco.MjSpec, station: StationPlant, robot: StationRobot) -> None:
    """Add the spheres of the feet and the floor; spheres touch the floor, not each other."""
    plant, inspector = station.plant, station.scene_graph.model_inspector()
    (floor,) = plant.GetCollisionGeometriesForBody(plant.world_body())
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], contype=1, conaffinity=0)
    surface = inspector.GetProximityProperties(floor)
    for link in robot.feet.links:
        for shape in plant.GetCollisionGeometriesForBody(plant.GetBodyByName(link, robot.instance)):
            spec.body(link).add_geom(
                type=mujoco.mjtGeom.mjGEOM_SPHERE,
                size=[inspector.GetShape(shape).radius(), 0, 0],
                pos=inspector.GetPoseInFrame(shape).translation(),
                friction=[_friction(inspector.GetProximityProperties(shape), surface), 0, 0],
                priority=1,  # its friction counts, not the larger one of the two surfaces
                contype=0,
                conaffinity=1,
                mass=0,
            )


def _friction(first: ProximityProperties, second: ProximityProperties) -> float:
    """Return the dynamic coefficient of two surfaces, the one that Drake's convex and discrete solvers use."""
    pair = [properties.GetProperty("material", "coulomb_friction") for properties in (first, second)]
    return CalcContactFrictionFromSurfaceProperties(*pair).dynamic_friction()


def _add_servos(spec: mujoco.MjSpec, robot: StationRobot) -> None:
    for number, (axis, joint, sign) in enumerate(zip(robot.axes, robot.joints, robot.axis_map.signs, strict=True)):
        limit = float(robot.gains.torque_limit[number])
        servo = spec.add_actuator(
            name=axis,
            trntype=mujoco.mjtTrn.mjTRN_JOINT,
            target=joint.name(),
            gear=[float(sign), 0, 0, 0, 0, 0],
            forcelimited=mujoco.mjtLimited.mjLIMITED_TRUE,
            forcerange=[-limit, limit],
        )
        servo.set_to_position(kp=float(robot.gains.kp[number]), kv=float(robot.gains.kd[number]))
