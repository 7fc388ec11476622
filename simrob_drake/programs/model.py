"""Geometry of a station for its programs: poses of frames, dynamics of robots, distances of bodies. It is not stepped.

A piece has a *parent* on which it is fixed: the world, a robot or another piece. :func:`reparent_piece` makes a station
in which it has another parent (SimRob's PegarEn). The *carrier* of a piece is the robot that carries it, perhaps by way
of other pieces. A *free* piece has no parent: it moves by forces, and a robot can only *hold* it between its fingers.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from itertools import count
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from pydrake.math import RigidTransform
from pydrake.multibody.tree import BodyIndex, Frame, ModelInstanceIndex

from simrob_drake.base.errors import InvalidParameter, Unsuitable, one_of
from simrob_drake.base.frames import (
    PoseLike,
    Vector,
    as_transform,
    finite,
    pose_from_transform,
    transform_from_xyz_quaternion,
    xyz_quaternion_from_transform,
)
from simrob_drake.base.messages import message
from simrob_drake.dynamics import Dynamics
from simrob_drake.kinematics.chain import Chain
from simrob_drake.parts.resolved import WORLD
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.parts.targets import owner_and_robot
from simrob_drake.results.record.state import JointState, State, free_joint
from simrob_drake.robots.pieces import TCP
from simrob_drake.stations.collisions import CollisionPolicy
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.piece_config import PieceConfig
from simrob_drake.stations.posed import PosedStation
from simrob_drake.stations.resolved_pieces import carriers_of, flange, held_pieces, tool_in_use
from simrob_drake.stations.solver_config import ContactConfig, DiscreteSolver

_FLOOR_THICKNESS = 0.1  # thickness of a box that replaces a floor [m]


class _Hold(NamedTuple):
    """A free piece between the fingers of a robot.

    Attributes:
        link: frame of one of the robot's bodies that touch the piece.
        pose: pose of the piece in that frame.
    """

    link: Frame
    pose: RigidTransform


class StationModel(PosedStation):
    """The plant of a station with fixed robot bases, which can be set to any posture.

    Attributes:
        config: the station.
        robots: its robots by name.
    """

    def __init__(self, config: StationConfig, *, collision: bool = False) -> None:
        """Build the plant.

        Args:
            config: the station.
            collision: whether the plant has contact, and with it the collision shapes that :meth:`query` and
                :attr:`policy` need. Links of one robot then collide with each other, too. Otherwise it has shapes only
                if a sensor of the station measures them.

        Raises:
            InvalidModel: a robot or piece cannot be built.
        """
        self.config = config
        # A station without contact gets the default one for checks.
        contact = (config.contact or ContactConfig()) if collision else None
        # Links of one robot must not collide in a plan, even if the station leaves such contacts out.
        if contact is not None:
            contact = contact.model_copy(update={"self_collision": True})
        # In a kinematic station all bases are welded, also those of robots on their own feet.
        super().__init__(config.model_copy(update={"mode": "kinematic", "contact": contact}))
        self.robots: dict[str, StationRobot] = self.station.robots
        # Transform by which a robot on its own feet is away from where it begins, by its model instance. The plant has
        # fixed bases: the poses of its frames are corrected by it.
        self._moved: dict[ModelInstanceIndex, RigidTransform] = {}
        # Pieces between fingers, by the name of the piece.
        self._holds: dict[str, _Hold] = {}
        # By robot, how far its fingers are from their references, shape (n,) [rad or m], see `place_state`.
        self._offsets: dict[str, Vector] = {}

    @cached_property
    def colliding(self) -> "StationModel":
        """The same station with collision shapes."""
        return StationModel(self.config, collision=True)

    @cached_property
    def policy(self) -> CollisionPolicy:
        """Collision policy of the station; this model must have collision shapes."""
        return CollisionPolicy(self)

    @cached_property
    def rigid(self) -> "StationModel":
        """The same station with its free pieces fixed where they begin. Without any, it is this model."""
        if not self.config.free_pieces:
            return self
        # A free piece has joints of its own, which would appear in the equations of motion of the robots.
        pieces = dict(self.config.pieces)
        for name in self.config.free_pieces:
            pieces[name] = pieces[name].model_copy(update={"free": False, "parent": WORLD})
        return StationModel(self.config.model_copy(update={"pieces": pieces}))

    def place_bases(self, state: State | None) -> None:
        """Place the robots that stand on their own feet as in a state.

        Args:
            state: the state. If it is None, or has no such robot, the robots are where they begin.
        """
        self._moved = {}
        for name, robot in self.robots.items():
            joint = self._base_joint(robot)
            if state is not None and self.floats(name) and joint in state.joints:
                # A free joint has the quaternion (w, x, y, z) before the position (x, y, z). The roll by 3 puts the
                # position first.
                now = transform_from_xyz_quaternion(np.roll(state.joints[joint].position, 3))
                self._moved[robot.instance] = now @ robot.base.inverse()

    def place_pieces(self, state: State | None) -> None:
        """Place the free pieces as in a state.

        Args:
            state: the state. If it is None, or has no such piece, the pieces are where they begin.
        """
        for name, body in self.station.free_pieces.items():
            joint = None if state is None else state.joints.get(free_joint(name))
            if joint is not None:
                position = joint.position
            else:
                begin = body.floating_positions_start()
                position = self.initial[begin : begin + 7]
            # From the order of the plant, quaternion and position, to position and quaternion.
            pose = transform_from_xyz_quaternion(np.roll(position, 3))
            self.plant.SetFreeBodyPose(self.context, body, pose)

    def place_state(
        self,
        state: State | None,
        position: Callable[[str], Vector],
        reference: Callable[[str], Vector],
    ) -> None:
        """Place the pieces as in a state, and the axes of robots at their references. Bases of robots stay.

        From now on, pieces that fingers hold in the state move with the robot in :meth:`place_robots`. All fingers are
        placed as far from the positions given there as they are from their references now, because a piece may be
        between them.

        Args:
            state: the state. If it is None, the pieces are where they begin.
            position: function that gives the positions of a robot's axes by its name, shape (n,) [rad or m].
            reference: function that gives their references, shape (n,) [rad or m].
        """
        self._holds = {}
        self._offsets = {}
        self.place_pieces(state)
        # First as everything is now: only there do the fingers touch what they hold.
        self.place_robots({name: position(name) for name in self.robots})
        self._holds = self._find_holds()
        for name, robot in self.robots.items():
            is_finger = np.isin(np.arange(len(robot.axes)), [*robot.model.fingers])
            self._offsets[name] = np.where(is_finger, position(name) - reference(name), 0.0)
        # Plans begin at the references, so collisions are checked from there.
        self.place_robots({name: reference(name) for name in self.robots})

    def place_robots(self, postures: Mapping[str, Vector]) -> None:
        """Place robots in postures (n,) [rad or m] by name, with what their fingers hold. The others stay.

        After :meth:`place_state`, fingers keep their distance from the given positions that they had there.
        """
        super().place_robots(
            {name: posture + self._offsets.get(name, 0.0) for name, posture in postures.items()}
        )
        # A held piece follows the link that touches it, in the same pose relative to that link.
        for name, hold in self._holds.items():
            self.plant.SetFreeBodyPose(
                self.context, self.station.free_pieces[name], self.pose(hold.link) @ hold.pose
            )
        # Setting the pose of a free body does not update the positions that queries use.
        if self._holds:
            self.place(self.plant.GetPositions(self.context))

    def frozen_station(self) -> StationConfig:
        """Make a dynamic station in which nothing but the robots can move, for the optimisation of paths.

        Free pieces are fixed on the link of the finger that holds them, or in the world where they are now. A floor
        without terrain becomes a box, because distances are computed between bodies. References that the station
        prescribes and couplings of axes are left out.
        """
        pieces = dict(self.config.pieces)
        for name, body in self.station.free_pieces.items():
            hold = self._holds.get(name)
            # Parent of the fixed piece, and its pose in the frame of this parent.
            mount: dict[str, Any] = {"parent": WORLD}
            place = self.pose(body.body_frame())
            if hold is not None:
                mount = {"parent": self.holders[name], "frame": hold.link.name()}
                place = hold.pose
            pose = tuple(pose_from_transform(place).tolist())
            pieces[name] = pieces[name].model_copy(update={**mount, "free": False, "pose": pose})
        floor = self.config.floor
        if floor is not None and floor.terrain is None:
            # The surface of the floor is the upper side of the box.
            below = RigidTransform(np.array([0.0, 0.0, -_FLOOR_THICKNESS / 2]))
            floor_pose = self.resolved.ground.floor_pose @ below
            box: Any = {
                "box": (floor.size, floor.size, _FLOOR_THICKNESS),
                "pose": tuple(pose_from_transform(floor_pose).tolist()),
            }
            names = (f"floor_{number}" for number in count())
            unused_name = next(name for name in names if name not in pieces)
            pieces[unused_name] = PieceConfig(parent=WORLD, **box)
            floor = None
        changes: dict[str, Any] = {
            "mode": "dynamic",
            "solver": DiscreteSolver(kind="discrete"),
            "floor": floor,
            "pieces": pieces,
            # With contacts between links of one robot, as this model has them if it has contact.
            "contact": self.resolved.config.contact,
            "prescribed": {},
            "couplings": {},
        }
        return self.config.model_copy(update=changes)

    @property
    def holders(self) -> dict[str, str]:
        """Name of the robot that holds a piece between its fingers, by piece, as :meth:`place_state` has found it."""
        # The usual case comes first, because this property is read in every collision check.
        if not self._holds:
            return {}
        return self._robots_of(self._holds)

    @contextmanager
    def holding_at(self, positions: Vector) -> Iterator[None]:
        """Context in which robots hold what they would hold at positions (nq,) of the plant, see `_find_holds`.

        In the context, :attr:`holders` has these pieces wherever the plant is placed, and so the collision policy lets
        the fingers touch them. At the begin the plant is placed at the positions, and it is not placed back at the end.
        """
        holds_before = self._holds
        self.place(positions)
        self._holds = self._find_holds()
        try:
            yield
        finally:
            self._holds = holds_before

    def gripping_robots(self) -> dict[str, str]:
        """Name of the robot that holds a free piece in the present postures, by piece; see `_find_holds`."""
        return self._robots_of(self._find_holds())

    def _robots_of(self, holds: Mapping[str, _Hold]) -> dict[str, str]:
        """Name of the robot whose link holds each piece, by piece."""
        robots = {station_robot.instance: name for name, station_robot in self.robots.items()}
        return {piece: robots[hold.link.model_instance()] for piece, hold in holds.items()}

    def _find_holds(self) -> dict[str, _Hold]:
        """Find the free pieces that robots hold now, by name: at least two bodies of a robot with fingers touch them.

        All of its links count, not only fingers, and so do the pieces that it carries. The plant needs collision
        shapes, unless no robot has fingers.
        """
        if not any(robot.model.fingers for robot in self.robots.values()):
            return {}
        # By piece and robot: the body of each link or carried piece that touches the piece, by the name of that link or
        # piece.
        touching = dict[tuple[str, str], dict[str, BodyIndex]]()
        inspector = self.station.scene_graph.model_inspector()
        for pair in self.query().ComputePointPairPenetration():
            # Either shape of a pair may be the piece's.
            for piece_shape, link_shape in ((pair.id_A, pair.id_B), (pair.id_B, pair.id_A)):
                piece, _ = owner_and_robot(self.station, piece_shape)
                link, robot = owner_and_robot(self.station, link_shape)
                if piece in self.station.free_pieces and robot and self.robots[robot].model.fingers:
                    body = self.plant.GetBodyFromFrameId(inspector.GetFrameId(link_shape))
                    touching.setdefault((piece, robot), {})[link] = body.index()
        holds = {}
        # One of them only pushes a piece. Two of the same robot hold it between them.
        for (piece, _), bodies in touching.items():
            if len(bodies) > 1:
                link_frame = self.plant.get_body(next(iter(bodies.values()))).body_frame()
                piece_frame = self.station.free_pieces[piece].body_frame()
                holds[piece] = _Hold(
                    link_frame, self.pose(link_frame).inverse() @ self.pose(piece_frame)
                )
        return holds

    def motion(self, piece: str, state: State) -> JointState:
        """Compute position and velocity that a carried piece would have as a free piece.

        Args:
            piece: name of the piece.
            state: state of the station, as this model is placed.

        Returns:
            State of the free joint: quaternion and position; angular [rad/s] and linear velocity [m/s] in the world.
        """
        plant = self.plant
        frame = self.piece_origin(piece)
        carrier = self.resolved.pieces[piece].carrier
        pose = self.pose(frame)
        angular = np.zeros(3)
        linear = np.zeros(3)
        # A piece on the world, or on another piece that no robot carries, is at rest.
        if carrier in self.robots:
            carrier_robot = self.robots[carrier]
            # First the velocity that the axes cause, with the base at rest. The plant's velocities are then set to 0
            # again.
            plant.SetVelocities(
                self.context, carrier_robot.axis_map.spread_velocities(state.velocities[carrier])
            )
            velocity = frame.CalcSpatialVelocityInWorld(self.context)
            plant.SetVelocities(self.context, np.zeros(plant.num_velocities()))
            # The plant has the robot's base where it began: the velocities are turned as the base has turned since.
            turned = self._moved.get(carrier_robot.instance, RigidTransform()).rotation()
            angular = turned @ velocity.rotational()
            linear = turned @ velocity.translational()
            base = (
                state.joints.get(self._base_joint(carrier_robot)) if self.floats(carrier) else None
            )
            if base is not None:
                # A moving base adds its own velocity: v + omega x r. A free joint has the angular velocity before the
                # linear one, and the quaternion (4 numbers) before the position.
                base_angular = base.velocity[:3]
                from_base = pose.translation() - base.position[4:]
                angular = angular + base_angular
                linear = linear + base.velocity[3:] + np.cross(base_angular, from_base)
        # The roll puts the quaternion before the position.
        position = np.roll(xyz_quaternion_from_transform(pose), -3)
        return JointState(position, np.concatenate([angular, linear]))

    def _base_joint(self, robot: StationRobot) -> str:
        """Name in a state of the free joint of a robot's root."""
        # The name that `State` gives to the free joint of a model's root.
        return f"{self.plant.GetModelInstanceName(robot.instance)}/{robot.root.body().name()}"

    def floats(self, robot: str) -> bool:
        """Whether the root of a robot moves freely, such as that of a robot on its own feet."""
        return self.config.engine.moves_by_forces and self.robots[robot].model.base == "floating"

    def pose(self, frame: Frame) -> RigidTransform:
        """Pose of a frame in the world, with robots on their own feet where :meth:`place_bases` has placed them."""
        pose = super().pose(frame)
        # The plant has the base of such a robot where it began: the pose is corrected by how far it has moved.
        moved = self._moved.get(frame.model_instance())
        return pose if moved is None else moved @ pose

    def chain(self, robot: str, tool: Frame, base: Frame | None = None) -> Chain:
        """Chain of a robot's axes, for its kinematics, from a base to a tool.

        Args:
            robot: name of the robot.
            tool: frame of the tool.
            base: frame in which poses of the tool are computed. If it is None, the world.
        """
        station_robot = self.robots[robot]
        return Chain.of_plant(
            self.plant,
            joints=station_robot.joints,
            base=base or self.plant.world_frame(),
            tool=tool,
            signs=station_robot.axis_map.signs,
            names=station_robot.axes,
        )

    def tool_in_use(self, robot: str) -> str:
        """Name of the tool to which a robot's tool centre point belongs: one of its own tools, or a piece.

        It is empty if the robot has none.
        """
        station_robot = self.robots[robot]
        return tool_in_use(
            station_robot.model.tools, station_robot.held, self.config.robots[robot].tcp
        )

    def piece_frame(self, piece: str, frame: str = TCP) -> Frame:
        """Named frame of a piece, by default its tool centre point.

        Raises:
            UnknownName: there is no such piece, or the piece has no such frame.
        """
        one_of(message("base.piece", "piece"), piece, self.config.pieces)
        known = self.resolved.pieces[piece].model.frame_poses
        one_of(message("programs.frame_of_piece", "frame of {piece}", piece=piece), frame, known)
        return self.station.piece_frame(piece, f"{piece}_{frame}")

    def piece_origin(self, piece: str) -> Frame:
        """Frame in which the shapes of a piece are described."""
        return self.station.piece_frame(piece, piece)

    def links(self, robot: str) -> list[str]:
        """Links of a robot that are none of its tools. Pieces can be fixed on them, too."""
        robot_model = self.robots[robot].model
        return [link for link in robot_model.links if link not in robot_model.tools]

    def mount(self, parent: str, frame: str | None = None) -> Frame:
        """Frame of a parent on which pieces are fixed.

        Args:
            parent: ``world``, a robot or a piece.
            frame: frame of a piece, or tool or link of a robot. If it is None, the tool centre point of a piece, or the
                first tool of a robot (its root if it has no tool, or if the first one is a foot). It has no effect for
                the world.

        Raises:
            UnknownName: the parent has no such frame, tool or link.
        """
        if parent in self.config.pieces:
            return self.piece_frame(parent, TCP if frame is None else frame)
        if parent == WORLD:
            return self.plant.world_frame()
        parent_robot = self.robots[parent]
        if frame is not None:
            one_of(
                message("programs.tool_or_link", "tool or link of {parent}", parent=parent),
                frame,
                [*parent_robot.model.tools, *parent_robot.model.links],
            )
        return self.plant.GetFrameByName(
            flange(parent_robot.model.tools, parent_robot.model.root, frame), parent_robot.instance
        )

    def dynamics(self, robot: str) -> Dynamics:
        """Equation of motion of a robot with what it carries, while the other robots are at rest where they are now."""
        station_robot = self.robots[robot]
        return Dynamics(
            station_robot.model,
            self.plant,
            station_robot.joints,
            tool=station_robot.tools.get(station_robot.tcp),
            torque_limit=station_robot.gains.limit_at_rest,
            positions=self.plant.GetPositions(self.context),
        )


def reparent_piece(
    model: StationModel,
    piece: str,
    parent: str,
    *,
    frame: str | None = None,
    pose: PoseLike | None = None,
) -> StationConfig:
    """Make a station in which a piece has another parent. Pieces that are attached to it stay attached.

    The tool centre points of the robots follow: see :func:`_update_tools`.

    Args:
        model: the station as it is now.
        piece: name of the piece.
        parent: ``world``, a robot or another piece.
        frame: frame of the parent piece instead of its tool centre point, or tool or link of the robot instead of its
            first tool.
        pose: pose of the piece in the parent's frame. If it is None, the piece stays where it is in the world.

    Raises:
        UnknownName: there is no such piece, parent or frame.
        Unsuitable: a frame is named for the world.
        InvalidParameter: the parent is the piece itself, or a piece that is fixed on it.
    """
    config = model.config
    one_of(message("base.piece", "piece"), piece, config.pieces)
    if parent != piece:
        parents = [name for name in (WORLD, *config.robots, *config.pieces) if name != piece]
        one_of(message("programs.parent", "parent"), parent, parents)
    if frame is not None and parent == WORLD:
        raise Unsuitable(
            "frame", message("programs.world_without_frames", "the world has no frames")
        )
    _check_no_loop(model, piece, parent)
    # Pose of the piece in the frame of the parent. If none is given, the piece stays where it is: the pose follows from
    # both poses in the world.
    mount = model.pose(model.mount(parent, frame))
    place = (
        mount.inverse() @ model.pose(model.piece_origin(piece))
        if pose is None
        else as_transform(pose)
    )
    entry = config.pieces[piece].model_copy(
        update={
            "parent": parent,
            "frame": frame,
            "free": False,
            "pose": tuple(pose_from_transform(place).tolist()),
        }
    )
    changed = config.model_copy(update={"pieces": {**config.pieces, piece: entry}})
    return _update_tools(model, changed, piece)


def _check_no_loop(model: StationModel, piece: str, parent: str) -> None:
    """Check that a new parent of a piece is not fixed on this piece.

    Raises:
        InvalidParameter: it is fixed on the piece, or is the piece itself.
    """
    # Follow the parents up to the world or a robot: the piece itself must not be among them.
    ancestor = parent
    while ancestor in model.config.pieces:
        if ancestor == piece:
            expected = message(
                "programs.parent_of_piece",
                "the world, a robot, or a piece that is not attached to {piece}",
                piece=piece,
            )
            raise InvalidParameter(
                message("programs.parent_of", "parent of {piece}", piece=piece),
                message("programs.piece_itself", "the piece itself") if parent == piece else parent,
                expected,
            )
        ancestor = model.resolved.pieces[ancestor].parent


def _update_tools(model: StationModel, new: StationConfig, piece: str) -> StationConfig:
    """Update the tool centre points of the robot that gave a piece away and of the robot that took it.

    A robot that holds the piece from now on uses the tool centre point of the piece. A piece that is worn, such as a
    backpack on a trunk or a bottle in this backpack, is no tool: its robot keeps the tool in use.

    A robot loses its tool if this is the piece, or is mounted on the piece. It then uses the held piece on which the
    piece was mounted, else the own tool on which it was mounted, else its first own tool, else none.

    The other robots of the station do not change. Nothing changes if the piece stays with its carrier.

    Args:
        model: the station before.
        new: the station after the change, with the old tool centre points.
        piece: name of the piece.
    """
    old_pieces = model.resolved.pieces
    carriers = carriers_of(new)
    # Each of the two is the name of a robot, or `world`.
    giver = old_pieces[piece].carrier
    taker = carriers[piece]
    if giver == taker:
        return new
    robots = dict(new.robots)
    if giver in robots:
        tool = model.tool_in_use(giver)
        # A tool that is a piece is lost if it has another carrier now. The robot's own tools are not in the mapping.
        lost_its_tool = carriers.get(tool, giver) != giver
        changes: dict[str, Any]
        if lost_its_tool:
            old_parent = old_pieces[piece].parent
            own_tools = model.robots[giver].model.tools
            # A piece on another piece names a frame of that piece instead of a tool.
            frame = model.config.pieces[piece].frame if old_parent == giver else None
            own_tool = frame if frame in own_tools else next(iter(own_tools), None)
            changes = {
                "tcp": old_parent if old_parent in model.robots[giver].held else own_tool,
                "tcp_offset": None,
            }
        else:
            # The same tool, which the new station names even if the old one used it by default.
            changes = {"tcp": tool or None}
        robots[giver] = robots[giver].model_copy(update=changes)
    if taker in robots:
        held = held_pieces(new, carriers, taker, model.robots[taker].model.tools)
        # As above: a tool that stays is named by the new station.
        changes = {"tcp": model.tool_in_use(taker) or None}
        if piece in held:
            changes = {"tcp": piece, "tcp_offset": None}
        robots[taker] = robots[taker].model_copy(update=changes)
    return new.model_copy(update={"robots": robots})


def one_posture(values: npt.ArrayLike, axes: int, name: str) -> Vector:
    """Read a single posture of a user, shape (n,) [rad or m].

    Args:
        values: the posture.
        axes: count n of the axes.
        name: name of the posture for the error message.

    Raises:
        InvalidParameter: the posture has another shape, or numbers that are not finite.
    """
    posture = finite(values)
    if posture.shape != (axes,):
        raise InvalidParameter(
            name,
            values,
            message(
                "programs.a_posture",
                "a posture of {axes} axes, finite numbers [rad or m]",
                axes=axes,
            ),
        )
    return posture
