"""The bodies, joints and shapes of a station's plant, as MJCF has them."""

from pathlib import Path

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
from pydrake.multibody.tree import Joint, JointActuatorIndex, PrismaticJoint, RevoluteJoint, RigidBody, WeldJoint

from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector
from simrob_drake.parts.couplings import Gear
from simrob_drake.parts.site import StationPlant
from simrob_drake.parts.targets import own_name
from simrob_drake.stations.mujoco.coordinates import Names, free_name
from simrob_drake.stations.resolve import ResolvedStation

_LEAST = 1e-9  # MuJoCo takes no body without moments of inertia, as point masses on a link are [kg m²]
_JOINTS = {RevoluteJoint: mujoco.mjtJoint.mjJNT_HINGE, PrismaticJoint: mujoco.mjtJoint.mjJNT_SLIDE}


def add_tree(spec: mujoco.MjSpec, station: StationPlant, names: Names) -> None:
    """Add a finalized plant's bodies and joints, each in its carrier; raises InvalidParameter: a joint MJCF lacks."""
    plant = station.plant
    if plant.num_constraints() or plant.num_force_elements() > 1:  # of which gravity is one
        raise InvalidParameter("robots", "constraints of their files", "left out: MJCF gets a tree of free joints")
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


# A gear is as stiff as MuJoCo can step: its deviation decays within about two steps, without overshoot.
_GEAR_STEPS = 2.0
_GEAR_IMPEDANCE = 0.9999


def add_gears(spec: mujoco.MjSpec, station: ResolvedStation, plant: StationPlant, names: Names) -> None:
    """Add the gears of a station as equality constraints.

    Two axes are coupled directly; more axes by a tendon of constant length: the sum of positions times ratios.
    """
    for name, gear in station.config.couplings.items():
        if not isinstance(gear, Gear):
            continue
        equality = spec.add_equality(name=f"couplings.{name}", active=True)
        equality.solref = [_GEAR_STEPS * spec.option.timestep, 1.0]
        equality.solimp = [_GEAR_IMPEDANCE, _GEAR_IMPEDANCE, 1e-3, 0.5, 2.0]
        coupled = gear.coupled_joints(plant)
        total = gear.constant_sum(plant)
        if len(coupled) == 2:
            first, second = coupled
            equality.type = mujoco.mjtEq.mjEQ_JOINT
            equality.name1 = names.joint(first.joint)
            equality.name2 = names.joint(second.joint)
            equality.data[:5] = [total / first.ratio, -second.ratio / first.ratio, 0.0, 0.0, 0.0]
            continue
        tendon = spec.add_tendon(name=f"couplings.{name}")
        for entry in coupled:
            tendon.wrap_joint(names.joint(entry.joint), entry.ratio)
        # MuJoCo measures the tendon's length from that in its own zero posture, where the sum is 0.
        equality.type = mujoco.mjtEq.mjEQ_TENDON
        equality.name1 = tendon.name
        equality.data[:5] = [total, 0.0, 0.0, 0.0, 0.0]


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
    kind = _JOINTS.get(type(joint))
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


_SEEN = 1  # the group of shapes that are only seen, as viewers of MuJoCo have them; those that touch are of group 3
_TOUCHES = 3
_TRIANGLES = (".obj", ".stl")


def add_shapes(spec: mujoco.MjSpec, station: StationPlant, names: Names, *, seen: bool) -> dict[GeometryId, str]:
    """Add the shapes that touch others, and with ``seen`` the pictures of all bodies; return the names of the former.

    None of them touches by itself: which pairs do is for whoever adds contacts. Raises InvalidParameter: an unknown
    shape.
    """
    inspector, known = station.scene_graph.model_inspector(), dict[GeometryId, str]()
    paired = {shape for pair in touching_pairs(station) for shape in pair}
    for shape in (shape for shape in inspector.GetAllGeometryIds(Role.kProximity) if shape in paired):
        known[shape] = free_name(own_name(inspector, shape), known.values())
        _add_geom(spec, station, names, shape, name=known[shape], group=_TOUCHES, rgba=[0.6, 0.6, 0.6, 0.5])
    for shape in inspector.GetAllGeometryIds(Role.kIllustration) if seen else ():
        file = _file(inspector.GetShape(shape))
        if file is None or file.suffix.lower() in _TRIANGLES:
            look = inspector.GetIllustrationProperties(shape)
            colour = look.GetPropertyOrDefault("phong", "diffuse", Rgba(0.7, 0.7, 0.7, 1.0))
            rgba = [colour.r(), colour.g(), colour.b(), colour.a()]
            _add_geom(spec, station, names, shape, name="", group=_SEEN, rgba=rgba)
    return known


def touching_pairs(station: StationPlant) -> list[tuple[GeometryId, GeometryId]]:
    """Return the pairs of shapes that may touch, by their numbers: one of two at least is moved."""
    inspector, plant = station.scene_graph.model_inspector(), station.plant

    def moves(shape: GeometryId) -> bool:
        return not plant.IsAnchored(plant.GetBodyFromFrameId(inspector.GetFrameId(shape)))

    pairs = [tuple(sorted(pair, key=GeometryId.get_value)) for pair in inspector.GetCollisionCandidates()]
    return sorted((pair for pair in pairs if any(map(moves, pair))), key=lambda pair: [s.get_value() for s in pair])


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
    inspector = station.scene_graph.model_inspector()
    body = station.plant.GetBodyFromFrameId(inspector.GetFrameId(shape))
    onto = spec.worldbody if body is station.plant.world_body() else spec.body(names.body(body))
    pose, form = inspector.GetPoseInFrame(shape), inspector.GetShape(shape)
    geom = onto.add_geom(name=name, group=group, rgba=rgba, contype=0, conaffinity=0, mass=0)
    geom.pos, geom.quat = pose.translation(), pose.rotation().ToQuaternion().wxyz()
    if (file := _file(form)) is not None:
        geom.type, geom.meshname = mujoco.mjtGeom.mjGEOM_MESH, _mesh(spec, file, form.scale3())
        return
    geom.type, size = _primitive(form)
    geom.size = np.resize([*size, 0.0, 0.0], 3)


def _file(shape: Shape) -> Path | None:
    """Return the file of a mesh; None of other shapes."""
    return Path(shape.source().path()) if isinstance(shape, Mesh | Convex) and shape.source().is_path() else None


def _mesh(spec: mujoco.MjSpec, file: Path, scale: Vector) -> str:
    same = [mesh for mesh in spec.meshes if mesh.file == str(file)]
    for mesh in same:
        if np.array_equal(mesh.scale, scale):
            return str(mesh.name)
    name = free_name(file.stem, [mesh.name for mesh in spec.meshes])
    spec.add_mesh(name=name, file=str(file), scale=scale)
    return name


def _primitive(shape: Shape) -> tuple[mujoco.mjtGeom, list[float]]:
    """Return MuJoCo's type and size of a shape."""
    kinds = mujoco.mjtGeom
    match shape:
        case Sphere():
            return kinds.mjGEOM_SPHERE, [shape.radius()]
        case Box():
            return kinds.mjGEOM_BOX, [shape.width() / 2, shape.depth() / 2, shape.height() / 2]
        case Cylinder():
            return kinds.mjGEOM_CYLINDER, [shape.radius(), shape.length() / 2]
        case Capsule():
            return kinds.mjGEOM_CAPSULE, [shape.radius(), shape.length() / 2]
        case Ellipsoid():
            return kinds.mjGEOM_ELLIPSOID, [shape.a(), shape.b(), shape.c()]
        case HalfSpace():
            return kinds.mjGEOM_PLANE, [0.0, 0.0, 1.0]
    raise InvalidParameter("a shape", type(shape).__name__, "a sphere, box, cylinder, capsule, ellipsoid or mesh")
