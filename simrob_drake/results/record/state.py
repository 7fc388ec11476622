"""What a station carries from one run to the next."""

import json
from collections.abc import Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, GetPydanticSchema, PlainSerializer
from pydantic_core.core_schema import no_info_after_validator_function
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Joint
from pydrake.systems.framework import Context, Diagram, System

from simrob_drake.base.arguments import instance
from simrob_drake.base.errors import InvalidConfig, InvalidParameter
from simrob_drake.base.files import NotRead, text_of
from simrob_drake.base.frames import Vector, finite
from simrob_drake.base.messages import message
from simrob_drake.base.sections import Number, Strict, validated
from simrob_drake.base.yaml_files import parse_json
from simrob_drake.blocks.monitor import Monitor
from simrob_drake.parts.resolved import ResolvedRobot
from simrob_drake.parts.station_plant import StationPlant
from simrob_drake.results.record.history import FlightCheck, StateHistory, python_value
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.ports import StationPorts

_LARGEST = 10_000_000  # bytes of a file
_TRACED_STEPS = 80  # count of the last steps of a run that its final state contains, see Trace.last
_OF_ROBOTS, _OF_PLANT = ("positions", "velocities", "references"), ("joints", "blocks")


@dataclass(frozen=True)
class JointState:
    """Position and velocity of one joint of a plant, free bodies included, in Drake's coordinates."""

    position: Vector
    velocity: Vector


_FREE_BODY = 7  # coordinates of a body that moves freely: a quaternion qw qx qy qz, then x y z
_UNIT_TOLERANCE = 0.1  # of the length of a quaternion: Drake normalizes it, and a file may be rounded


def _check_rotation(name: str, position: Vector) -> None:
    """Check the quaternion of a joint that lets its body move freely; raises InvalidParameter if its length is not 1.

    Other joints, with fewer coordinates, pass.
    """
    if len(position) != _FREE_BODY:
        return
    length = float(np.linalg.norm(position[:4]))
    if abs(length - 1.0) > _UNIT_TOLERANCE:
        raise InvalidParameter(
            message("results.quaternion_of", "start: the quaternion of {name}", name=name),
            message("results.of_length", "of length {length:.3g}", length=length),
            message("results.of_length_1", "of length 1"),
        )


@dataclass(frozen=True)
class BlockState:
    """Continuous state, discrete groups and abstract values of one block."""

    continuous: Vector
    discrete: tuple[Vector, ...]
    abstract: tuple[Any, ...] = ()


def _json_value(value: Any) -> Any:
    """Check an abstract value. Returns the value, or None if JSON cannot write it."""
    try:
        return value if json.loads(json.dumps(value)) == value else None
    except (TypeError, ValueError):
        return None


_of_numbers = GetPydanticSchema(
    lambda _, handler: no_info_after_validator_function(np.array, handler.generate_schema(list[Number]))
)
_Array = Annotated[Vector, _of_numbers, PlainSerializer(np.ndarray.tolist)]
_Value = Annotated[Any, PlainSerializer(_json_value)]


class _Kept(Strict):
    """Content of a file of a state."""

    of_any_size = True
    positions: dict[str, _Array]
    velocities: dict[str, _Array]
    references: dict[str, _Array]
    time: Number = 0.0
    origins: dict[str, _Array] = Field(default_factory=dict)
    joints: dict[str, tuple[_Array, _Array]]
    blocks: dict[str, tuple[_Array, tuple[_Array, ...], tuple[_Value, ...]]]
    """Continuous state, discrete groups, abstract values."""


@dataclass(frozen=True)
class MotionOrigin:
    """The run that a motion began with, from which the motion can be repeated.

    Attributes:
        config: configuration of the station in this run.
        start: state in which it began; None for the initial state of the station.
        begin: its start, in simulated time [s].
        begins_in_motion: whether it continued the motion of another run.
    """

    config: StationConfig
    start: "State | None"
    begin: float
    begins_in_motion: bool


@dataclass(frozen=True)
class Trace:
    """States of a run at its steps, with what another run needs to continue it to the last bit.

    Attributes:
        history: states at the ends of the accepted steps: of the whole run, or of its last steps.
        flight_checks: the last checks of flight, in order; empty for other schemes than ``cenic``.
        origin: the run that the motion began with.
        free_row: last row of the history that does not depend on when the run ended. A solver that chooses its steps
            shortens those that would go beyond the end.
    """

    history: StateHistory
    flight_checks: tuple[FlightCheck, ...]
    origin: MotionOrigin
    free_row: int

    def last(self, count: int) -> "Trace":
        """Copy the last states of the trace: up to ``count`` states before ``free_row``, and all after it."""
        first_row = max(self.free_row - count, 0)
        history = self.history.last(len(self.history.times) - first_row)
        return replace(self, history=history, free_row=self.free_row - first_row)


@dataclass(frozen=True)
class State:
    """The state of a station: of each joint, each block with a memory, and each robot's reference.

    Everything goes by name, so the state fits a station that was rebuilt and changed: with a piece on another parent,
    other gains, another solver. Joints and blocks that the new station does not have are left out, and new ones begin
    as they do at the start of any run; so do monitors, whose times count from the start of a run.

    Attributes:
        positions: of each robot's axes, shape (n,) [rad or m].
        velocities: of each robot's axes, shape (n,) [rad/s or m/s].
        references: what each robot's reference was last, shape (n,); references of the next run begin there.
        joints: by ``<model instance>/<joint>``, of plants that are stepped.
        blocks: by the block's name.
        time: simulated time of the state [s]. A run continues at this time with ``start_time="keep"``, and otherwise
            begins at zero.
        origins: positions (n,) at which the references of the configuration began, by robot; empty if they began in
            the initial posture. A run with ``start_time="keep"`` continues these references.
        trace: the last steps of the run that ended in this state, with which ``start_time="keep"`` continues it to the
            last bit; None if they are not known, as in a state from a file.
    """

    positions: dict[str, Vector]
    velocities: dict[str, Vector]
    references: dict[str, Vector]
    joints: dict[str, JointState] = field(default_factory=dict)
    blocks: dict[str, BlockState] = field(default_factory=dict)
    time: float = 0.0
    origins: dict[str, Vector] = field(default_factory=dict)
    trace: Trace | None = field(default=None, repr=False)
    _traced: tuple[Any, ...] = field(default=(), repr=False)  # the values of this state when its trace was set

    def __repr__(self) -> str:
        robots = ", ".join(f"{name} ({len(positions)} axes)" for name, positions in self.positions.items())
        return f"<State of {robots or 'no robot'}: {len(self.joints)} joints, {len(self.blocks)} blocks with a memory>"

    @classmethod
    def of(cls, diagram: Diagram, ports: StationPorts, context: Context, *, tolerant: bool = False) -> "State":
        """Return the state of a closed station, of a context of the diagram that holds it.

        What cannot be evaluated is no number if ``tolerant``, as after a run in which a block failed.
        """

        def of_robots(signal: str) -> dict[str, Vector]:
            values = {}
            for robot in ports.plant.robots.values():
                try:
                    values[robot.name] = ports.outputs.value(f"{robot.prefix}{signal}", context)
                except Exception:
                    if not tolerant:
                        raise
                    values[robot.name] = np.full(len(robot.axes), np.nan)
            return values

        plant, blocks = ports.plant.plant_block, {}
        for system in _with_memory(diagram, plant):
            own = system.GetMyContextFromRoot(context)
            if own.num_continuous_states() or own.num_discrete_state_groups() or own.num_abstract_states():
                has_continuous = own.num_continuous_states() > 0
                groups, values = range(own.num_discrete_state_groups()), range(own.num_abstract_states())
                blocks[_block_name(system, ports)] = BlockState(
                    own.get_continuous_state_vector().CopyToVector() if has_continuous else np.zeros(0),
                    tuple(own.get_discrete_state(group).value().copy() for group in groups),
                    tuple(deepcopy(python_value(own.get_abstract_state(index))) for index in values),
                )
        joints = {}
        if diagram.HasSubsystemNamed(plant.get_name()):
            own = plant.GetMyContextFromRoot(context)
            q, v = plant.GetPositions(own), plant.GetVelocities(own)
            known = joints_of(ports.plant.plant, ports.plant.scope)
            joints = {name: JointState(q[places], v[speeds]) for name, places, speeds in known}
        positions, velocities, references = map(of_robots, ("position", "velocity", "reference"))
        return cls(positions, velocities, references, joints, blocks, time=context.get_time())

    def with_trace(self, trace: Trace | None) -> "State":
        """Copy the state, with the last steps of the run that ended in it.

        Args:
            trace: the run; None if it cannot be continued.
        """
        if trace is None:
            return self
        return replace(self, trace=trace.last(_TRACED_STEPS), _traced=self._values())

    @property
    def valid_trace(self) -> Trace | None:
        """The trace, or None if there is none or the state was changed since."""
        is_unchanged = all(now is before for now, before in zip(self._values(), self._traced, strict=False))
        return self.trace if is_unchanged else None

    def _values(self) -> tuple[Any, ...]:
        """List the values of the state. An entry that is another object later has been changed."""
        everything: list[dict[str, Any]] = [self.positions, self.velocities, self.references, self.joints, self.blocks]
        return tuple(value for entries in everything for value in entries.values())

    def check(self) -> None:
        """Check that a run can begin here; raises InvalidParameter: what is no number, as after a block failed."""
        vectors = [(f"{key} of {name}", values) for key in _OF_ROBOTS for name, values in self._entries(key, object)]
        for name, joint in self._entries("joints", JointState):
            vectors += [(name, joint.position), (name, joint.velocity)]
        for name, block in self._entries("blocks", BlockState):
            vectors += [(name, block.continuous), *((name, values) for values in block.discrete)]
        for name, values in vectors:
            if not (isinstance(values, np.ndarray) and values.ndim == 1 and finite(values).shape == values.shape):
                expected = message(
                    "results.finite_numbers_of_state",
                    "an array of finite numbers, unlike at the end of a run in which a block failed",
                )
                raise InvalidParameter(f"start: {name}", values, expected)

    def _entries(self, key: str, kind: type[Any]) -> list[tuple[str, Any]]:
        entries = instance(
            getattr(self, key), f"start: {key}", Mapping, message("results.mapping_by_name", "a mapping by name")
        )
        return [
            (name, instance(entry, f"start: {name}", kind, f"a {kind.__name__}")) for name, entry in entries.items()
        ]

    def put(self, diagram: Diagram, ports: StationPorts, context: Context) -> None:
        """Set a context of another closed station to this state, as far as the two have joints and blocks in common.

        Raises:
            InvalidParameter: a robot, joint or block of the same name but another size.
        """
        for robot in ports.plant.robots.values():
            for values in (self.positions, self.velocities):
                self._check(robot.name, values.get(robot.name), len(robot.axes))
        plant = ports.plant.plant_block
        for system in _with_memory(diagram, plant):
            kept = self.blocks.get(_block_name(system, ports))
            if kept is not None:
                self._put_block(system, kept, context)
        if diagram.HasSubsystemNamed(plant.get_name()):
            own = plant.GetMyMutableContextFromRoot(context)
            q, v = self.of_plant(ports.plant)
            plant.SetPositions(own, q)
            plant.SetVelocities(own, v)

    def context_of(self, diagram: Diagram, ports: StationPorts) -> Context:
        """Make a context of a diagram in this state, at its time.

        Args:
            diagram: a diagram that contains a station.
            ports: ports of the station.
        """
        context = diagram.CreateDefaultContext()
        self.put(diagram, ports, context)
        context.SetTime(self.time)
        return context

    def of_plant(self, station: StationPlant) -> tuple[Vector, Vector]:
        """Return positions (nq,) and velocities (nv,) of a station's plant; what is not known stays at its default.

        Raises:
            InvalidParameter: a joint of the same name but another size.
        """
        plant = station.plant
        context = plant.CreateDefaultContext()
        q, v = plant.GetPositions(context), plant.GetVelocities(context)
        for robot in station.robots.values():
            if robot.name in self.positions:
                q = robot.axis_map.spread_positions(self.positions[robot.name], q)
                v = robot.axis_map.spread_velocities(self.velocities[robot.name], v)
        for name, places, speeds in joints_of(plant, station.scope):
            if name in self.joints:
                self._check(name, self.joints[name].position, len(q[places]))
                self._check(name, self.joints[name].velocity, len(v[speeds]))
                _check_rotation(name, self.joints[name].position)
                q[places], v[speeds] = self.joints[name].position, self.joints[name].velocity
        return q, v

    def with_axes(self, robot: ResolvedRobot, positions: Vector, velocities: Vector) -> "State":
        """Return the state with other positions and velocities (n,) of a robot's axes."""
        own = {axis.joint for axis in robot.model.axes.values()}
        kept = {
            name: joint
            for name, joint in self.joints.items()
            if name.partition("::")[0] != robot.name or name.rpartition("/")[2] not in own
        }
        return replace(
            self,
            positions={**self.positions, robot.name: positions},
            velocities={**self.velocities, robot.name: velocities},
            joints=kept,
        )

    def to_json(self) -> str:
        """Return the state as a text that :meth:`from_json` reads back to the last bit.

        Abstract values that JSON does not know are left out: their blocks begin with those that they declare.
        """
        own = {key: {name: tuple(vars(one).values()) for name, one in getattr(self, key).items()} for key in _OF_PLANT}
        kept: dict[str, Any] = {key: getattr(self, key) for key in (*_OF_ROBOTS, "time", "origins")}
        left_out = {key for key in ("time", "origins") if not kept[key]}
        return _Kept.model_construct(**kept | own).model_dump_json(indent=1, exclude=left_out)

    @classmethod
    def from_json(cls, text: str, where: Path | str = "state") -> "State":
        """Return the state that :meth:`to_json` wrote; raises InvalidConfig, called ``where``: it holds no state."""
        kept = validated(_Kept, parse_json(text, where), where)
        joints = {name: JointState(*joint) for name, joint in kept.joints.items()}
        blocks = {name: BlockState(*block) for name, block in kept.blocks.items()}
        vectors = kept.positions, kept.velocities, kept.references
        return cls(*vectors, joints, blocks, time=float(kept.time), origins=kept.origins)

    @classmethod
    def at_start_of(cls, config: StationConfig) -> "State | None":
        """Read the state in which a station begins. Returns None if the station names no such state.

        Raises:
            InvalidConfig: a file that cannot be read or holds no state.
        """
        if config.start is None:
            return None
        try:
            return cls.from_json(text_of(config.start, _LARGEST), config.start)
        except (NotRead, InvalidConfig) as problem:
            what = (
                message(
                    "results.start_cannot_be_read",
                    "{start}: cannot be read ({problem})",
                    start=config.start,
                    problem=problem,
                )
                if isinstance(problem, NotRead)
                else problem
            )
            raise InvalidConfig(
                "",
                "",
                message(
                    "results.start_names_file", "{problem}; `start` names the start.json of a result", problem=what
                ),
            ) from None

    def _put_block(self, system: System, kept: BlockState, context: Context) -> None:
        own = system.GetMyMutableContextFromRoot(context)
        sizes = [own.get_discrete_state(group).size() for group in range(own.num_discrete_state_groups())]
        self._check(system.get_name(), kept.continuous, own.num_continuous_states())
        self._check(system.get_name(), np.zeros(len(kept.discrete)), len(sizes))
        if kept.continuous.size:
            own.SetContinuousState(kept.continuous)
        for group, (values, size) in enumerate(zip(kept.discrete, sizes, strict=True)):
            self._check(system.get_name(), values, size)
            own.SetDiscreteState(group, values)
        for index, value in enumerate(kept.abstract[: own.num_abstract_states()]):
            if value is None:
                continue
            state = own.get_mutable_abstract_state(index)
            expected = f"a {type(state.get_value()).__name__}, as that block remembers"
            state.set_value(deepcopy(instance(value, f"start: {system.get_name()}", type(state.get_value()), expected)))

    @staticmethod
    def _check(name: str, values: Vector | None, size: int) -> None:
        if values is None or len(values) != size:
            found = "unknown" if values is None else message("results.of_size", "of size {size}", size=len(values))
            raise InvalidParameter(
                "start",
                message("results.state_in_which", "a state in which '{name}' is {found}", name=name, found=found),
                message("results.station_of_size", "of a station where it is of {size}", size=size),
            )


def _block_name(system: System, ports: StationPorts) -> str:
    """Name of a block in a state: its name in the diagram, without that of the station there."""
    name = str(system.get_name())
    return name.removeprefix(f"{ports.name}.") if ports.name else name


def _with_memory(diagram: Diagram, plant: System) -> Iterator[System]:
    """Yield the blocks whose state is theirs to keep: not the plant, whose joints have names, and no monitor."""
    for system in diagram.GetSystems():
        if system is not plant and not isinstance(system, Monitor):
            yield system


def free_joint(piece: str) -> str:
    """Return the name of the joint of a free piece in a state."""
    return f"{piece}::{piece}/{piece}"


def joints_of(plant: MultibodyPlant, scope: str = "") -> Iterator[tuple[str, slice, slice]]:
    """Yield name, places of the positions and places of the velocities of every joint that moves.

    Args:
        plant: the finalized plant.
        scope: begin of the names of the model instances that count. The yielded names are without it.
    """
    for index in plant.GetJointIndices():
        joint: Joint = plant.get_joint(index)
        if joint.num_positions():
            q, v = joint.position_start(), joint.velocity_start()
            model = plant.GetModelInstanceName(joint.model_instance())
            if not model.startswith(scope):
                continue
            name = f"{model.removeprefix(scope)}/{joint.name()}"
            yield name, slice(q, q + joint.num_positions()), slice(v, v + joint.num_velocities())
