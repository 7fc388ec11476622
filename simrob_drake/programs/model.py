"""A station as its programs see it: where frames are, what it weighs, what is near what. It is never stepped.

Pieces change hands in it (SimRob's PegarEn): another parent, the same place in the world.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from itertools import count
from typing import Any

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
from simrob_drake.stations.resolve import carriers_of, flange, tool_in_use
from simrob_drake.stations.solver_config import ContactConfig, DiscreteSolver

_THICK = 0.1  # m, of a floor that is a box


class StationModel(PosedStation):
    """The plant of a station with fixed robot bases, which can be set to any posture.

    Attributes:
        config: the station.
        robots: by name.
    """

    def __init__(self, config: StationConfig, *, collision: bool = False) -> None:
        """Build the plant.

        Args:
            config: the station.
            collision: whether the plant has collision shapes, which :meth:`query` and
                :attr:`policy` need. Links of one robot then collide with each other, too.

        Raises:
            InvalidModel: a robot or piece cannot be built.
        """
        self.config = config
        contact = (config.contact or ContactConfig()) if collision else None
        if contact is not None:
            contact = contact.model_copy(update={"self_collision": True})
        super().__init__(config.model_copy(update={"mode": "kinematic", "contact": contact}))
        self.robots: dict[str, StationRobot] = self.station.robots
        self._moved: dict[ModelInstanceIndex, RigidTransform] = {}
        self._held: dict[str, tuple[Frame, RigidTransform]] = {}
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
        """The same station, its free pieces fixed where they begin; itself if there are none."""
        free = {name: self.config.pieces[name] for name in self.config.free_pieces}
        fixed = {name: piece.model_copy(update={"free": False, "parent": WORLD}) for name, piece in free.items()}
        pieces = {**self.config.pieces, **fixed}
        return StationModel(self.config.model_copy(update={"pieces": pieces})) if fixed else self

    def place_bases(self, state: State | None) -> None:
        """Put robots that stand on their own feet where they are in a state, or where they begin if it is None."""
        self._moved = {}
        for name, robot in self.robots.items():
            joint = self._base_joint(robot)
            if state is not None and self.floats(name) and joint in state.joints:
                now = transform_from_xyz_quaternion(np.roll(state.joints[joint].position, 3))  # w x y z first there
                self._moved[robot.instance] = now @ robot.base.inverse()

    def place_pieces(self, state: State | None) -> None:
        """Put free pieces where they are in a state, or leave them where they begin."""
        for name, body in self.station.free_pieces.items():
            joint = None if state is None else state.joints.get(free_joint(name))
            if joint is not None:
                pose = transform_from_xyz_quaternion(np.roll(joint.position, 3))
            else:
                begin = body.floating_positions_start()
                pose = transform_from_xyz_quaternion(np.roll(self.initial[begin : begin + 7], 3))
            self.plant.SetFreeBodyPose(self.context, body, pose)

    def place_state(
        self, state: State | None, position: Callable[[str], Vector], reference: Callable[[str], Vector]
    ) -> None:
        """Put pieces where they are in a state, and robots where they should be in it, of each told (n,) [rad or m].

        What fingers hold in the state goes along from now on, and they stay as far from their references as they are:
        what they press on is between them.
        """
        self._held, self._offsets = {}, {}
        self.place_pieces(state)
        self.place_robots({name: position(name) for name in self.robots})
        self._held = self._gripped()
        for name, robot in self.robots.items():
            fingers = np.isin(np.arange(len(robot.axes)), [*robot.model.fingers])
            self._offsets[name] = np.where(fingers, position(name) - reference(name), 0.0)
        self.place_robots({name: reference(name) for name in self.robots})

    def place_robots(self, postures: Mapping[str, Vector]) -> None:
        """Put robots into postures (n,) [rad or m], with what their fingers hold; the others stay."""
        super().place_robots({name: posture + self._offsets.get(name, 0.0) for name, posture in postures.items()})
        for name, (link, pose) in self._held.items():
            self.plant.SetFreeBodyPose(self.context, self.station.free_pieces[name], self.pose(link) @ pose)
        if self._held:
            self.place(self.plant.GetPositions(self.context))

    def frozen(self) -> StationConfig:
        """Return the station moved by forces, as it is now: free pieces on what holds them, its floor a box."""
        pieces, floor = dict(self.config.pieces), self.config.floor
        for name, body in self.station.free_pieces.items():
            link, place = self._held.get(name, (None, self.pose(body.body_frame())))
            on = {"parent": WORLD} if link is None else {"parent": self.holders[name], "frame": link.name()}
            pose = tuple(pose_from_transform(place).tolist())
            pieces[name] = pieces[name].model_copy(update={**on, "free": False, "pose": pose})
        if floor is not None and floor.terrain is None:
            pose = self.resolved.ground.floor_pose @ RigidTransform(np.array([0.0, 0.0, -_THICK / 2]))
            box: Any = {"box": (floor.size, floor.size, _THICK), "pose": tuple(pose_from_transform(pose).tolist())}
            pieces[next(name for number in count() if (name := f"floor_{number}") not in pieces)] = PieceConfig(
                parent=WORLD, **box
            )
            floor = None
        changes: dict[str, Any] = {"mode": "dynamic", "solver": DiscreteSolver(kind="discrete"), "floor": floor}
        changes |= {"pieces": pieces, "contact": self.resolved.config.contact, "prescribed": {}, "couplings": {}}
        return self.config.model_copy(update=changes)

    @property
    def holders(self) -> dict[str, str]:
        """Name of the robot whose fingers hold a piece, for each piece that is held."""
        if not self._held:  # the usual case, and this property is read in every collision check
            return {}
        return self._robots_of(self._held)

    @contextmanager
    def holding_at(self, positions: Vector) -> Iterator[None]:
        """Context in which robots hold what their fingers touch from two sides at positions (nq,) of the plant.

        In the context, :attr:`holders` and so the collision policy say so, wherever the plant is placed.
        """
        before = self._held
        self.place(positions)
        self._held = self._gripped()
        try:
            yield
        finally:
            self._held = before

    def gripping_robots(self) -> dict[str, str]:
        """Name of the robot whose fingers touch a free piece from two sides in the present postures, by piece."""
        return self._robots_of(self._gripped())

    def _robots_of(self, held: Mapping[str, tuple[Frame, RigidTransform]]) -> dict[str, str]:
        """Name of the robot that each held piece's link belongs to, by piece.

        Args:
            held: by piece, the link that holds it and its pose in that link's frame.
        """
        robots = {own.instance: name for name, own in self.robots.items()}
        return {piece: robots[link.model_instance()] for piece, (link, _) in held.items()}

    def _gripped(self) -> dict[str, tuple[Frame, RigidTransform]]:
        """Return the free pieces that two links of a robot with fingers touch now: one link, and where in it."""
        if not any(robot.model.fingers for robot in self.robots.values()):
            return {}
        links: dict[tuple[str, str], dict[str, BodyIndex]] = {}
        frames = self.station.scene_graph.model_inspector()
        for pair in self.query().ComputePointPairPenetration():
            for piece, link in ((pair.id_A, pair.id_B), (pair.id_B, pair.id_A)):
                (name, _), (own, robot) = (owner_and_robot(self.station, shape) for shape in (piece, link))
                if name in self.station.free_pieces and robot and self.robots[robot].model.fingers:
                    body = self.plant.GetBodyFromFrameId(frames.GetFrameId(link))
                    links.setdefault((name, robot), {})[own] = body.index()
        held = {}
        for (name, _), touching in links.items():
            if len(touching) > 1:
                link = self.plant.get_body(next(iter(touching.values()))).body_frame()
                held[name] = link, self.pose(link).inverse() @ self.pose(self.station.free_pieces[name].body_frame())
        return held

    def motion(self, piece: str, state: State) -> JointState:
        """Return where a piece is that a robot carries, and how fast it moves in a state, as a free piece."""
        frame, plant, carrier = self.piece_origin(piece), self.plant, self.resolved.pieces[piece].carrier
        pose, angular, linear = self.pose(frame), np.zeros(3), np.zeros(3)
        if carrier in self.robots:
            own = self.robots[carrier]
            plant.SetVelocities(self.context, own.axis_map.spread_velocities(state.velocities[carrier]))
            speed = frame.CalcSpatialVelocityInWorld(self.context)
            plant.SetVelocities(self.context, np.zeros(plant.num_velocities()))
            turned = self._moved.get(own.instance, RigidTransform()).rotation()
            angular, linear = turned @ speed.rotational(), turned @ speed.translational()
            base = state.joints.get(self._base_joint(own)) if self.floats(carrier) else None
            if base is not None:
                arm = pose.translation() - base.position[4:]
                angular = angular + base.velocity[:3]
                linear = linear + base.velocity[3:] + np.cross(base.velocity[:3], arm)
        position = np.roll(xyz_quaternion_from_transform(pose), -3)
        return JointState(position, np.concatenate([angular, linear]))

    def _base_joint(self, robot: StationRobot) -> str:
        return f"{self.plant.GetModelInstanceName(robot.instance)}/{robot.root.body().name()}"

    def floats(self, robot: str) -> bool:
        """Tell whether a robot of the station is held by nothing."""
        return self.config.engine.moves_by_forces and self.robots[robot].model.base == "floating"

    def pose(self, frame: Frame) -> RigidTransform:
        """Return the pose of a frame in the world."""
        pose = super().pose(frame)
        moved = self._moved.get(frame.model_instance())
        return pose if moved is None else moved @ pose

    def chain(self, robot: str, tool: Frame, base: Frame | None = None) -> Chain:
        """Return the chain of a robot's axes from the world, or another frame, to a frame."""
        own = self.robots[robot]
        return Chain.of_plant(
            self.plant,
            joints=own.joints,
            base=base or self.plant.world_frame(),
            tool=tool,
            signs=own.axis_map.signs,
            names=own.axes,
        )

    def tool_in_use(self, robot: str) -> str:
        """Return the tool that a robot's tool centre point belongs to: one of its own or a piece; empty without any."""
        own = self.robots[robot]
        return tool_in_use(own.model.tools, own.held, self.config.robots[robot].tcp)

    def piece_frame(self, piece: str, frame: str = TCP) -> Frame:
        """Return a piece's named frame, else its tool centre point; raises UnknownName: no such piece or frame."""
        one_of(message("base.piece", "piece"), piece, self.config.pieces)
        known = self.resolved.pieces[piece].model.frame_poses
        one_of(message("programs.frame_of_piece", "frame of {piece}", piece=piece), frame, known)
        return self.station.piece_frame(piece, f"{piece}_{frame}")

    def piece_origin(self, piece: str) -> Frame:
        """Return the frame in which a piece is described."""
        return self.station.piece_frame(piece, piece)

    def links(self, robot: str) -> list[str]:
        """Return the links of a robot that are none of its tools, which pieces can be put on, too."""
        own = self.robots[robot].model
        return [link for link in own.links if link not in own.tools]

    def mount(self, parent: str, frame: str | None = None) -> Frame:
        """Return the frame that pieces hang on whose parent is the world, a robot or a piece.

        That is a piece's ``frame``, else its tool centre point; a robot's tool or link of that name, else its first
        tool. Raises UnknownName: no such frame, tool or link.
        """
        if parent in self.config.pieces:
            return self.piece_frame(parent, TCP if frame is None else frame)
        if parent == WORLD:
            return self.plant.world_frame()
        own = self.robots[parent]
        if frame is not None:
            one_of(
                message("programs.tool_or_link", "tool or link of {parent}", parent=parent),
                frame,
                [*own.model.tools, *own.model.links],
            )
        return self.plant.GetFrameByName(flange(own.model.tools, own.model.root, frame), own.instance)

    def dynamics(self, robot: str) -> Dynamics:
        """Return the dynamics of a robot with what it carries, while the others stay as they are."""
        own = self.robots[robot]
        tool, placed = own.tools.get(own.tcp), self.plant.GetPositions(self.context)
        return Dynamics(
            own.model, self.plant, own.joints, tool=tool, torque_limit=own.gains.limit_at_rest, positions=placed
        )


def reparented(
    model: StationModel, piece: str, parent: str, *, frame: str | None = None, pose: PoseLike | None = None
) -> StationConfig:
    """Return a station in which a piece, with all that hangs on it, hangs on something else; the model is of it now.

    ``parent`` is ``world``, a robot (its flange) or a piece (its tool centre point); ``frame`` a frame of that piece or
    a tool of that robot instead; ``pose`` in there, else it stays where it is in the world. Raises UnknownName: no such
    piece, parent or frame; InvalidParameter: the piece itself as its parent, or one that hangs on it.
    """
    config = model.config
    one_of(message("base.piece", "piece"), piece, config.pieces)
    if parent != piece:
        one_of(
            message("programs.parent", "parent"),
            parent,
            [name for name in (WORLD, *config.robots, *config.pieces) if name != piece],
        )
    if frame is not None and parent == WORLD:
        raise Unsuitable("frame", message("programs.world_without_frames", "the world has no frames"))
    above = parent
    while above in config.pieces:
        if above == piece:
            expected = message("programs.parent_of_piece", "world, a robot, or a piece that does not hang on it")
            raise InvalidParameter(
                message("programs.parent_of", "parent of {piece}", piece=piece),
                message("programs.piece_itself", "the piece itself") if parent == piece else parent,
                expected,
            )
        above = model.resolved.pieces[above].parent
    mount = model.pose(model.mount(parent, frame))
    place = mount.inverse() @ model.pose(model.piece_origin(piece)) if pose is None else as_transform(pose)
    entry = config.pieces[piece].model_copy(
        update={"parent": parent, "frame": frame, "free": False, "pose": tuple(pose_from_transform(place).tolist())}
    )
    changed = config.model_copy(update={"pieces": {**config.pieces, piece: entry}})
    return _with_tools(model, changed, piece)


def _with_tools(model: StationModel, new: StationConfig, piece: str) -> StationConfig:
    """Let the robot that took a piece use its tool centre point, and one that gave its tool away what carried it."""
    old, carriers, robots = model.resolved.pieces, carriers_of(new), dict(new.robots)
    giver, taker = old[piece].carrier, carriers[piece]
    if giver == taker:
        return new
    if giver in robots:
        tool = model.tool_in_use(giver)
        if carriers.get(tool, giver) != giver:
            before = old[piece].parent
            own, frame = model.robots[giver].model.tools, model.config.pieces[piece].frame
            usual = frame if frame in own else next(iter(own), None)
            changes = {"tcp": before if before in new.pieces else usual, "tcp_offset": None}
        else:
            changes = {"tcp": tool or None}
        robots[giver] = robots[giver].model_copy(update=changes)
    if taker in robots:
        held = new.pieces[piece].parent in old or new.pieces[piece].frame not in model.links(taker)
        used = {"tcp": piece, "tcp_offset": None} if held else {"tcp": model.tool_in_use(taker) or None}
        robots[taker] = robots[taker].model_copy(update=used)
    return new.model_copy(update={"robots": robots})


def one_posture(values: npt.ArrayLike, axes: int, name: str) -> Vector:
    """Return one posture (n,); raises InvalidParameter: another shape, or numbers that are not finite."""
    found = finite(values)
    if found.shape != (axes,):
        raise InvalidParameter(
            name, values, message("programs.a_posture", "a posture of {axes} axes, finite numbers [rad]", axes=axes)
        )
    return found
