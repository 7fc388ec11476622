"""A station as its parts see it: what it is made of, resolved once, and the plant and ports that it is built of."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any

import numpy as np
from pydrake.geometry import CollisionFilterDeclaration, GeometryId, GeometrySet, QueryObject, SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, Joint, ModelInstanceIndex, RigidBody
from pydrake.systems.framework import Context, DiagramBuilder, InputPort, LeafSystem, OutputPort
from pydrake.systems.rendering import MultibodyPositionToGeometryPose

from simrob_drake.base.errors import InvalidParameter, one_of
from simrob_drake.base.frames import Indices, Vector
from simrob_drake.base.lifetime import release_with
from simrob_drake.base.sections import Pose
from simrob_drake.base.signals import Compute, Signal
from simrob_drake.blocks.frame_poses import FramePoses
from simrob_drake.blocks.monitor import Trigger
from simrob_drake.blocks.references import Reference
from simrob_drake.blocks.servo import ServoGains
from simrob_drake.parts.captions import BlockRole, Drawn, InnerBlock
from simrob_drake.parts.engine import Engine, PlantBlock
from simrob_drake.parts.ground import Ground
from simrob_drake.robots.axis_map import AxisMap
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.feet import FootContact
from simrob_drake.robots.motors import Motor
from simrob_drake.robots.pieces import TCP, PieceModel

WORLD = "world"


def named(name: str | None, known: Sequence[str], *, kind: str = "robot", key: str = "robot") -> str:
    """Return which of ``known`` a name means, the only one unless named.

    Raises UnknownName: none of them; InvalidParameter: several, and none named.
    """
    if name is None:
        if len(known) != 1:
            none = f"a {kind.partition(' for ')[0]}, and there is none"
            raise InvalidParameter(key, None, f"one of {', '.join(known)}" if known else none)
        return known[0]
    return one_of(kind, name, known)


@dataclass(frozen=True)
class ResolvedRobot:
    """A robot of a station, with all that its section and its own files say."""

    # its key in the station, and what stands before the names of its ports
    name: str
    prefix: str
    model: RobotModel  # what it is
    base: RigidTransform  # pose of its root link in the world; where it begins if it floats
    floats: bool  # whether its root link is held by nothing
    gains: ServoGains  # of its servos
    # stiffness and damping of the stops of its axes, each shape (n,) [N·m/rad or N/m, N·m·s/rad or N·s/m]
    stops: tuple[Vector, Vector]
    initial: Vector  # where its axes are at the start, shape (n,) [rad or m]
    carried: tuple[str, ...]  # the pieces that it carries, each after what it hangs on
    held: tuple[str, ...]  # those of them that hang on its tools, and not elsewhere
    load: float  # the mass of all that it carries [kg]
    tool_frames: Mapping[str, str]  # by tool or carried piece the name of its frame in the plant
    tcp: str  # the tool in use; empty without any
    # pose of the tool centre point in that tool's frame; then the tool in use is called ``tcp``
    tcp_offset: Pose | None
    feet: FootContact | None  # what it stands on; None without
    # references of axes whose motion is prescribed in a dynamic station, of one value each, by place
    prescribed: Mapping[int, Reference]
    motors: tuple[Motor | None, ...]  # of its axes; None where a servo has none

    def __repr__(self) -> str:
        tool = f", tool {self.tcp}" if self.tcp else ""
        return f"<{type(self).__name__} {self.name}: {self.model.name}, {len(self.axes)} axes{tool}>"

    @property
    def axes(self) -> list[str]:
        """The names of the axes, in order."""
        return list(self.model.axes)

    @property
    def speed_limits(self) -> Vector:
        """How fast its axes may be, shape (n,) [rad/s or m/s]: the no-load speed of motors, else the URDF's limit."""
        speeds = zip(self.motors, self.model.speed_limits, strict=True)
        return np.array([limit if motor is None else motor.line[1] for motor, limit in speeds])

    @property
    def tool_names(self) -> list[str]:
        """The names of the tools, of carried pieces and, with an offset, of the tool centre point itself."""
        return [*self.tool_frames, *([TCP] if self.tcp and self.tcp_offset is not None else [])]


@dataclass(frozen=True)
class ResolvedPiece:
    """A piece of a station, with all its figures."""

    name: str  # its key in the station
    model: PieceModel  # what it is
    parent: str  # what it hangs on: ``world``, a robot or another piece
    carrier: str  # the robot that carries it, directly or through other pieces, or ``world``
    mount: str  # the name of the frame of the plant that it hangs on; empty for the world
    pose: RigidTransform  # in that frame; in the world where it is free
    free: bool  # moved by gravity and contact alone


@dataclass(frozen=True)
class Surroundings:
    """What a part may know of its station before anything is built."""

    engine: Engine  # what moves it
    has_contact: bool  # whether it has this section
    ground: Ground  # what there is to stand on
    robots: Mapping[str, ResolvedRobot]  # by name
    pieces: Mapping[str, ResolvedPiece]  # by name, each after what it hangs on
    sensors: Mapping[str, Any]  # their sections by name

    @property
    def free_pieces(self) -> list[str]:
        """The names of the pieces that nothing holds."""
        return [name for name, piece in self.pieces.items() if piece.free]

    def robot(self, name: str | None, key: str) -> ResolvedRobot:
        """Return a robot by name, the only one unless named.

        Raises SimrobError: no such robot, or several and none named; names the key.
        """
        return self.robots[named(name, list(self.robots), kind=f"robot for {key}", key=f"{key}.robot")]


@dataclass(frozen=True, repr=False)
class StationRobot(ResolvedRobot):
    """A robot in the plant of a station."""

    plant: MultibodyPlant  # that it is in
    instance: ModelInstanceIndex  # its model instance there
    joints: list[Joint]  # of the axes, in order
    root: Frame  # the frame of its root link
    tools: dict[str, Frame]  # frames of tools and carried pieces by name; ``tcp`` is the one in use

    @cached_property
    def axis_map(self) -> AxisMap:
        """Between its axes and the vectors of the plant, which is finalized."""
        return AxisMap.of_joints(self.plant, self.joints, [axis.sign for axis in self.model.axes.values()])

    def free_inertias(self, context: Context | None = None) -> Vector:
        """Return each axis's inertia (n,) [kg m² or kg] with the others free, at the start or in a context."""
        mass = self.plant.CalcMassMatrix(self.plant.CreateDefaultContext() if context is None else context)
        return np.asarray(1 / np.diag(np.linalg.inv(mass))[self.axis_map.velocity_places])


@dataclass(frozen=True)
class StationPlant:
    """The plant of a station and where its robots are in it."""

    plant: MultibodyPlant  # finalized
    scene_graph: SceneGraph  # with which it is registered
    robots: dict[str, StationRobot]  # by name
    # the bodies of the pieces that nothing holds, by name
    free_pieces: dict[str, RigidBody] = field(default_factory=dict)
    ground: Ground = field(default_factory=Ground)  # what there is to stand on
    # small balls at the corners of flat bodies, such as boxes: contact forces act on the balls instead of the flat
    # shapes
    contact_points: frozenset[GeometryId] = frozenset()
    # pairs of shapes between which the contact points touch; a collision filter lets the two shapes themselves pass
    # through each other
    replaced_pairs: tuple[tuple[GeometryId, GeometryId], ...] = ()
    stand_in: PlantBlock | None = None  # block of another engine in the diagram; None if the plant itself is stepped
    # whether the solver of the plant holds couplings as constraints; otherwise stiff springs hold them
    holds_constraints: bool = False

    @property
    def stepped(self) -> Any:
        """What stands in the diagram of a dynamic station as ``plant``: Drake's own, or another engine's."""
        return self.stand_in or self.plant

    def place(self, root: Context, positions: Vector) -> None:
        """Let what is stepped stand at positions (nq,), in a context of its diagram."""
        self.stepped.SetPositions(self.stepped.GetMyMutableContextFromRoot(root), positions)

    def query(self, root: Context) -> QueryObject:
        """Return what tells which shapes touch, in a context of the diagram."""
        return self.scene_graph.get_query_output_port().Eval(self.scene_graph.GetMyContextFromRoot(root))

    def with_whole_shapes(self, root: Context) -> Context:
        """Clone a context of the diagram, and in the clone let the shapes of `replaced_pairs` collide themselves.

        In the given context only the contact points of these pairs collide. The small balls at the corners of two boxes
        do not show how deep the boxes are in each other.

        Args:
            root: context of the whole diagram, which stays as it is.
        """
        clone = root.Clone()
        context = self.scene_graph.GetMyMutableContextFromRoot(clone)
        filters = self.scene_graph.collision_filter_manager(context)
        for first, second in self.replaced_pairs:
            pair_collides = CollisionFilterDeclaration().AllowBetween(GeometrySet(first), GeometrySet(second))
            filters.Apply(pair_collides)
        return clone

    def shapes_of_body(self, body: RigidBody) -> list[GeometryId]:
        """Collision shapes of a body, without the small balls at their corners (`contact_points`)."""
        shapes = self.plant.GetCollisionGeometriesForBody(body)
        return [shape for shape in shapes if shape not in self.contact_points]

    def piece_frame(self, piece: str, frame: str) -> Frame:
        """Return a frame of a piece by its name in the plant; that in which the piece is described has the piece's."""
        carriers = [robot.instance for robot in self.robots.values() if piece in robot.carried]
        instance = carriers[0] if carriers else self.plant.GetModelInstanceByName(f"{piece}::{piece}")
        return self.plant.GetFrameByName(frame, instance)

    def __repr__(self) -> str:
        return f"<StationPlant of {[*self.robots.values()]}, free pieces {[*self.free_pieces]}>"

    def add_geometry_poses(self, builder: DiagramBuilder, *, of_state: bool = False) -> InputPort:
        """Let a plant outside of the diagram pose its geometry; return its port for positions, or ``of_state``."""
        poses = MultibodyPositionToGeometryPose(self.plant, input_multibody_state=of_state)
        builder.AddNamedSystem("geometry_poses", poses)
        source_id = self.plant.get_source_id()
        assert source_id is not None  # add_plant registers the plant
        builder.Connect(poses.get_output_port(), self.scene_graph.get_source_pose_port(source_id))
        return poses.get_input_port()


@dataclass(frozen=True)
class FromState:
    """Rule by which an output of the station is computed from states of the whole plant, without reading its port.

    The rule picks values from a state (nq + nv,) of the plant's positions and velocities, and a function may then
    compute the output from these values.

    Attributes:
        pick: indices of the picked entries of the state, integers of shape (size,); or a matrix (size, nq + nv), whose
            product with the state gives the picked values. Indices save memory in a station of many free pieces.
        finish: computes the output (m, any size) from the picked values (m, size) of m states. If it is None, the
            picked values are the output.
    """

    pick: Vector | Indices
    finish: Callable[[Vector], Vector] | None = None

    def of(self, states: Vector) -> Vector:
        """Compute the output (m, size) for each of m states, shape (m, nq + nv)."""
        values = self._picked_values(states)
        return values if self.finish is None else self.finish(values)

    def _picked_values(self, states: Vector) -> Vector:
        """Pick the values (m, size) from each of m states, shape (m, nq + nv)."""
        if self._picks_entries:
            # The sum with 0 makes 0 of -0, as a product with a matrix does.
            return np.asarray(states[:, self.pick] + 0.0)
        return np.asarray(states @ self.pick.T)

    def matrix(self, size: int) -> Vector:
        """Matrix (picked values, size) whose product with a state (size,) gives the picked values."""
        if not self._picks_entries:
            return np.asarray(self.pick, dtype=float)
        # Each row has a 1 at the index of its entry.
        matrix = np.zeros((len(self.pick), size))
        matrix[np.arange(len(self.pick)), self.pick] = 1.0
        return matrix

    @property
    def _picks_entries(self) -> bool:
        """Whether `pick` contains indices, not a matrix."""
        return self.pick.ndim == 1


@dataclass(frozen=True, kw_only=True)
class Site:
    """A station under construction: its plant, and the ports that its parts add and read.

    Names carry the prefix ``<robot>.`` where there are several robots.
    """

    station: Surroundings  # what it is made of
    plant: StationPlant  # its multibody plant, scene graph and robots
    state: OutputPort  # positions and velocities of the whole plant, size nq + nv
    # input ports by name: ``reference`` (n) and what the station lists under ``inputs``
    inputs: dict[str, InputPort] = field(default_factory=dict)
    # output ports by name: ``position``, ``velocity``, ``torque`` (n), ``base_pose``, ``tcp_pose`` (7),
    # ``piece_pose.<piece>`` (7), ``piece_velocity.<piece>`` (6), ``force.<sensor>`` (3)
    outputs: dict[str, OutputPort] = field(default_factory=dict)
    # how the plant's state gives an output without its port, by the output's name
    of_state: dict[str, FromState] = field(default_factory=dict)
    lean: bool = False  # whether blocks that only report join the diagram when something reads them, and not before
    # those that have not joined it, with what they are to read, by the names of their outputs
    idle: dict[str, tuple[LeafSystem, OutputPort]] = field(default_factory=dict)
    # what cameras show blocks of the user's own, by name: ``image.<sensor>``
    images: dict[str, OutputPort] = field(default_factory=dict)
    # what gives a sensor's output after the run, where it has no port, by the output's name
    later: dict[str, Compute] = field(default_factory=dict)
    signals: list[Signal] = field(default_factory=list)  # what the outputs are, in the order of the columns of a result
    # when they end a run, by name; their conditions watch the outputs
    monitors: dict[str, Trigger] = field(default_factory=dict)
    notes: dict[str, dict[str, str]] = field(default_factory=dict)  # how a part was made, in words, by its name
    # times at which a run must end a step: corners of references, edges of pushes [s]
    edges: list[float] = field(default_factory=list)
    # what acts on the plant from outside, to be gathered into its port
    spatial_forces: list[OutputPort] = field(default_factory=list)
    # what acts on the plant's joints beside their motors, likewise
    generalized_forces: list[OutputPort] = field(default_factory=list)
    # by the name of a system, or the part of it before a dot, the block of the picture that it belongs to; None for
    # wiring
    drawn: dict[str, Drawn | None] = field(default_factory=dict)
    blocks: dict[str, LeafSystem] = field(default_factory=dict)  # controllers and others of the user's own, by name

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {', '.join(self.inputs) or 'nothing'} → {', '.join(self.outputs)}>"

    def add(self, output: str, port: OutputPort, *signals: Signal, of_state: FromState | None = None) -> None:
        """Add an output with what it is; a signal of no columns, as of limbs that a robot lacks, is none."""
        self.outputs[output] = port
        self.signals.extend(signal for signal in signals if signal.names)
        if of_state is not None:
            self.of_state[output] = of_state

    def add_report(
        self, builder: DiagramBuilder, name: str, block: LeafSystem, source: OutputPort, *outputs: str
    ) -> None:
        """Add a block that only reports: it reads one port, and gives the outputs."""
        block.set_name(name)
        self.idle.update(dict.fromkeys(outputs, (block, source)))
        if not self.lean:
            self._join(builder, block)
        elif isinstance(block, FramePoses):
            release_with(self.plant.plant, block)

    def port(self, builder: DiagramBuilder, output: str) -> OutputPort:
        """Return an output for a block to read; what gives it joins the diagram if it is not there yet."""
        if output in self.idle:
            self._join(builder, self.idle[output][0])
        return self.outputs[output]

    def _join(self, builder: DiagramBuilder, block: LeafSystem) -> None:
        joining = {output: source for output, (idle, source) in self.idle.items() if idle is block}
        builder.AddSystem(block)
        builder.Connect(next(iter(joining.values())), block.get_input_port(0))
        for output in joining:
            del self.idle[output]

    def from_state(self, output: str) -> Callable[[Vector], Vector] | None:
        """Return what gives an output (m, size) for states (m, nq + nv) of the plant; None if they do not tell it."""
        if output in self.of_state:
            return self.of_state[output].of
        block, _ = self.idle.get(output, (None, None))
        return partial(block.at, self.outputs[output].get_name()) if isinstance(block, FramePoses) else None

    def value(self, output: str, context: Context) -> Vector:
        """Return an output in a context of the diagram, from the plant's state where that tells it."""
        rule, port = self.from_state(output), self.outputs[output]
        read = port if rule is None else self.state
        value = np.array(read.Eval(read.get_system().GetMyContextFromRoot(context)))
        return value if rule is None else rule(value[np.newaxis])[0]

    def draw(
        self,
        name: str,
        role: BlockRole,
        label: str,
        robot: StationRobot | None = None,
        *,
        key: str = "",
        inside: Sequence[str] = (),
        within: str = "",
        net: Mapping[str, InnerBlock] | None = None,
    ) -> None:
        """Say in which block of the picture a system stands, with those whose names begin with its name and a dot.

        Several systems share a block by its ``key``: the system's name unless given. ``inside``,
        ``within`` and ``net`` are those of :class:`~simrob_drake.parts.captions.Drawn`.
        """
        owner = robot.name if robot is not None and robot.prefix else ""
        self.drawn[name] = Drawn(key or name, role, label, owner, tuple(inside), within, net or {})

    def draw_nothing(self, *names: str) -> None:
        """Say that systems are wiring, part of the arrows of the picture."""
        self.drawn.update(dict.fromkeys(names))

    def robot(self, name: str | None) -> StationRobot:
        """Return a robot by its name, or the only one."""
        return self.plant.robots[named(name, list(self.plant.robots))]
