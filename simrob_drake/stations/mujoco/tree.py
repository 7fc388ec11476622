"""The bodies and joints of a station's plant, as MJCF has them."""

from __future__ import annotations

import mujoco
import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.tree import Joint, JointActuatorIndex, PrismaticJoint, RevoluteJoint, RigidBody, WeldJoint

from simrob_drake.errors import InvalidParameter
from simrob_drake.parts.site import StationPlant
from simrob_drake.stations.mujoco.names import Names

_LEAST = 1e-9
"""MuJoCo takes no body without moments of inertia, as point masses on a link are [kg m²]."""
_KINDS = {RevoluteJoint: mujoco.mjtJoint.mjJNT_HINGE, PrismaticJoint: mujoco.mjtJoint.mjJNT_SLIDE}


def add_tree(spec: mujoco.MjSpec, station: StationPlant, names: Names) -> None:
    """Add every body of a finalized plant, each in the one that carries it, with mass, inertia and joint.

    Raises:
        InvalidParameter: a joint that MJCF does not know, or joints that are coupled.
    """
    plant = station.plant
    if plant.num_constraints() or plant.num_force_elements() > 1:  # of which gravity is one
        raise InvalidParameter("robots", "joints coupled to each other", "left out: MJCF gets a tree of free joints")
    armature = {
        motor.joint().index(): motor.default_reflected_inertia()
        for motor in (plant.get_joint_actuator(JointActuatorIndex(index)) for index in range(plant.num_actuators()))
    }  # of a joint's last actuator, as Drake counts
    waiting = [plant.world_body()]
    joints = [plant.get_joint(index) for index in plant.GetJointIndices()]
    while waiting:
        carrier = waiting.pop(0)
        for joint in [joint for joint in joints if joint.parent_body() is carrier]:
            onto = spec.worldbody if carrier is plant.world_body() else spec.body(names.body(carrier))
            waiting.append(joint.child_body())
            _add_joint(onto, station, joint, names, armature.get(joint.index(), 0.0))


def _add_joint(onto: mujoco.MjsBody, station: StationPlant, joint: Joint, names: Names, armature: float) -> None:
    link = joint.child_body()
    if link.is_floating_base_body():
        pose = station.plant.GetFreeBodyPose(station.plant.CreateDefaultContext(), link)
        _add_body(onto, link, names, pose).add_freejoint(name=names.joint(joint))
        return
    on_child = joint.frame_on_child().GetFixedPoseInBodyFrame()
    body = _add_body(onto, link, names, joint.frame_on_parent().GetFixedPoseInBodyFrame() @ on_child.inverse())
    if isinstance(joint, WeldJoint):
        if not joint.X_FM().IsExactlyIdentity():
            pose = joint.frame_on_parent().GetFixedPoseInBodyFrame() @ joint.X_FM() @ on_child.inverse()
            body.pos, body.quat = _placed(pose)
        return
    kind = _KINDS.get(type(joint))
    if kind is None:
        expected = "revolute, continuous, prismatic or fixed: MJCF is given no other"
        raise InvalidParameter(f"joint {names.joint(joint)}", joint.type_name(), expected)
    limits = joint.position_lower_limit(), joint.position_upper_limit()
    axis = joint.revolute_axis() if isinstance(joint, RevoluteJoint) else joint.translation_axis()
    body.add_joint(
        name=names.joint(joint),
        type=kind,
        pos=on_child.translation(),
        axis=on_child.rotation() @ axis,
        damping=[joint.default_damping(), 0, 0],
        armature=armature,
        limited=np.isfinite(limits).any(),
        range=np.clip(limits, -1e6, 1e6),  # one side may be open
    )


def _add_body(onto: mujoco.MjsBody, link: RigidBody, names: Names, pose: RigidTransform) -> mujoco.MjsBody:
    """Add a body; one that is welded to the world need not have a mass."""
    body = onto.add_body(name=names.body(link))
    body.pos, body.quat = _placed(pose)
    inertia = link.default_spatial_inertia()
    if inertia.get_mass() > 0:
        about_centre = inertia.Shift(inertia.get_com()).CalcRotationalInertia()
        body.mass, body.ipos, body.explicitinertial = inertia.get_mass(), inertia.get_com(), True
        moments = about_centre.get_moments() + _LEAST * (about_centre.CalcPrincipalMomentsOfInertia().min() < _LEAST)
        body.fullinertia = np.concatenate([moments, about_centre.get_products()])
    return body


def _placed(pose: RigidTransform) -> tuple[np.ndarray, np.ndarray]:
    return pose.translation(), pose.rotation().ToQuaternion().wxyz()
