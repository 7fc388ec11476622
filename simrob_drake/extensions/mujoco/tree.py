"""Bodies, joints, gears and shapes of a station's plant, converted to a MuJoCo model.

The *plant* is Drake's MultibodyPlant of the station. The MuJoCo model is built as an ``MjSpec``. In it, each body is
nested in its *parent*, the body that carries it through a joint. `Names` gives the names of bodies and joints there.
"""

from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
from pydrake.geometry import (
    Box,
    Capsule,
    Convex,
    Cylinder,
    Ellipsoid,
    GeometryId,
    HalfSpace,
    Mesh,
    Rgba,
    Role,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.multibody.tree import (
    Joint,
    JointActuatorIndex,
    PrismaticJoint,
    RevoluteJoint,
    RigidBody,
    WeldJoint,
)

from simrob_drake.base.errors import InvalidParameter, Unsuitable
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.extensions.mujoco.coordinates import Names, free_name
from simrob_drake.parts.couplings import Gear
from simrob_drake.parts.station_plant import StationPlant
from simrob_drake.parts.targets import own_name
from simrob_drake.stations.resolve import ResolvedStation

_LEAST_MOMENT = 1e-9
"""Added to the moments of inertia of a body whose smallest moment is less [kg m²]: MuJoCo refuses point masses."""

_ANY_POSITION = 1e6  # stands for a limit that an axis does not have [rad or m]
_JOINTS = {RevoluteJoint: mujoco.mjtJoint.mjJNT_HINGE, PrismaticJoint: mujoco.mjtJoint.mjJNT_SLIDE}


def add_tree(spec: mujoco.MjSpec, station: StationPlant, names: Names) -> None:
    """Add the bodies and joints of a plant to a MuJoCo model, in which each body contains the bodies that it carries.

    Args:
        spec: the MuJoCo model under construction.
        station: the finalized plant in Drake.
        names: names of the plant's bodies and joints in the MuJoCo model.

    Raises:
        InvalidParameter: the plant has a joint that MuJoCo lacks, or constraints or springs from the robots' files.
    """
    plant = station.plant
    if plant.num_constraints() or plant.num_force_elements() > 1:  # gravity is one force element
        raise Unsuitable(
            "robots",
            message(
                "mujoco.tree_of_free_joints",
                "their files have constraints, and MJCF gets a tree of free joints",
            ),
            message("mujoco.use_other_solver", "use another solver"),
        )
    # Reflected rotor inertias by the index of the joint. Of several actuators of a joint, Drake uses the last one's.
    armatures = {}
    for index in range(plant.num_actuators()):
        motor = plant.get_joint_actuator(JointActuatorIndex(index))
        armatures[motor.joint().index()] = motor.default_reflected_inertia()

    # Breadth first, since MuJoCo needs a body before the bodies that it carries.
    joints = [plant.get_joint(index) for index in plant.GetJointIndices()]
    waiting = [plant.world_body()]
    while waiting:
        parent = waiting.pop(0)
        onto = spec.worldbody if parent is plant.world_body() else spec.body(names.body(parent))
        for joint in joints:
            if joint.parent_body() is parent:
                waiting.append(joint.child_body())
                _add_joint(onto, station, joint, names, armatures.get(joint.index(), 0.0))


_GEAR_STEPS = 2.0
"""Time constant with which the deviation of a gear decays, in steps of MuJoCo: the smallest that is stable."""

_GEAR_DAMPING_RATIO = 1.0  # the deviation decays without overshoot

_GEAR_IMPEDANCE = 0.9999
"""MuJoCo's impedance of a gear, from 0 (no constraint force) to 1 (a hard constraint): the largest that it allows."""


def add_gears(
    spec: mujoco.MjSpec, station: ResolvedStation, plant: StationPlant, names: Names
) -> None:
    """Add the gears of a station to a MuJoCo model, as equality constraints.

    A gear keeps a sum of joint positions q with ratios r constant: r_1 q_1 + r_2 q_2 + ... = c.

    Args:
        spec: the MuJoCo model under construction, which already contains the joints.
        station: the station with the gears.
        plant: its plant in Drake.
        names: names of the plant's joints in the MuJoCo model.
    """
    for name, gear in station.config.couplings.items():
        if not isinstance(gear, Gear):
            continue
        equality = spec.add_equality(name=f"couplings.{name}", active=True)
        equality.solref = [_GEAR_STEPS * spec.option.timestep, _GEAR_DAMPING_RATIO]
        # Equal impedances at both ends make the other three parameters, which blend between them, ineffective.
        equality.solimp = [_GEAR_IMPEDANCE, _GEAR_IMPEDANCE, 1e-3, 0.5, 2.0]
        coupled = gear.coupled_joints(plant)
        total = gear.constant_sum(plant)
        if len(coupled) == 2:
            # Two joints: MuJoCo makes the first a polynomial of the second, q_1 = c / r_1 - (r_2 / r_1) q_2.
            first, second = coupled
            equality.type = mujoco.mjtEq.mjEQ_JOINT
            equality.name1 = names.joint(first.joint)
            equality.name2 = names.joint(second.joint)
            equality.data[:5] = [total / first.ratio, -second.ratio / first.ratio, 0.0, 0.0, 0.0]
        else:
            # More joints: a tendon whose length is the sum. MuJoCo measures its change since the zero posture of the
            # model, where the sum is 0.
            tendon = spec.add_tendon(name=f"couplings.{name}")
            for entry in coupled:
                tendon.wrap_joint(names.joint(entry.joint), entry.ratio)
            equality.type = mujoco.mjtEq.mjEQ_TENDON
            equality.name1 = tendon.name
            equality.data[:5] = [total, 0.0, 0.0, 0.0, 0.0]


def _add_joint(
    onto: mujoco.MjsBody, station: StationPlant, joint: Joint, names: Names, armature: float
) -> None:
    """Add the child body of a joint, and the joint itself, to a body of the MuJoCo model.

    Args:
        onto: MuJoCo's body of the joint's parent.
        station: the plant in Drake.
        joint: the joint. A welded joint only gets the body; a floating body gets MuJoCo's free joint.
        names: names of the plant's bodies and joints in the MuJoCo model.
        armature: rotor inertia that is reflected to the joint [kg m² or kg].

    Raises:
        InvalidParameter: MuJoCo has no such joint.
    """
    link = joint.child_body()
    if link.is_floating_base_body():
        pose = station.plant.GetFreeBodyPose(station.plant.CreateDefaultContext(), link)
        _add_body(onto, link, names, pose).add_freejoint(name=names.joint(joint))
        return
    # At the position 0 the joint's frame on the parent and its frame on the child coincide.
    on_parent = joint.frame_on_parent().GetFixedPoseInBodyFrame()
    on_child = joint.frame_on_child().GetFixedPoseInBodyFrame()
    body = _add_body(onto, link, names, on_parent @ on_child.inverse())
    if isinstance(joint, WeldJoint):
        if not joint.X_FM().IsExactlyIdentity():
            _set_pose(body, on_parent @ joint.X_FM() @ on_child.inverse())
        return
    kind = _JOINTS.get(type(joint))
    if kind is None:
        expected = message(
            "mujoco.types_of_joints",
            "revolute, continuous, prismatic or fixed: MJCF is given no other",
        )
        raise InvalidParameter(
            message("mujoco.joint", "joint {joint}", joint=names.joint(joint)),
            joint.type_name(),
            expected,
        )
    limits = np.array([joint.position_lower_limit(), joint.position_upper_limit()])
    axis = joint.revolute_axis() if isinstance(joint, RevoluteJoint) else joint.translation_axis()
    body.add_joint(
        name=names.joint(joint),
        type=kind,
        pos=on_child.translation(),
        axis=on_child.rotation() @ axis,
        damping=[joint.default_damping(), 0, 0],
        armature=armature,
        limited=np.isfinite(limits).any(),
        # only one of the limits may be infinite
        range=np.clip(limits, -_ANY_POSITION, _ANY_POSITION),
    )


def _add_body(
    onto: mujoco.MjsBody, link: RigidBody, names: Names, pose: RigidTransform
) -> mujoco.MjsBody:
    """Add a body with its mass and inertia to another body of the MuJoCo model, and return it.

    Args:
        onto: the parent.
        link: the body in Drake. It may be without mass if it is welded to the world.
        names: names of the bodies in the MuJoCo model.
        pose: pose of the body in the frame of the parent.
    """
    body = onto.add_body(name=names.body(link))
    _set_pose(body, pose)
    inertia = link.default_spatial_inertia()
    if inertia.get_mass() > 0:
        body.mass = inertia.get_mass()
        body.ipos = inertia.get_com()
        body.explicitinertial = True
        about_centre = inertia.Shift(inertia.get_com()).CalcRotationalInertia()
        is_too_small = about_centre.CalcPrincipalMomentsOfInertia().min() < _LEAST_MOMENT
        moments = about_centre.get_moments() + _LEAST_MOMENT * is_too_small
        body.fullinertia = np.concatenate([moments, about_centre.get_products()])
    return body


def _set_pose(element: mujoco.MjsBody | mujoco.MjsGeom, pose: RigidTransform) -> None:
    """Set the position and the orientation of a body or a shape in the frame of its parent."""
    element.pos = pose.translation()
    element.quat = pose.rotation().ToQuaternion().wxyz()


# Groups of shapes, by which MuJoCo's viewers show or hide them: the usual numbers.
_VISIBLE_GROUP = 1
_COLLISION_GROUP = 3

_MESH_SUFFIXES = (".obj", ".stl")  # formats of meshes that MuJoCo reads


def add_shapes(
    spec: mujoco.MjSpec, station: StationPlant, names: Names, *, seen: bool
) -> dict[GeometryId, str]:
    """Add the shapes of all bodies to a MuJoCo model.

    No shape touches another one by itself: the caller adds contacts for pairs of shapes.

    Args:
        spec: the MuJoCo model, which already contains the bodies.
        station: the plant and its scene graph in Drake.
        names: names of the bodies in the MuJoCo model.
        seen: whether to add the visible shapes, too. Meshes in formats that MuJoCo does not read are left out.

    Returns:
        names of the collision shapes in the MuJoCo model. Shapes that cannot touch anything are not added.

    Raises:
        InvalidParameter: MuJoCo has no such shape.
    """
    inspector = station.scene_graph.model_inspector()
    can_touch = set[GeometryId]()
    for pair in touching_pairs(station):
        can_touch.update(pair)
    shape_names = dict[GeometryId, str]()
    for shape in inspector.GetAllGeometryIds(Role.kProximity):
        if shape in can_touch:
            name = free_name(own_name(inspector, shape), shape_names.values())
            shape_names[shape] = name
            _add_geom(
                spec,
                station,
                names,
                shape,
                name=name,
                group=_COLLISION_GROUP,
                rgba=[0.6, 0.6, 0.6, 0.5],
            )
    if not seen:
        return shape_names
    for shape in inspector.GetAllGeometryIds(Role.kIllustration):
        file = _mesh_file(inspector.GetShape(shape))
        if file is None or file.suffix.lower() in _MESH_SUFFIXES:
            look = inspector.GetIllustrationProperties(shape)
            colour = look.GetPropertyOrDefault("phong", "diffuse", Rgba(0.7, 0.7, 0.7, 1.0))
            rgba = [colour.r(), colour.g(), colour.b(), colour.a()]
            _add_geom(spec, station, names, shape, name="", group=_VISIBLE_GROUP, rgba=rgba)
    return shape_names


def touching_pairs(station: StationPlant) -> list[tuple[GeometryId, GeometryId]]:
    """Pairs of shapes that may touch, in the order of their ids. At least one of the two can move."""
    inspector = station.scene_graph.model_inspector()
    plant = station.plant

    def can_move(shape: GeometryId) -> bool:
        """Whether a shape belongs to a body that is not fixed to the world."""
        return not plant.IsAnchored(plant.GetBodyFromFrameId(inspector.GetFrameId(shape)))

    pairs = []
    for candidates in inspector.GetCollisionCandidates():
        first, second = sorted(candidates, key=GeometryId.get_value)
        if can_move(first) or can_move(second):
            pairs.append((first, second))
    return sorted(pairs, key=lambda pair: (pair[0].get_value(), pair[1].get_value()))


def _add_geom(
    spec: mujoco.MjSpec,
    station: StationPlant,
    names: Names,
    shape: GeometryId,
    *,
    name: str,
    group: int,
    rgba: list[float],
) -> None:
    """Add one shape to its body in the MuJoCo model.

    Args:
        spec: the MuJoCo model, which already contains the body.
        station: the plant and its scene graph in Drake.
        names: names of the bodies in the MuJoCo model.
        shape: the shape in Drake.
        name: name of the shape in the MuJoCo model; an empty text for none.
        group: group of the shape for MuJoCo's viewers.
        rgba: red, green, blue and opacity, each from 0 to 1.
    """
    inspector = station.scene_graph.model_inspector()
    body = station.plant.GetBodyFromFrameId(inspector.GetFrameId(shape))
    onto = spec.worldbody if body is station.plant.world_body() else spec.body(names.body(body))
    # Without mass: the inertia of the body is given. Without contact types: pairs are given, too.
    geom = onto.add_geom(name=name, group=group, rgba=rgba, contype=0, conaffinity=0, mass=0)
    _set_pose(geom, inspector.GetPoseInFrame(shape))
    form = inspector.GetShape(shape)
    file = _mesh_file(form)
    if file is not None:
        geom.type = mujoco.mjtGeom.mjGEOM_MESH
        geom.meshname = _add_mesh(spec, file, form.scale3())
        return
    primitive = _primitive(form)
    geom.type = primitive.type
    geom.size = np.resize([*primitive.size, 0.0, 0.0], 3)


def _mesh_file(shape: Shape) -> Path | None:
    """File of a mesh, or None if the shape is not a mesh with a file."""
    is_mesh = isinstance(shape, Mesh | Convex) and shape.source().is_path()
    return Path(shape.source().path()) if is_mesh else None


def _add_mesh(spec: mujoco.MjSpec, file: Path, scale: Vector) -> str:
    """Add a mesh to the MuJoCo model, unless it has the same file with the same scale already. Returns its name."""
    for mesh in spec.meshes:
        if mesh.file == str(file) and np.array_equal(mesh.scale, scale):
            return str(mesh.name)
    name = free_name(file.stem, [mesh.name for mesh in spec.meshes])
    spec.add_mesh(name=name, file=str(file), scale=scale)
    return name


class _Primitive(NamedTuple):
    """A shape that is no mesh, as MuJoCo describes it."""

    type: mujoco.mjtGeom
    size: list[float]  # one to three lengths [m], with a meaning that depends on the type


def _primitive(shape: Shape) -> _Primitive:
    """Describe a shape as MuJoCo does, which counts half the lengths of boxes, cylinders and capsules.

    Raises:
        InvalidParameter: MuJoCo has no such shape.
    """
    kinds = mujoco.mjtGeom
    match shape:
        case Sphere():
            return _Primitive(kinds.mjGEOM_SPHERE, [shape.radius()])
        case Box():
            return _Primitive(
                kinds.mjGEOM_BOX, [shape.width() / 2, shape.depth() / 2, shape.height() / 2]
            )
        case Cylinder():
            return _Primitive(kinds.mjGEOM_CYLINDER, [shape.radius(), shape.length() / 2])
        case Capsule():
            return _Primitive(kinds.mjGEOM_CAPSULE, [shape.radius(), shape.length() / 2])
        case Ellipsoid():
            return _Primitive(kinds.mjGEOM_ELLIPSOID, [shape.a(), shape.b(), shape.c()])
        case HalfSpace():
            # An infinite plane; the third number is only the spacing of its grid in a viewer.
            return _Primitive(kinds.mjGEOM_PLANE, [0.0, 0.0, 1.0])
    raise InvalidParameter(
        message("mujoco.a_shape", "a shape"),
        type(shape).__name__,
        message("mujoco.shapes_of_mjcf", "a sphere, box, cylinder, capsule, ellipsoid or mesh"),
    )
