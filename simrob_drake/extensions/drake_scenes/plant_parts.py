"""Robots and pieces in a plant of Drake: groups of bodies, each a tree with one root.

A plant of Drake is a flat list of bodies and joints. Stations, URDF files and SDF files are made of trees. This module
finds the trees. It decides nothing about stations, and works for any finalized plant.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from pydrake.geometry import GeometryId, ProximityProperties, Role, SceneGraph, Shape
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Joint, RigidBody

from simrob_drake.base.errors import SimrobError
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message

MOVING_KINDS = {"revolute": "revolute", "prismatic": "prismatic"}
"""Names of joints that URDF and SDF files have, by Drake's name of the type."""
WORLD_SHAPES = "world_shapes"
"""Name of the piece with the shapes of the world itself."""
_FLOATING_KINDS = ("quaternion_floating", "rpy_floating")
"""Drake's types of the joint between the world and a body that nothing holds."""
_CONTACT_KEYS = {
    "point_contact_stiffness": ("material", "point_contact_stiffness"),
    "hunt_crossley_dissipation": ("material", "hunt_crossley_dissipation"),
    "mesh_resolution_hint": ("hydroelastic", "resolution_hint"),
    "hydroelastic_modulus": ("hydroelastic", "hydroelastic_modulus"),
    "hydroelastic_margin": ("hydroelastic", "margin"),
}
"""PlantGroup and name of a property in the scene graph, by the name that URDF and SDF files have for it."""


@dataclass(frozen=True)
class BodyShape:
    """One shape of a body: what is drawn of it, or what touches others.

    Attributes:
        name: name of the shape, without the name of its model.
        shape: one of Drake's shapes.
        pose: pose in the frame of the link.
        colour: red, green, blue and opacity, 0 to 1. None if the shape is not drawn.
        contact: properties for contact by their names in URDF files, None for a property without a value. The whole
            is None if the shape takes no part in contact.
    """

    name: str
    shape: Shape
    pose: RigidTransform
    colour: tuple[float, ...] | None = None
    contact: dict[str, float | None] | None = None


@dataclass
class GroupLink:
    """A body in a tree.

    Attributes:
        name: name of the link, unique in its group.
        body: name of the body in its model.
        index: index of the body in the plant; -1 for a base that the plant does not have.
        body_pose: pose of the body's frame in the frame of the link.
        mass: mass [kg].
        com: centre of mass in the frame of the link, shape (3,) [m].
        moments: moments of inertia about the centre of mass in the axes of the link, shape (3, 3) [kg m²].
        shapes: shapes of the body.
    """

    name: str
    body: str = ""
    index: int = -1
    body_pose: RigidTransform = field(default_factory=RigidTransform)
    mass: float = 0.0
    com: Vector = field(default_factory=lambda: np.zeros(3))
    moments: Vector = field(default_factory=lambda: np.zeros((3, 3)))
    shapes: list[BodyShape] = field(default_factory=list)


@dataclass
class JointMotor:
    """An actuator of a joint.

    Attributes:
        name: name of the actuator.
        effort: largest torque or force [N·m or N]; infinite if the plant does not limit it.
        rotor_inertia: inertia of the rotor [kg m²].
        gear_ratio: turns of the rotor for one turn of the joint.
    """

    name: str
    effort: float
    rotor_inertia: float
    gear_ratio: float


@dataclass
class Connection:
    """A joint between two links of a group, seen from the root outwards.

    Attributes:
        name: name of the joint, unique in its group.
        model: name of the model instance that the joint belongs to.
        kind: ``fixed``, ``revolute`` or ``prismatic``.
        parent: name of the link nearer to the root.
        child: name of the other link.
        origin: pose of the child link in the parent link if the joint is at 0.
        axis: axis in the child link, shape (3,).
        limits: lower and upper limit of the position [rad or m]; infinite without a limit.
        speed: largest speed [rad/s or m/s]; infinite without a limit.
        acceleration: largest acceleration [rad/s² or m/s²]; infinite without a limit.
        damping: viscous damping [N·m·s/rad or N·s/m].
        motor: its actuator. None if nothing drives the joint.
        start: default position [rad or m].
        inertia: inertia that the joint moves at the start, all other joints at rest [kg m² or kg].
    """

    name: str
    model: str
    kind: str
    parent: str
    child: str
    origin: RigidTransform
    axis: Vector = field(default_factory=lambda: np.array([1.0, 0.0, 0.0]))
    limits: tuple[float, float] = (-np.inf, np.inf)
    speed: float = np.inf
    acceleration: float = np.inf
    damping: float = 0.0
    motor: JointMotor | None = None
    start: float = 0.0
    inertia: float = 0.0

    @property
    def moves(self) -> bool:
        """Whether the joint has a degree of freedom."""
        return self.kind != "fixed"


@dataclass
class PlantGroup:
    """A robot or a piece: bodies that form one tree.

    Attributes:
        name: name of its first model instance, as a plain name.
        models: names of its model instances, as the plant has them.
        pose: pose of the root link in the world at the start.
        is_free: whether nothing holds the root link.
        links: links in the order of the tree, the root first.
        joints: joints in the order of the tree.
    """

    name: str
    models: list[str]
    pose: RigidTransform
    is_free: bool
    links: list[GroupLink] = field(default_factory=list)
    joints: list[Connection] = field(default_factory=list)

    @property
    def moving_joints(self) -> list[Connection]:
        """Joints with a degree of freedom, in the order of the tree."""
        return [joint for joint in self.joints if joint.moves]

    @property
    def is_robot(self) -> bool:
        """Whether a joint of the group moves. A group without such a joint is a piece."""
        return bool(self.moving_joints)

    @property
    def root(self) -> GroupLink:
        """The link that carries all others."""
        return self.links[0]


class UnknownJoint(SimrobError):
    """Raised when a plant has a joint that stations, URDF and SDF files do not have."""


def plant_groups(
    plant: MultibodyPlant, scene_graph: SceneGraph, *, without: frozenset[GeometryId]
) -> list[PlantGroup]:
    """Find the robots and pieces of a plant.

    A body that is welded to the world, or to a body that is, begins a group of its model instance. A body that nothing
    holds begins a group of its own. Every other body belongs to the group of the body that carries it.

    Args:
        plant: a finalized plant.
        scene_graph: scene graph with the shapes of the plant.
        without: shapes that are left out.

    Returns:
        the groups in the order of their first bodies. Shapes of the world itself are a piece ``world_shapes``.

    Raises:
        UnknownJoint: a joint is neither a weld nor revolute nor prismatic nor floating, or bodies form a loop.
    """
    return _Reading(plant, scene_graph, without).groups()


class _Reading:
    """Reads one plant."""

    def __init__(
        self, plant: MultibodyPlant, scene_graph: SceneGraph, without: frozenset[GeometryId]
    ) -> None:
        """Prepare the lookup tables.

        Args:
            plant: a finalized plant.
            scene_graph: scene graph with the shapes of the plant.
            without: shapes that are left out.
        """
        self._plant = plant
        self._inspector = scene_graph.model_inspector()
        self._without = without
        self._context = plant.CreateDefaultContext()
        self._masses = plant.CalcMassMatrix(self._context)
        joints = [plant.get_joint(index) for index in plant.GetJointIndices()]
        self._joints_of = dict[int, list[Joint]]()
        for joint in joints:
            for body in (joint.parent_body(), joint.child_body()):
                self._joints_of.setdefault(int(body.index()), []).append(joint)
        actuators = [plant.get_joint_actuator(index) for index in plant.GetJointActuatorIndices()]
        self._motors = {int(actuator.joint().index()): actuator for actuator in actuators}
        self._groups = dict[str, PlantGroup]()
        # By index of a body: its group, its link, and the pose of the body's frame in the frame of the link.
        self._placed = dict[int, tuple[PlantGroup, GroupLink, RigidTransform]]()

    def groups(self) -> list[PlantGroup]:
        """Walk from the world outwards over all joints, and collect the groups."""
        world = self._plant.world_body()
        self._add_world_shapes(world)
        reached = {int(world.index())}
        used = set[int]()
        waiting = deque([world])
        while waiting:
            body = waiting.popleft()
            for joint in self._joints_of.get(int(body.index()), []):
                if int(joint.index()) in used:
                    continue
                used.add(int(joint.index()))
                is_forward = joint.parent_body().index() == body.index()
                further = joint.child_body() if is_forward else joint.parent_body()
                if int(further.index()) in reached:
                    raise UnknownJoint(
                        message(
                            "drake_scenes.loop_of_joints",
                            "the joint {joint} closes a loop, which a station's robots do not have",
                            joint=repr(joint.name()),
                        )
                    )
                reached.add(int(further.index()))
                self._add_body(body, joint, further, is_forward=is_forward)
                waiting.append(further)
        return list(self._groups.values())

    def _add_body(
        self, body: RigidBody, joint: Joint, further: RigidBody, *, is_forward: bool
    ) -> None:
        """Add the body beyond a joint to the group that it belongs to.

        Args:
            body: body nearer to the world, already in a group unless it is the world.
            joint: joint between the two bodies.
            further: body beyond the joint.
            is_forward: whether `body` is the parent of the joint in the plant.
        """
        carrier = self._placed.get(int(body.index()))
        is_fixed_carrier = carrier is None or not (carrier[0].is_free or carrier[0].is_robot)
        same_model = carrier is not None and body.model_instance() == further.model_instance()
        if is_fixed_carrier and joint.type_name() in _FLOATING_KINDS:
            self._begin_free_group(further)
            return
        if carrier is None or (is_fixed_carrier and not same_model):
            self._begin_held_group(body, joint, further, is_forward=is_forward)
            return
        self._attach(carrier, joint, further, is_forward=is_forward)

    def _begin_free_group(self, body: RigidBody) -> None:
        """Begin the group of a body that nothing holds."""
        pose = self._plant.EvalBodyPoseInWorld(self._context, body)
        group = self._new_group(body, pose, is_free=True)
        self._add_link(group, body, RigidTransform())

    def _begin_held_group(
        self, body: RigidBody, joint: Joint, further: RigidBody, *, is_forward: bool
    ) -> None:
        """Begin the group of a body that is joined to the world or to a fixed piece.

        A joint that moves needs a link of the group that it starts from: a base without mass.

        Args:
            body: body nearer to the world.
            joint: joint between the two bodies.
            further: body beyond the joint.
            is_forward: whether `body` is the parent of the joint in the plant.
        """
        pose_of_body = self._plant.EvalBodyPoseInWorld(self._context, body)
        if joint.num_velocities() == 0:
            pose = self._plant.EvalBodyPoseInWorld(self._context, further)
            group = self._new_group(further, pose, is_free=False)
            self._add_link(group, further, RigidTransform())
            return
        group = self._new_group(further, pose_of_body, is_free=False)
        base = GroupLink(name=_free_name("base", [link.name for link in group.links]))
        group.links.append(base)
        self._attach((group, base, RigidTransform()), joint, further, is_forward=is_forward)

    def _new_group(self, body: RigidBody, pose: RigidTransform, *, is_free: bool) -> PlantGroup:
        """Register a group that begins with a body, under a name that is free."""
        model = self._plant.GetModelInstanceName(body.model_instance())
        name = _free_name(plain_model_name(model, body.name()), list(self._groups))
        group = PlantGroup(name=name, models=[model], pose=pose, is_free=is_free)
        self._groups[name] = group
        return group

    def _attach(
        self,
        carrier: tuple[PlantGroup, GroupLink, RigidTransform],
        joint: Joint,
        body: RigidBody,
        *,
        is_forward: bool,
    ) -> None:
        """Add a body to the group of the body that carries it, with the joint between them.

        The frame of a link that moves must be the frame of its joint, as URDF files have it. Where the frame of the
        body is another one, the link's content is expressed in the joint's frame.

        Args:
            carrier: group, link, and pose of the carrying body's frame in that link.
            joint: joint between the two bodies.
            body: body that is added.
            is_forward: whether the carrier is the parent of the joint in the plant.
        """
        group, link, pose_of_carrier = carrier
        parent_frame = joint.frame_on_parent().GetFixedPoseInBodyFrame()
        child_frame = joint.frame_on_child().GetFixedPoseInBodyFrame()
        start_frame, end_frame = (
            (parent_frame, child_frame) if is_forward else (child_frame, parent_frame)
        )
        kind = "fixed" if joint.num_velocities() == 0 else MOVING_KINDS.get(joint.type_name(), "")
        if not kind:
            raise UnknownJoint(
                message(
                    "drake_scenes.unknown_joint",
                    "the joint {joint} is of the type {kind}; robots have revolute, prismatic and welded joints",
                    joint=repr(joint.name()),
                    kind=joint.type_name(),
                )
            )
        model = self._plant.GetModelInstanceName(joint.model_instance())
        if kind == "fixed":
            between = joint.X_FM() if is_forward else joint.X_FM().inverse()
            origin = pose_of_carrier @ start_frame @ between @ end_frame.inverse()
            own = self._add_link(group, body, RigidTransform())
            name = _free_name(joint.name(), [known.name for known in group.joints], model)
            group.joints.append(
                Connection(name, model, kind, parent=link.name, child=own.name, origin=origin)
            )
            return
        # The link's frame is the joint's frame on this body, so the body's frame is at the inverse of that.
        own = self._add_link(group, body, end_frame.inverse())
        name = _free_name(joint.name(), [known.name for known in group.joints], model)
        connection = Connection(
            name,
            model,
            kind,
            parent=link.name,
            child=own.name,
            origin=pose_of_carrier @ start_frame,
        )
        axis = joint.revolute_axis() if kind == "revolute" else joint.translation_axis()
        # Seen from the other body, a joint moves against its axis.
        connection.axis = np.asarray(axis if is_forward else -axis)
        connection.limits = (
            float(joint.position_lower_limits()[0]),
            float(joint.position_upper_limits()[0]),
        )
        connection.speed = float(joint.velocity_upper_limits()[0])
        connection.acceleration = float(joint.acceleration_upper_limits()[0])
        connection.damping = float(joint.default_damping_vector()[0])
        connection.start = float(joint.default_positions()[0])
        connection.inertia = float(self._masses[joint.velocity_start(), joint.velocity_start()])
        connection.motor = self._motor(joint)
        group.joints.append(connection)

    def _motor(self, joint: Joint) -> JointMotor | None:
        """Describe the actuator of a joint. None if it has none."""
        actuator = self._motors.get(int(joint.index()))
        if actuator is None:
            return None
        return JointMotor(
            name=actuator.name(),
            effort=float(actuator.effort_limit()),
            rotor_inertia=float(actuator.default_rotor_inertia()),
            gear_ratio=float(actuator.default_gear_ratio()),
        )

    def _add_link(self, group: PlantGroup, body: RigidBody, pose: RigidTransform) -> GroupLink:
        """Add a body to a group as a link.

        Args:
            group: the group, which is changed.
            body: the body.
            pose: pose of the body's frame in the frame of the link.
        """
        model = self._plant.GetModelInstanceName(body.model_instance())
        if model not in group.models:
            group.models.append(model)
        name = _free_name(body.name(), [known.name for known in group.links], model)
        link = GroupLink(
            name=name,
            body=body.name(),
            index=int(body.index()),
            body_pose=pose,
            mass=float(body.default_mass()),
        )
        inertia = body.default_spatial_inertia()
        if link.mass > 0:
            com = inertia.get_com()
            about_com = inertia.Shift(com).CalcRotationalInertia().CopyToFullMatrix3()
            turn = pose.rotation().matrix()
            link.com = np.asarray(pose @ com)
            link.moments = turn @ about_com @ turn.T
        link.shapes = list(self._shapes(body, pose))
        group.links.append(link)
        self._placed[int(body.index())] = (group, link, pose)
        return link

    def _add_world_shapes(self, world: RigidBody) -> None:
        """Add the shapes of the world itself as a piece, if there are any."""
        shapes = list(self._shapes(world, RigidTransform()))
        if shapes:
            link = GroupLink(name=WORLD_SHAPES, body=WORLD_SHAPES, shapes=shapes)
            group = PlantGroup(
                WORLD_SHAPES, [WORLD_SHAPES], RigidTransform(), is_free=False, links=[link]
            )
            self._groups[group.name] = group

    def _shapes(self, body: RigidBody, pose: RigidTransform) -> Iterator[BodyShape]:
        """Yield the shapes of a body, those that are drawn first.

        Args:
            body: the body.
            pose: pose of the body's frame in the frame of the link.
        """
        frame = self._plant.GetBodyFrameIdIfExists(body.index())
        if frame is None:
            return
        inspector = self._inspector
        for role in (Role.kIllustration, Role.kProximity):
            for geometry in inspector.GetGeometries(frame, role):
                if geometry in self._without:
                    continue
                shape = BodyShape(
                    name=_last_part(inspector.GetName(geometry)),
                    shape=inspector.GetShape(geometry),
                    pose=pose @ inspector.GetPoseInFrame(geometry),
                )
                if role == Role.kIllustration:
                    yield replace(
                        shape, colour=_colour(inspector.GetIllustrationProperties(geometry))
                    )
                else:
                    yield replace(
                        shape, contact=_contact(inspector.GetProximityProperties(geometry))
                    )


_GREY = (0.6, 0.6, 0.65, 1.0)  # of shapes without a colour of their own, as of pieces


def _colour(properties: Any) -> tuple[float, ...]:
    """Read a shape's colour from its properties for illustration: red, green, blue, opacity."""
    if properties is None or not properties.HasProperty("phong", "diffuse"):
        return _GREY
    rgba = properties.GetProperty("phong", "diffuse")
    return (rgba.r(), rgba.g(), rgba.b(), rgba.a())


def _contact(properties: ProximityProperties) -> dict[str, float | None]:
    """Read a shape's properties for contact, by their names in URDF files."""
    found = dict[str, float | None]()
    for key, (group, name) in _CONTACT_KEYS.items():
        if properties.HasProperty(group, name):
            found[key] = float(properties.GetProperty(group, name))
    if properties.HasProperty("material", "coulomb_friction"):
        friction = properties.GetProperty("material", "coulomb_friction")
        found["mu_static"] = float(friction.static_friction())
        found["mu_dynamic"] = float(friction.dynamic_friction())
    if properties.HasProperty("hydroelastic", "compliance_type"):
        # Python cannot read the type itself. A compliant shape has a finite modulus, and a rigid one has none.
        is_compliant = np.isfinite(found.get("hydroelastic_modulus") or np.inf)
        found["compliant_hydroelastic" if is_compliant else "rigid_hydroelastic"] = None
    return found


def plain_model_name(model: str, body: str = "") -> str:
    """Make a plain name from the name of a model instance: ``camera0::camera`` becomes ``camera0_camera``.

    Models of stations are called ``<name>::<name>``, of which one is enough.

    Args:
        model: name of the model instance.
        body: name of its body, for the default instance of Drake, which has no name of its own.
    """
    parts = list(dict.fromkeys(part for part in model.split("::") if part))
    if parts in (["WorldModelInstance"], ["DefaultModelInstance"]) and body:
        parts = [body]
    name = "_".join(parts)
    plain = "".join(letter if letter.isalnum() or letter in "_-" else "_" for letter in name)
    return plain if plain and not plain[0].isdigit() else f"_{plain}"


def _last_part(name: str) -> str:
    """Name of a shape without the names of the models that it belongs to."""
    return name.rpartition("::")[2]


def _free_name(name: str, taken: list[str], model: str = "") -> str:
    """Make a name that is not taken yet: with the name of its model in front, then with a number.

    Args:
        name: the wanted name.
        taken: names that exist.
        model: name of the model instance. Empty if there is none.
    """
    if name not in taken:
        return name
    longer = f"{plain_model_name(model)}_{name}" if model else name
    candidates = [longer, *(f"{longer}_{number}" for number in range(2, len(taken) + 3))]
    return next(candidate for candidate in candidates if candidate not in taken)
