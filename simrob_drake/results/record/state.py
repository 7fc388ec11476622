"""The state of a station at the end of a run, from which another run can begin.

A state contains the positions and velocities of joints, and the memory of *blocks*: of the systems in the station's
diagram other than the plant, such as controllers and sensors. All entries have names, so that a state fits a station
that was changed in between. A state can be written to a JSON file.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TypeAlias

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
from simrob_drake.base.sections import Number, Strict, validate_section
from simrob_drake.base.yaml_files import parse_json
from simrob_drake.blocks.monitor import Monitor
from simrob_drake.parts.controllers.section import TimedCommand
from simrob_drake.parts.resolved import ResolvedRobot
from simrob_drake.parts.station_plant import StationPlant
from simrob_drake.results.record.history import FlightCheck, StateHistory, python_value
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.ports import StationPorts

_LARGEST_FILE = 10_000_000
"""Largest size of a file with a state [bytes]."""

_TRACED_STEPS = 80
"""Count of the last steps of a run that its final state contains, see Trace.last."""

_OF_ROBOTS = ("positions", "velocities", "references")
"""Attributes of a state that have a vector for each robot."""

_FREE_BODY = 7
"""Count of the coordinates of a body that moves freely: a quaternion qw qx qy qz, then x y z."""

_UNIT_TOLERANCE = 0.1
"""Tolerance for the length of a quaternion. Drake normalizes quaternions, and a file may contain rounded ones."""


@dataclass(frozen=True)
class JointState:
    """State of one joint of a plant, in Drake's coordinates. A body that moves freely has a joint, too.

    Attributes:
        position: generalized positions of the joint, shape (k,) [rad or m; quaternion first for free bodies].
        velocity: generalized velocities, shape (l,) [rad/s or m/s].
    """

    position: Vector
    velocity: Vector


def _check_rotation(name: str, position: Vector) -> None:
    """Check the quaternion of a joint whose body moves freely. Other joints, with fewer coordinates, pass.

    Args:
        name: name of the joint, for the error.
        position: positions of the joint.

    Raises:
        InvalidParameter: the length of the quaternion differs from 1 by more than 0.1.
    """
    if len(position) != _FREE_BODY:
        return
    # Drake normalizes quaternions silently. One of another length comes from a file that was edited, or its
    # numbers have another meaning.
    length = float(np.linalg.norm(position[:4]))  # the quaternion comes first
    if abs(length - 1.0) > _UNIT_TOLERANCE:
        raise InvalidParameter(
            message("results.quaternion_of", "start: the quaternion of {name}", name=name),
            message("results.of_length", "of length {length:.3g}", length=length),
            message("results.of_length_1", "of length 1"),
        )


@dataclass(frozen=True)
class BlockState:
    """State of one block.

    Attributes:
        continuous: continuous state, shape (k,).
        discrete: vectors of the discrete state.
        abstract: abstract values, as Python objects. A value is None if Python cannot read it.
    """

    continuous: Vector
    discrete: tuple[Vector, ...]
    abstract: tuple[Any, ...] = ()


def _json_value(value: Any) -> Any:
    """Check an abstract value. Returns the value, or None if JSON cannot write it or would read it as another one."""
    try:
        # Tuples come back as lists, and keys as strings: such a value would be another one after reading.
        return value if json.loads(json.dumps(value)) == value else None
    except (TypeError, ValueError):
        return None


# NumPy's arrays have no schema in pydantic: they are validated as lists of numbers.
_list_as_array = GetPydanticSchema(
    lambda _, handler: no_info_after_validator_function(
        np.array, handler.generate_schema(list[Number])
    )
)
"""Annotation with which pydantic checks a list of numbers and makes an array of it."""

_ArrayField = Annotated[Vector, _list_as_array, PlainSerializer(np.ndarray.tolist)]
"""Type of a pydantic field that is an array in Python, and a list of numbers in JSON."""

_ValueField = Annotated[Any, PlainSerializer(_json_value)]
"""Type of a pydantic field with an abstract value. It is null in JSON if JSON cannot write the value."""

_JointEntry: TypeAlias = tuple[_ArrayField, _ArrayField]
"""Positions and velocities of a joint."""

_BlockEntry: TypeAlias = tuple[_ArrayField, tuple[_ArrayField, ...], tuple[_ValueField, ...]]
"""Continuous state, vectors of the discrete state, and abstract values of a block."""


class _StateFile(Strict):
    """Content of a file with a state. The keys are those of :class:`State`."""

    of_any_size = True  # velocities at rest may be tiny
    positions: dict[str, _ArrayField]
    velocities: dict[str, _ArrayField]
    references: dict[str, _ArrayField]
    time: Number = 0.0
    origins: dict[str, _ArrayField] = Field(default_factory=dict)
    joints: dict[str, _JointEntry]
    blocks: dict[str, _BlockEntry]


@dataclass(frozen=True)
class MotionOrigin:
    """The run that a motion began with, from which the motion can be repeated.

    Attributes:
        config: configuration of the station in this run.
        start: state in which it began; None for the initial state of the station.
        begin: its start, in simulated time [s].
        begins_in_motion: whether it continued the motion of another run.
        commands: commands that the user's functions gave in it, by the name of the controller. The configuration has
            them, too. A block may keep in its state who gave a command, so a repeated run gives them in the same way.
    """

    config: StationConfig
    start: "State | None"
    begin: float
    begins_in_motion: bool
    commands: Mapping[str, Sequence[TimedCommand]] = field(default_factory=dict)


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
        """Copy the end of the trace: row ``free_row``, up to ``count`` states before it, and all after it."""
        first_row = max(self.free_row - count, 0)  # a short run has fewer rows
        history = self.history.last(len(self.history.times) - first_row)
        return replace(self, history=history, free_row=self.free_row - first_row)


@dataclass(frozen=True)
class State:
    """The state of a station: of each joint, each block with a memory, and each robot's reference.

    All entries have names, so the state fits a station that was rebuilt and changed: with a piece on another parent,
    other gains, another solver. Robots, joints and blocks that the new station does not have are ignored. Joints and
    blocks that the state does not have begin as at the start of any run. So do monitors, whose times count from the
    start of a run. Each robot of the new station must be in the state, with as many axes.

    Attributes:
        positions: positions of the axes, by robot, shape (n,) [rad or m].
        velocities: velocities of the axes, by robot, shape (n,) [rad/s or m/s].
        references: last values of the references, by robot, shape (n,); references of the next run begin there.
        joints: states of the joints by ``<model instance>/<joint>``; empty if the plant is not stepped, as in a
            kinematic station.
        blocks: states of the blocks, by name.
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
    # the values of this state when its trace was set
    _traced: tuple[Any, ...] = field(default=(), repr=False)

    def __repr__(self) -> str:
        """One line with the robots and the counts of joints and blocks."""
        robots = ", ".join(
            f"{name} ({len(positions)} axes)" for name, positions in self.positions.items()
        )
        return f"<State of {robots or 'no robot'}: {len(self.joints)} joints, {len(self.blocks)} blocks with a memory>"

    @classmethod
    def of(
        cls, diagram: Diagram, ports: StationPorts, context: Context, *, tolerant: bool = False
    ) -> "State":
        """Read the state of a station from a context.

        Args:
            diagram: the diagram that contains the station.
            ports: ports of the station.
            context: context of the diagram.
            tolerant: whether outputs of robots that cannot be evaluated become NaN, as after a run in which a block
                failed. If it is False, the error is raised.
        """
        plant = (
            ports.plant.plant_block
        )  # Drake's plant, or the block of another engine in its place
        blocks = {}
        for system in _blocks_of(diagram, plant):
            # Most systems, such as gains and sums, have no memory. Entries without content would only make
            # files longer.
            block = _block_state(system.GetMyContextFromRoot(context))
            if block is not None:
                blocks[_block_name(system, ports)] = block
        # The diagram of a kinematic station contains no plant.
        joints = {}
        if diagram.HasSubsystemNamed(plant.get_name()):
            plant_context = plant.GetMyContextFromRoot(context)
            q = plant.GetPositions(plant_context)
            v = plant.GetVelocities(plant_context)
            # A shared plant has joints of other stations, too. Its scope leaves them out.
            for joint in joints_of(ports.plant.plant, ports.plant.scope):
                joints[joint.name] = JointState(q[joint.positions], v[joint.velocities])
        return cls(
            positions=_values_of_robots("position", ports, context, tolerant),
            velocities=_values_of_robots("velocity", ports, context, tolerant),
            references=_values_of_robots("reference", ports, context, tolerant),
            joints=joints,
            blocks=blocks,
            time=context.get_time(),
        )

    def with_trace(self, trace: Trace | None) -> "State":
        """Copy the state, with the last steps of the run that ended in it.

        Args:
            trace: states of the run. If it is None, since the run cannot be continued, the state is returned as it is.
        """
        if trace is None:
            return self
        # The values are kept, so that `valid_trace` finds out whether the state was changed afterwards.
        return replace(self, trace=trace.last(_TRACED_STEPS), _traced=self._values())

    @property
    def valid_trace(self) -> Trace | None:
        """The trace. It is None if the state has no trace, or if the state was changed after the trace was set."""
        # Compared by identity, which is quick. Arrays that were changed in place are not noticed, nor are entries that
        # were added or removed at the end.
        is_unchanged = all(
            now is before for now, before in zip(self._values(), self._traced, strict=False)
        )
        return self.trace if is_unchanged else None

    def _values(self) -> tuple[Any, ...]:
        """List the values of the state. An entry that is another object later has been changed."""
        # Time and origins are not compared: they do not change the motion that the trace continues.
        everything: list[dict[str, Any]] = [
            self.positions,
            self.velocities,
            self.references,
            self.joints,
            self.blocks,
        ]
        return tuple(value for entries in everything for value in entries.values())

    def check(self) -> None:
        """Check that a run can begin in this state.

        Raises:
            InvalidParameter: an entry is not an array of finite numbers, as after a run in which a block failed, or has
                another class.
        """
        # The types of all entries are checked first, since attributes of the entries are read here.
        vectors: list[_NamedVector] = []
        for key in _OF_ROBOTS:
            for name, values in self._entries(key, object).items():
                vectors.append(_NamedVector(f"{key} of {name}", values))
        for name, joint in self._entries("joints", JointState).items():
            vectors.append(_NamedVector(name, joint.position))
            vectors.append(_NamedVector(name, joint.velocity))
        for name, block in self._entries("blocks", BlockState).items():
            vectors.append(_NamedVector(name, block.continuous))
            vectors += [_NamedVector(name, values) for values in block.discrete]
        for name, values in vectors:
            if not _is_finite_vector(values):
                expected = message(
                    "results.finite_numbers_of_state",
                    "an array of finite numbers, unlike at the end of a run in which a block failed",
                )
                raise InvalidParameter(f"start: {name}", values, expected)

    def _entries(self, key: str, kind: type[Any]) -> dict[str, Any]:
        """Check the type of an attribute and of its entries. A user's script can set any values.

        Args:
            key: name of the attribute, which is a mapping by name.
            kind: class of its entries.

        Returns:
            the entries, by name.

        Raises:
            InvalidParameter: the attribute is not a mapping, or an entry has another class.
        """
        a_mapping = message("results.mapping_by_name", "a mapping from names to values")
        entries = instance(getattr(self, key), f"start: {key}", Mapping, a_mapping)
        for name, entry in entries.items():
            instance(entry, f"start: {name}", kind, f"a {kind.__name__}")
        return dict(entries)

    def put(self, diagram: Diagram, ports: StationPorts, context: Context) -> None:
        """Set a context to this state, as far as the station has the joints and blocks of the state. Time stays.

        Blocks that the state does not have stay as they are in the context. The plant's joints that it does not have
        get the positions and velocities of the plant's default context.

        Args:
            diagram: a diagram that contains a station, perhaps another one than that of the state.
            ports: ports of this station.
            context: context of the diagram. It is changed.

        Raises:
            InvalidParameter: a robot of the station is missing in the state; a robot, joint or block has the same name
                but another size; a quaternion does not have length 1; or a block has abstract values of other classes.
        """
        # Robots of another size are refused before the context is changed.
        for robot in ports.plant.robots.values():
            _check_size(robot.name, self.positions.get(robot.name), len(robot.axes))
            _check_size(robot.name, self.velocities.get(robot.name), len(robot.axes))
        plant = ports.plant.plant_block
        for system in _blocks_of(diagram, plant):
            block = self.blocks.get(_block_name(system, ports))
            if block is not None:
                _put_block(system, block, context)
        # The diagram of a kinematic station contains no plant.
        if diagram.HasSubsystemNamed(plant.get_name()):
            plant_context = plant.GetMyMutableContextFromRoot(context)
            # Joints by name: the plant may have other joints than that of the state, in another order.
            state = self.of_plant(ports.plant)
            plant.SetPositions(plant_context, state.positions)
            plant.SetVelocities(plant_context, state.velocities)

    def context_of(self, diagram: Diagram, ports: StationPorts) -> Context:
        """Make a context of a diagram in this state, at its time.

        Args:
            diagram: a diagram that contains a station.
            ports: ports of the station.

        Raises:
            InvalidParameter: the state does not fit the station, see :meth:`put`.
        """
        context = diagram.CreateDefaultContext()
        self.put(diagram, ports, context)
        context.SetTime(self.time)
        return context

    def of_plant(self, station: StationPlant) -> "PlantState":
        """Compute positions and velocities of a station's plant.

        Joints that the state does not have keep their default positions and velocities. The context of the station is
        not changed.

        Raises:
            InvalidParameter: a joint has the same name but another size, or a quaternion does not have length 1.
        """
        plant = station.plant
        context = plant.CreateDefaultContext()
        # Joints that the state does not have begin in the initial posture of the station, the plant's default.
        q = plant.GetPositions(context)
        v = plant.GetVelocities(context)
        for robot in station.robots.values():
            if robot.name in self.positions:
                q = robot.axis_map.spread_positions(self.positions[robot.name], q)
                v = robot.axis_map.spread_velocities(self.velocities[robot.name], v)
        # Joints come last: a run records every joint, also those of free bodies and those that couplings move.
        for joint in joints_of(plant, station.scope):
            own = self.joints.get(joint.name)
            if own is None:
                continue
            _check_size(joint.name, own.position, len(q[joint.positions]))
            _check_size(joint.name, own.velocity, len(v[joint.velocities]))
            _check_rotation(joint.name, own.position)
            q[joint.positions] = own.position
            v[joint.velocities] = own.velocity
        return PlantState(positions=q, velocities=v)

    def with_axes(self, robot: ResolvedRobot, positions: Vector, velocities: Vector) -> "State":
        """Copy the state, with other positions and velocities of a robot's axes.

        Args:
            robot: the robot.
            positions: positions of its axes, shape (n,) [rad or m].
            velocities: velocities of its axes, shape (n,) [rad/s or m/s].
        """
        # The joints of the axes are left out: in `of_plant` they would overwrite the new positions.
        joints_of_axes = {axis.joint for axis in robot.model.axes.values()}
        joints = {}
        for name, joint in self.joints.items():
            # The name of a joint is "<model instance>/<joint>". The model instance begins with the robot's name.
            instance_robot = name.partition("::")[0]
            joint_in_model = name.rpartition("/")[2]
            is_of_axis = instance_robot == robot.name and joint_in_model in joints_of_axes
            if not is_of_axis:
                joints[name] = joint
        return replace(
            self,
            positions={**self.positions, robot.name: positions},
            velocities={**self.velocities, robot.name: velocities},
            joints=joints,
        )

    def to_json(self) -> str:
        """Write the state as a text, from which :meth:`from_json` reads all numbers back to the last bit.

        The `trace` is not written. Abstract values become null if JSON cannot write them, or would read them as other
        values, such as tuples: a run then begins with the value that the block declares in their place.
        """
        # Without validation: the values were checked when they were read, or come from Drake.
        content = _StateFile.model_construct(
            positions=self.positions,
            velocities=self.velocities,
            references=self.references,
            time=self.time,
            origins=self.origins,
            joints={name: (joint.position, joint.velocity) for name, joint in self.joints.items()},
            blocks={
                name: (block.continuous, block.discrete, block.abstract)
                for name, block in self.blocks.items()
            },
        )
        # Keys with their default values are not written.
        defaults = {key for key in ("time", "origins") if not getattr(self, key)}
        return content.model_dump_json(indent=1, exclude=defaults)

    @classmethod
    def from_json(cls, text: str, where: Path | str = "state") -> "State":
        """Read a state that :meth:`to_json` wrote.

        Args:
            text: the JSON text.
            where: name of its file, for the error.

        Raises:
            InvalidConfig: the text contains no state.
        """
        content = validate_section(_StateFile, parse_json(text, where), where)
        return cls(
            positions=content.positions,
            velocities=content.velocities,
            references=content.references,
            joints={name: JointState(*joint) for name, joint in content.joints.items()},
            blocks={name: BlockState(*block) for name, block in content.blocks.items()},
            time=float(content.time),
            origins=content.origins,
        )

    @classmethod
    def at_start_of(cls, config: StationConfig) -> "State | None":
        """Read the state in which a station begins, from the file under its key ``start``.

        Returns None if the station names no such file.

        Raises:
            InvalidConfig: the file cannot be read or contains no state.
        """
        if config.start is None:
            return None
        try:
            return cls.from_json(text_of(config.start, _LARGEST_FILE), config.start)
        except NotRead as problem:
            unreadable = message(
                "results.start_cannot_be_read",
                "{start}: cannot be read ({problem})",
                start=config.start,
                problem=problem,
            )
            raise _bad_start_file(unreadable) from None
        except InvalidConfig as problem:
            raise _bad_start_file(problem) from None


class PlantState(NamedTuple):
    """State of a plant.

    Attributes:
        positions: generalized positions, shape (nq,).
        velocities: generalized velocities, shape (nv,).
    """

    positions: Vector
    velocities: Vector


class _NamedVector(NamedTuple):
    """An array in a state, with its name for error messages. The user may have replaced it by any object."""

    name: str
    values: Any


def _is_finite_vector(values: Any) -> bool:
    """Whether an object is an array (k,) of finite numbers."""
    if not isinstance(values, np.ndarray) or values.ndim != 1:
        return False
    # `finite` returns an empty array if a number is not finite.
    return bool(finite(values).shape == values.shape)


def _bad_start_file(problem: object) -> InvalidConfig:
    """Error about the file under the key ``start`` of a station.

    Args:
        problem: what is wrong with the file, with its name.
    """
    text = message(
        "results.start_names_file",
        "{problem}; the key `start` expects the file start.json of a result",
        problem=problem,
    )
    return InvalidConfig("", "", text)


def _check_size(name: str, values: Vector | None, size: int) -> None:
    """Check the size of a vector of a state.

    Args:
        name: name of the robot, joint or block, for the error.
        values: the vector; None if the state has none of this name.
        size: its size in the station that is to begin in the state.

    Raises:
        InvalidParameter: the size is another one, or the vector is missing.
    """
    if values is not None and len(values) == size:
        return
    found = message("results.is_missing", "is missing")
    if values is not None:
        found = message("results.of_size", "has size {size}", size=len(values))
    raise InvalidParameter(
        "start",
        message(
            "results.state_in_which", "a state in which '{name}' {found}", name=name, found=found
        ),
        message("results.station_of_size", "a state in which it has size {size}", size=size),
    )


def _values_of_robots(
    signal: str, ports: StationPorts, context: Context, tolerant: bool
) -> dict[str, Vector]:
    """Evaluate an output of each robot of a station.

    Args:
        signal: name of the output: position, velocity or reference.
        ports: ports of the station.
        context: context of the diagram that contains the station.
        tolerant: whether outputs that cannot be evaluated become NaN. If it is False, the error is raised.

    Returns:
        the values, by robot, shape (n,).
    """
    values = {}
    for robot in ports.plant.robots.values():
        # A block of the user's own may raise any error.
        try:
            values[robot.name] = ports.outputs.value(f"{robot.prefix}{signal}", context)
        except Exception:
            if not tolerant:
                raise
            # NaN marks the values as unknown. `check` refuses a run that would begin with them.
            values[robot.name] = np.full(len(robot.axes), np.nan)
    return values


def _block_state(context: Context) -> BlockState | None:
    """Copy the state of a block from its context. Returns None if the block has no state."""
    has_continuous = context.num_continuous_states() > 0
    group_count = context.num_discrete_state_groups()
    value_count = context.num_abstract_states()
    if not has_continuous and group_count == 0 and value_count == 0:
        return None
    continuous = (
        context.get_continuous_state_vector().CopyToVector() if has_continuous else np.zeros(0)
    )
    groups = [context.get_discrete_state(index).value().copy() for index in range(group_count)]
    # Copies, since a block may change its objects in place later.
    values = [
        deepcopy(python_value(context.get_abstract_state(index))) for index in range(value_count)
    ]
    return BlockState(continuous=continuous, discrete=tuple(groups), abstract=tuple(values))


def _put_block(system: System, state: BlockState, root: Context) -> None:
    """Set a block to a state. An abstract value that is None in the state is not set.

    Args:
        system: the block.
        state: its state.
        root: context of the diagram that contains the block. It is changed.

    Raises:
        InvalidParameter: the state is that of a block of another size, or with objects of other classes.
    """
    context = system.GetMyMutableContextFromRoot(root)
    name = system.get_name()
    group_count = context.num_discrete_state_groups()
    _check_size(name, state.continuous, context.num_continuous_states())
    _check_size(name, np.zeros(len(state.discrete)), group_count)  # the count of vectors, as a size
    if state.continuous.size:
        context.SetContinuousState(state.continuous)
    for group, values in enumerate(state.discrete):
        _check_size(name, values, context.get_discrete_state(group).size())
        context.SetDiscreteState(group, values)
    for index, value in enumerate(state.abstract[: context.num_abstract_states()]):
        # A value that Python could not read, or JSON could not write: the block's own initial value stays.
        if value is None:
            continue
        declared = context.get_mutable_abstract_state(index)
        kind = type(declared.get_value())
        expected = f"a {kind.__name__}, as that block remembers"
        # A copy, since the block may change the object, and another run may begin in the same state.
        declared.set_value(deepcopy(instance(value, f"start: {name}", kind, expected)))


def _block_name(system: System, ports: StationPorts) -> str:
    """Name of a block in a state: its name in the diagram, without that of the station there."""
    # In a diagram of the user's own, names begin with that of the station, which may differ in the next run.
    name = str(system.get_name())
    return name.removeprefix(f"{ports.name}.") if ports.name else name


def _blocks_of(diagram: Diagram, plant: System) -> Iterator[System]:
    """Yield the systems of a diagram whose state belongs to a station's state by the name of the system.

    The plant is none of them, since its joints have names of their own. Neither are monitors, which begin anew in each
    run.
    """
    for system in diagram.GetSystems():
        if system is not plant and not isinstance(system, Monitor):
            yield system


def free_joint(piece: str) -> str:
    """Name that the joint of a free piece has in a state."""
    return f"{piece}::{piece}/{piece}"


class JointCoordinates(NamedTuple):
    """Coordinates of a joint in the state of its plant.

    Attributes:
        name: name of the joint in a :class:`State`: ``<model instance>/<joint>``.
        positions: entries of the plant's positions that belong to the joint.
        velocities: entries of the plant's velocities that belong to the joint.
    """

    name: str
    positions: slice
    velocities: slice


def joints_of(plant: MultibodyPlant, scope: str = "") -> Iterator[JointCoordinates]:
    """Yield the coordinates of every joint that has some: welds have none.

    Args:
        plant: the finalized plant.
        scope: text with which the names of model instances begin. Joints of other model instances are left out. The
            yielded names are without this text.
    """
    for index in plant.GetJointIndices():
        joint: Joint = plant.get_joint(index)
        model = plant.GetModelInstanceName(joint.model_instance())
        is_moving = joint.num_positions() > 0  # welds are joints without positions
        if not is_moving or not model.startswith(scope):
            continue
        first_position = joint.position_start()
        first_velocity = joint.velocity_start()
        yield JointCoordinates(
            name=f"{model.removeprefix(scope)}/{joint.name()}",
            positions=slice(first_position, first_position + joint.num_positions()),
            velocities=slice(first_velocity, first_velocity + joint.num_velocities()),
        )
