"""Clearance of the robots in a station that is never simulated, and how the robots stand on the ground.

The station is only posed: its robots are set to positions, and geometry is measured. A posture is a vector with the
positions of one robot's n axes, in rad or m. A robot stands on its lowest points, the contacts: of the shapes of its
feet if its description has feet, otherwise of all its collision shapes. The support area is the convex hull of these
points, seen from above.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, JacobianWrtVariable, RigidBody
from pydrake.systems.framework import Context

from simrob_drake.base.frames import Vector
from simrob_drake.parts.station_plant import StationPlant, StationRobot
from simrob_drake.parts.targets import FLOOR
from simrob_drake.robots.outlines import lowest_points, shape_corners, shape_outline
from simrob_drake.stations.collisions import START_TOLERANCE, CollisionPolicy, Overlap
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.posed import PosedStation
from simrob_drake.stations.solver_config import ContactConfig

_TOUCHING = 1e-3
"""Height above the lowest point up to which points carry as well [m]: contacts and servos give way by as much."""

KNEELING = 0.25
"""A link that carries nearer to its joint than this part of its length kneels. Heels are at 0.3 and more."""

_EVEN = 1e-4
"""Weight of sharing the load evenly, where there are more contacts than equations."""


@dataclass(frozen=True)
class Standing:
    """A robot at rest on the ground.

    Attributes:
        mass: mass of the robot with the pieces that it carries [kg].
        gap: height of the lowest point over the ground [m]; negative if the point is below the ground.
        contacts: count of the points that carry.
        margin: distance of the centre of mass, seen from above, from the nearest side of the support area [m]. It is
            negative outside of the area, where the line of the side that it is farthest beyond counts, also next to a
            corner. It is zero if the points span no area.
        height: height of the centre of mass over the lowest point [m].
        torque: torques of the joints that hold the robot against gravity, shape (n,) [N·m or N].
        carrying_links: for each link that carries, by name, the smallest distance between its contacts and its joint as
            a part of the link's length: 1 at its far end, near 0 at a knee. It is 1 for the root link, which has no
            joint, and for a link without shapes, which has no length.
    """

    mass: float
    gap: float
    contacts: int
    margin: float
    height: float
    torque: Vector
    carrying_links: Mapping[str, float]


class ShapePoints(NamedTuple):
    """The lowest points of one collision shape.

    Attributes:
        body: the body to which the shape belongs.
        points: the points in the world, shape (k, 3) [m].
    """

    body: RigidBody
    points: Vector


class SupportPoints(NamedTuple):
    """Points on which a robot may stand.

    Attributes:
        frame: frame of the link to which the points belong.
        points: the points in the world, shape (k, 3) [m].
    """

    frame: Frame
    points: Vector


class StandingContact(NamedTuple):
    """A point on which a robot stands.

    Attributes:
        frame: frame of the link to which the point belongs.
        point: the point in the world, shape (3,) [m].
    """

    frame: Frame
    point: Vector


class BodyChain(NamedTuple):
    """The axes that move one body of a robot.

    Attributes:
        body: the body.
        axes: indices of the axes between the root link and the body, from the root outward.
    """

    body: RigidBody
    axes: list[int]


def standing(
    station: StationPlant,
    robot: StationRobot,
    context: Context | None = None,
) -> Standing | None:
    """Compute how a robot stands on the lowest points of its feet or, if it has no feet, of its collision shapes.

    Args:
        station: the plant with the robot, and the ground.
        robot: the robot.
        context: context of the plant with the robot's positions, or None for the positions at the start.

    Returns:
        how the robot stands, or None if it has neither feet nor collision shapes.
    """
    plant = station.plant
    if context is None:
        context = plant.CreateDefaultContext()
    candidates = _support_points(station, robot, context)
    if not candidates:
        return None
    # The points of all links in one array, and the frame of the link for each point.
    points = np.vstack([support.points for support in candidates])
    frames = [support.frame for support in candidates for _ in support.points]
    # Heights are measured from the ground below each point, since a terrain or an incline is not level.
    heights = points[:, 2] - station.ground.beneath(points)
    gap = float(heights.min())
    # Only the lowest points carry. These are their indices.
    carrying = np.flatnonzero(heights <= gap + _TOUCHING).tolist()
    contacts = [StandingContact(frames[index], points[index]) for index in carrying]

    mass = plant.CalcTotalMass(context, [robot.instance])
    # Pieces that the robot carries are parts of its model instance, so that their masses count.
    com = plant.CalcCenterOfMassPositionInWorld(context, [robot.instance])
    contact_points = points[carrying]
    return Standing(
        mass=mass,
        gap=gap,
        contacts=len(contacts),
        margin=_margin(contact_points[:, :2], com[:2]),
        height=float(com[2] - contact_points[:, 2].min()),
        torque=_holding_torque(plant, robot, context, contacts),
        carrying_links=_contact_distances(station, robot, context, contacts),
    )


def shape_points(
    station: StationPlant,
    robot: StationRobot,
    context: Context,
) -> list[ShapePoints]:
    """Find points of each collision shape of a robot in the world, among them the lowest with respect to the floor.

    The floor may be inclined: heights are measured along its normal. A ball has one such point; of a box and a mesh all
    corners are found.

    Args:
        station: the plant with the robot, and the ground.
        robot: the robot. The pieces that it carries are included.
        context: context of the plant with the robot's positions.

    Returns:
        the points of each shape, with the shape's body; empty if the robot has no shapes.
    """
    plant = station.plant
    inspector = station.scene_graph.model_inspector()
    floor_pose = station.ground.floor_pose  # in the world
    world_in_floor = floor_pose.inverse()
    found = []
    for body in map(plant.get_body, plant.GetBodyIndices(robot.instance)):
        for shape in station.shapes_of_body(body):
            pose_in_floor = (
                world_in_floor
                @ plant.EvalBodyPoseInWorld(context, body)
                @ inspector.GetPoseInFrame(shape)
            )
            points_in_floor = lowest_points(
                inspector.GetShape(shape), pose_in_floor, shape_corners(inspector, shape)
            )
            in_world = np.asarray((floor_pose @ points_in_floor.T).T)
            found.append(ShapePoints(body, in_world))
    return found


def _support_points(
    station: StationPlant,
    robot: StationRobot,
    context: Context,
) -> list[SupportPoints]:
    """Find the points on which a robot may stand: the lowest points of its feet or, if it has none, of all its shapes.

    Args:
        station: the plant with the robot, and the ground.
        robot: the robot.
        context: context of the plant with the robot's positions.

    Returns:
        an entry for each foot or collision shape, with its points in the world; empty without feet and shapes.
    """
    if robot.feet is None:
        shapes = shape_points(station, robot, context)
        return [SupportPoints(shape.body.body_frame(), shape.points) for shape in shapes]
    floor_pose = station.ground.floor_pose  # in the world
    found = []
    for link in robot.feet.links:
        frame = station.plant.GetFrameByName(link, robot.instance)
        pose_in_floor = floor_pose.inverse() @ frame.CalcPoseInWorld(context)
        # The description of the feet takes several poses (m, 4, 4); here there is one.
        points_in_floor = robot.feet.lowest_points(link, pose_in_floor.GetAsMatrix4()[np.newaxis])[
            0
        ]
        in_world = np.asarray((floor_pose @ points_in_floor.T).T)
        found.append(SupportPoints(frame, in_world))
    return found


def outline(station: StationPlant, body: RigidBody) -> Vector:
    """Collect points that represent the extent of all collision shapes of a body.

    Returns:
        the corners of each shape or, of a curved shape, its outermost points in 26 directions, in the frame of the
        body, shape (k, 3) [m]. If the body has no shapes, k is 0.
    """
    inspector = station.scene_graph.model_inspector()
    outlines = [shape_outline(inspector, shape) for shape in station.shapes_of_body(body)]
    # The empty array gives a body without shapes a result of the right shape.
    return np.vstack([np.zeros((0, 3)), *outlines])


def _contact_distances(
    station: StationPlant,
    robot: StationRobot,
    context: Context,
    contacts: Collection[StandingContact],
) -> dict[str, float]:
    """Compute for each link with contacts their smallest distance from its joint, as a part of the link's length.

    The length is the distance of the farthest point of the body's shapes from the body's joint; a body has the shapes
    of all links that are fixed together. The root link, and a link without shapes, get 1. The result, by the name of
    the link, is `Standing.carrying_links`.
    """
    by_link: dict[str, list[StandingContact]] = {}
    for contact in contacts:
        by_link.setdefault(contact.frame.name(), []).append(contact)
    distances = {}
    for link, on_link in by_link.items():
        frame = on_link[0].frame
        length = np.linalg.norm(outline(station, frame.body()), axis=1).max(initial=0.0)
        is_root = frame.body().index() == robot.root.body().index()
        if is_root or length == 0:
            distances[link] = 1.0
            continue
        # The origin of a link's frame is at its joint. A foot that is fixed to another link has a frame of its own on
        # the body of that link, and its contacts are measured from there.
        joint_position = frame.CalcPoseInWorld(context).translation()
        points = np.array([contact.point for contact in on_link])
        nearest = np.linalg.norm(points - joint_position, axis=1).min()
        distances[link] = float(nearest / length)
    return distances


def _holding_torque(
    plant: MultibodyPlant,
    robot: StationRobot,
    context: Context,
    contacts: Collection[StandingContact],
) -> Vector:
    """Compute the torques with which the joints hold a robot that stands at rest, shape (n,) [N·m or N].

    The k contacts (at least one) push upward, with the forces f (k,). With their vertical Jacobian J (k, nv) and the
    generalized forces g (nv,) of gravity, statics demands -(g + J' f) of the joints. Of these nv values, the result has
    those of the robot's axes.
    """
    points = np.array([contact.point for contact in contacts])
    mass = plant.CalcTotalMass(context, [robot.instance])
    com = plant.CalcCenterOfMassPositionInWorld(context, [robot.instance])
    weight = mass * float(np.linalg.norm(plant.gravity_field().gravity_vector()))
    forces = _vertical_forces(points, com, weight)
    jacobians = np.array([_vertical_jacobian(plant, context, contact) for contact in contacts])
    from_contacts = np.einsum("kv,k->v", jacobians, forces)
    generalized = plant.CalcGravityGeneralizedForces(context) + from_contacts
    return np.asarray(-robot.axis_map.efforts(generalized))


def _vertical_jacobian(
    plant: MultibodyPlant,
    context: Context,
    contact: StandingContact,
) -> Vector:
    """Compute the derivative of a contact's vertical velocity by the plant's velocities, shape (nv,).

    An upward force at the contact, times this row, gives its generalized forces.
    """
    frame = contact.frame
    in_frame = frame.CalcPoseInWorld(context).inverse() @ contact.point
    world = plant.world_frame()
    jacobian = plant.CalcJacobianTranslationalVelocity(
        context, JacobianWrtVariable.kV, frame, in_frame, world, world
    )
    return np.asarray(jacobian[2])


def _vertical_forces(points: Vector, com: Vector, weight: float) -> Vector:
    """Share the weight among contacts, as evenly as the balance of moments about the centre of mass allows.

    If the centre of mass is outside of the support area, there is no balance: the shares are the nearest to it, and
    their sum may differ from the weight.

    Args:
        points: positions of the k contacts in the world, shape (k, 3) [m].
        com: centre of mass in the world, shape (3,) [m].
        weight: weight of the robot [N].

    Returns:
        upward force on each contact, shape (k,) [N], none of them negative.
    """
    # Loaded here, so that importing the package stays quick.
    from scipy.optimize import nnls

    # Least squares for the shares x >= 0: sum of x = 1, sum of x times lever arm = 0, and weakly: x = 0. The last
    # equations make the shares even where the first ones leave several solutions.
    arms = points[:, :2] - com[:2]
    balance = np.vstack([np.ones(len(points)), arms.T])
    equations = np.vstack([balance, _EVEN * np.eye(len(points))])
    right_sides = np.concatenate([[1.0, 0.0, 0.0], np.zeros(len(points))])
    shares, _ = nnls(equations, right_sides)
    return np.asarray(weight * shares)


def _margin(points: Vector, com: Vector) -> float:
    """Compute how far inside of a support area the centre of mass is, seen from above [m].

    Args:
        points: contacts, shape (k, 2) [m]. The support area is their convex hull.
        com: centre of mass, shape (2,) [m].

    Returns:
        the distance from the nearest side, or 0 if the points span no area. Outside of the area it is minus the largest
        distance beyond the line of a side, which next to a corner is less than the distance from the area.
    """
    from scipy.spatial import ConvexHull, QhullError

    try:
        sides = ConvexHull(points).equations
    except (QhullError, ValueError):  # fewer than three points, or all in a line
        return 0.0
    # Each side has a unit normal that points outward, and an offset: the distance outward is normal · com + offset.
    outward_distances = sides[:, :2] @ com + sides[:, 2]
    return float(-outward_distances.max())


TURNS = (15.0, -15.0, 30.0, -30.0, 60.0, -60.0, 90.0, -90.0)
"""Angles by which a revolute axis is moved to see whether another posture is better [deg]."""

SLIDES = (0.1, 0.2, 0.4)
"""Distances by which a prismatic axis is moved to see whether another posture is better [m]. All are positive, unlike
`TURNS`: an axis is only moved towards its upper limit."""

_MOST_STEPS = 10  # largest count of axis moves that reduce overlaps


class Clearance(PosedStation):
    """A posed station with collision shapes: which bodies collide, and how high they are.

    Attributes:
        config: the station.
        policy: decides which bodies collide.
    """

    def __init__(self, config: StationConfig, *, trusts_home: bool = True) -> None:
        """Build the station in its initial configuration.

        Args:
            config: the station.
            trusts_home: whether links of a robot that touch in its home posture never count as a collision. False if
                the home posture itself is judged.

        Raises:
            SimrobError: the station has a defect, such as a robot that cannot be built.
        """
        self.config = config
        # Without a contact section the plant would have no collision shapes, and without self_collision Drake would not
        # report overlaps within one robot.
        contact = config.contact or ContactConfig()
        contact = contact.model_copy(update={"self_collision": True})
        super().__init__(config.model_copy(update={"contact": contact}))
        self.policy = CollisionPolicy(self, trusts_home=trusts_home)
        # Depth [m] of each pair of bodies that touches slightly at the start and does not belong to one robot. A
        # piece that stands on a table always overlaps it a little, which is no collision.
        overlaps_at_start = self.policy.touching(refined_from=START_TOLERANCE)
        self._depths_at_start = {
            bodies: overlap.depth
            for bodies, overlap in overlaps_at_start.items()
            if overlap.is_between_owners and overlap.depth <= START_TOLERANCE
        }

    def lowest(self, robot: StationRobot) -> dict[str, float]:
        """Smallest height of the points of each body above the ground beneath each of them [m], by the body's name.

        On terrain it need not be that of the lowest point. A body includes the links that are fixed to it, and the
        pieces that it carries. Bodies without collision shapes are left out. A height is negative below the ground.
        """
        heights: dict[str, float] = {}
        for body, points in shape_points(self.station, robot, self.context):
            name = body.name()
            height = float((points[:, 2] - self.station.ground.beneath(points)).min())
            heights[name] = min(height, heights.get(name, height))
        return heights

    def chains(self, robot: StationRobot) -> list[BodyChain]:
        """Find the axes that move each body of a robot, in the order in which the plant has the bodies.

        The root link has no axes. Links on fixed joints, and carried pieces, are parts of the body that they are on.
        """
        # The axis that moves each body directly, by the body's index.
        axis_of_body = {joint.child_body().index(): axis for axis, joint in enumerate(robot.joints)}
        chains = []
        for index in self.plant.GetBodyIndices(robot.instance):
            axes = list[int]()
            inboard = index  # the body itself, then the bodies between it and the root
            while inboard in axis_of_body:
                axis = axis_of_body[inboard]
                # The search goes from the body inward, the result from the root outward.
                axes.insert(0, axis)
                inboard = robot.joints[axis].parent_body().index()
            chains.append(BodyChain(self.plant.get_body(index), axes))
        return chains

    def overlaps(self) -> list[Overlap]:
        """Find the collisions in the present posture, except those with the floor; the deepest first.

        Bodies that do not belong to the same robot and touch at the start already, by at most
        START_TOLERANCE, may overlap by that depth plus the usual tolerance.
        """
        collisions = self.policy.overlaps(depths_at_start=self._depths_at_start)
        return [overlap for overlap in collisions if FLOOR not in overlap.bodies]

    def own_overlaps(self, robot: StationRobot, posture: Vector) -> list[Overlap]:
        """Set a robot to a posture (n,) [rad or m] and find its collisions with itself, the deepest first.

        The pieces that it carries are parts of it.
        """
        self.place_robots({robot.name: posture})
        return [overlap for overlap in self.overlaps() if overlap.robot == robot.name]


def neighbouring_postures(
    robot: StationRobot,
    posture: Vector,
    axes: Iterable[int],
) -> Iterator[Vector]:
    """Yield postures that differ from a posture in one axis, by one of TURNS or SLIDES. The posture itself is left out.

    Axes that a coupling moves along (followers) keep their positions.

    Args:
        robot: the robot; postures with the changed axis beyond a limit are left out.
        posture: positions of the n axes, shape (n,) [rad or m].
        axes: indices of the axes that may differ.
    """
    lower, upper = robot.model.axis_limits
    for axis in axes:
        steps = SLIDES if robot.model.prismatic[axis] else np.deg2rad(TURNS)
        for step in steps:
            neighbour = posture.copy()
            neighbour[axis] += step
            # Postures beyond a limit are no neighbours: they are left out, not clamped, as clamped ones would repeat.
            if lower[axis] <= neighbour[axis] <= upper[axis]:
                yield neighbour


def reduce_own_overlaps(
    clearance: Clearance,
    robot: StationRobot,
    posture: Vector,
    axes: Collection[int],
) -> Vector:
    """Find a posture in which the links of a robot overlap less, by moving one axis at a time.

    Each step takes the move that reduces the overlaps most. Only the axes between the two links that overlap most are
    tried, since no other axis changes their overlap. An overlap of a carried piece or of the base is reduced only by
    the axes of the other link. Axes that a coupling moves along with their leaders (followers) are not taken along.

    Args:
        clearance: the station with the robot; the robot's posture is changed.
        robot: the robot.
        posture: the first posture, shape (n,) [rad or m].
        axes: indices of the axes that may move.

    Returns:
        the posture with the smallest overlaps that was found, shape (n,) [rad or m].
    """
    # Overlaps name bodies with the prefix of their robot, chains name them without.
    axes_of_link = {
        f"{robot.prefix}{body.name()}": set(chain) for body, chain in clearance.chains(robot)
    }

    def total_depth(tried: Vector) -> float:
        """Sum of the depths of all overlaps of the robot with itself in a posture (n,) [m]."""
        return sum(overlap.depth for overlap in clearance.own_overlaps(robot, tried))

    for _ in range(_MOST_STEPS):
        overlaps = clearance.own_overlaps(robot, posture)
        if not overlaps:
            break
        first, second = overlaps[0].bodies
        # The symmetric difference (^): an axis that moves both links does not change their overlap. Pieces that the
        # robot carries have no entry: all axes of the other link are tried.
        between = axes_of_link.get(first, set()) ^ axes_of_link.get(second, set())
        tried = [posture, *neighbouring_postures(robot, posture, sorted(between & set(axes)))]
        best = min(tried, key=total_depth)
        if best is posture:
            break
        posture = best
    return posture
