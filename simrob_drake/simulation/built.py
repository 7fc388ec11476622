"""The diagrams of a station: built when they are needed, and used again for other references and pushes.

A diagram *plays* references and forces: its sources get them for a run, without being built anew. ``cenic`` is a scheme
of Drake that holds inputs constant over a step.
"""

from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Protocol, TypeAlias, cast

import numpy as np
from pydrake.systems.framework import Context, Diagram, LeafSystem

from simrob_drake.base.arguments import instance
from simrob_drake.base.errors import InvalidParameter, one_of, quote_value
from simrob_drake.base.frames import numbers
from simrob_drake.base.messages import compound, join_texts, message
from simrob_drake.base.renaming import former_names_of
from simrob_drake.blocks.references import Reference, as_reference, corner_times, hold
from simrob_drake.parts.controllers import readers_of
from simrob_drake.parts.controllers.loop import sensors_read
from simrob_drake.parts.controllers.own import output_owners
from simrob_drake.parts.controllers.section import (
    ControllerSection,
    TimedCommand,
    commanded_sections,
)
from simrob_drake.parts.forces import ForceConfig, Push
from simrob_drake.stations.closed import ClosedStation, closed_station
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.resolve import ResolvedStation


class StationDiagrams:
    """The diagrams of a station that play given references and forces.

    There are several, since a solver also spends time on blocks whose outputs nothing reads. The *whole* diagram has
    all sensors and forces; signals are evaluated in it after a run. A *lean* diagram is stepped: it has no sensors that
    only report, and no forces of pushes while nothing pushes (under ``cenic``, which holds inputs over a step). No
    diagram has monitors. Blocks that only report, such as poses, are in a diagram only if another block reads them:
    their values are computed from the recorded states. With ``steps_whole`` they are always in the diagram. All
    diagrams have the same states in the same order. A block of the user's own can be in one diagram only, so with such
    blocks the whole diagram is the only one. Diagrams are built when they are needed.

    Attributes:
        references: reference of each robot, by the robot's name.
        forces: the forces, by name.
    """

    def __init__(
        self,
        station: ResolvedStation,
        references: Mapping[str, Reference],
        blocks: Mapping[str, LeafSystem],
        *,
        steps_whole: bool = False,
    ) -> None:
        """Prepare the diagrams of a station.

        Args:
            station: the station.
            references: reference of each robot, by the robot's name.
            blocks: the user's own blocks, by name.
            steps_whole: whether to step the whole diagram, since its signals are read during the run. All blocks
                that only report are in this diagram then.
        """
        self._station = station
        self._blocks = blocks
        self._steps_whole = steps_whole
        # A block whose output is named as an input of the station drives this input.
        self._driven_inputs = output_owners(blocks)
        self.references = dict(references)
        self.forces = dict(station.config.forces)

    def fits(self, references: Mapping[str, Reference]) -> bool:
        """Whether the sources of the diagrams can play these references.

        The source of a trajectory can play any trajectory, and that of a sine only this sine. The player key of a
        reference names its kind of source.

        Args:
            references: reference of each robot, by the robot's name.
        """
        return all(
            as_reference(self.references[robot]).player_key == as_reference(reference).player_key
            for robot, reference in references.items()
        )

    def play(self, references: Mapping[str, Reference], forces: Mapping[str, ForceConfig]) -> None:
        """Replace the references and the forces in all diagrams.

        Args:
            references: reference of each robot, by the robot's name; they must fit, see :meth:`fits`.
            forces: forces by name, of the same kinds and on the same bodies as those before.
        """
        self.references = dict(references)
        self.forces = dict(forces)
        self._play(references, forces)

    def forget(self) -> None:
        """Remove the references from the sources of all built diagrams, since trajectories may take much memory."""
        # A source must play something: a constant posture takes no memory.
        nothing = {
            robot.name: hold(np.zeros(len(robot.axes))) for robot in self._station.robots.values()
        }
        self._play(nothing, {})

    def _play(self, references: Mapping[str, Reference], forces: Mapping[str, ForceConfig]) -> None:
        """Give references and forces to the diagrams that are built already.

        Others get those of the attributes `references` and `forces` when they are built.
        """
        for name in ("whole", "_lean", "_lean_without_forces"):
            # A cached property is among the object's attributes once it has been computed. Asking for it in any other
            # way would build the diagram.
            if name in self.__dict__:
                self.__dict__[name].play(references, forces)

    @property
    def edges(self) -> list[float]:
        """Times at which a step of the solver must end, in order [s]: corners of references, edges of forces."""
        references = list[Reference]()
        for robot in self._station.robots.values():
            # A block of the user's own may drive the input in place of the robot's reference.
            if f"{robot.prefix}reference" not in self._driven_inputs:
                references.append(self.references[robot.name])
            references.extend(robot.prescribed.values())
        # The velocity of a reference jumps at a corner: a step across it is less accurate than the solver estimates.
        times = {time for reference in references for time in corner_times(reference)}
        for force in self.forces.values():
            times.update(force.edges)
        return sorted(times)

    def diagram_at(self, time: float) -> ClosedStation:
        """Return the diagram that is stepped from a time on [s], up to the next of :attr:`edges`.

        It is the whole diagram if there are blocks of the user's own, or with ``steps_whole``. Otherwise it is a lean
        one: the one without forces under a scheme that holds inputs over a step, if all forces are pushes and none of
        them acts now, and else the one with forces.
        """
        # A block of the user's own can be in one diagram only.
        if self._blocks or self._steps_whole:
            return self.whole
        # The diagram without forces only serves engines that hold inputs over a step, see the class.
        if not self._station.engine.holds_inputs_over_steps or not self.forces:
            return self._lean
        for force in self.forces.values():
            # Other forces than pushes act all the time.
            if not isinstance(force, Push) or force.start <= time < force.end:
                return self._lean
        return self._lean_without_forces

    @cached_property
    def whole(self) -> ClosedStation:
        """The diagram with all sensors and forces."""
        return self._build(sensors=list(self._station.sensors))

    @cached_property
    def _lean(self) -> ClosedStation:
        """The diagram without sensors that only report; the whole one if there are no such sensors."""
        sensors = self._stepped_sensors()
        if len(sensors) == len(self._station.sensors):
            return self.whole
        return self._build(sensors=sensors)

    @cached_property
    def _lean_without_forces(self) -> ClosedStation:
        """The diagram without sensors that only report, and without forces of any kind."""
        return self._build(sensors=self._stepped_sensors(), has_forces=False)

    def _stepped_sensors(self) -> list[str]:
        """List the names of the sensors that must take samples while the station is stepped.

        These are the sensors that controllers read, those that always take samples while stepping, and those that one
        of these reads.
        """
        return sorted(
            sensors_read(readers_of(self._station.config.controllers), self._station.sensors)
        )

    def _build(self, *, sensors: Sequence[str], has_forces: bool = True) -> ClosedStation:
        """Build a diagram.

        Args:
            sensors: names of the sensors that it has.
            has_forces: whether it has the blocks of forces, such as pushes.
        """
        diagram = closed_station(
            self._station,
            self.references,
            sensors=sensors,
            forces=has_forces,
            monitors=False,
            blocks=self._blocks,
            # Reports such as poses need blocks of their own only if they are read during the run.
            lean=not self._steps_whole,
        )
        # A diagram that is built late has the forces of the configuration, which may have been replaced since.
        diagram.play_forces(self.forces)
        return diagram


CommandFunctions: TypeAlias = Mapping[str, Callable[[float], Sequence[float] | None]]
"""Functions that command controllers, by the name of the controller.

A function gets the time [s] and returns the numbers of the controller's command, such as the speeds ahead and to the
left [m/s] and the turn [rad/s] of a walk. None leaves the command as it is.
"""


__getattr__ = former_names_of(__name__, {"Hands": "CommandFunctions", "ByHand": "CommandRelay"})


class TakesCommands(Protocol):
    """The block of a controller that takes commands."""

    def command_by_hand(self, context: Context, values: Sequence[float]) -> None:
        """Make a command hold from the next sample on. The context of the block is changed."""


class CommandRelay:
    """Passes the commands of a user's functions to controllers during a run.

    The functions are called after each accepted step. A command acts from the controller's next sample on.
    """

    def __init__(
        self, config: StationConfig, functions: CommandFunctions | None, *, begin: float = 0.0
    ) -> None:
        """Take the functions that command the controllers of a station.

        Args:
            config: the station.
            functions: the functions by the name of the controller; None if there are none.
            begin: start of the run [s].

        Raises:
            InvalidParameter: `functions` is no mapping of names to functions.
            UnknownName: no controller of this name takes commands.
        """
        self._begin = begin
        self._functions: CommandFunctions = {}
        if functions is not None:
            expected = message(
                "simulation.commands_by_controller", "a mapping of controllers to functions"
            )
            self._functions = instance(functions, "commands", Mapping, expected)
        self._sections = commanded_sections(config.controllers)
        # Commands up to now, by the name of the controller.
        self._commands: dict[str, list[TimedCommand]] = {}
        # All names are checked before the run, not at its first step.
        for name, function in self._functions.items():
            kind = message("simulation.controller_with_commands", "controller that takes commands")
            one_of(kind, name, self._sections)
            if not callable(function):
                raise InvalidParameter(
                    message("simulation.commands_of", "commands: {name}", name=name),
                    function,
                    message("simulation.function_of_time", "a function of the time"),
                )

    def pass_on(self, diagram: Diagram, context: Context) -> None:
        """Call the functions for commands, and pass on the commands that have changed.

        At the start of the run no function is called: the first sample of a controller is not yet taken, and would
        drop the command. Commands that are passed on are also kept, for :attr:`commands`.

        Args:
            diagram: the diagram that is stepped.
            context: its context, which is changed.

        Raises:
            InvalidParameter: a function returns something that is no command.
        """
        time = context.get_time()
        if time <= self._begin:
            return
        for name, function in self._functions.items():
            answer = function(time)
            # None leaves the command as it is.
            if answer is None:
                continue
            section = self._sections[name]
            # The result's file has the rounded numbers: a run of this file must do the same to the last bit.
            command = section.rounded_command(_checked_command(section, name, time, answer))
            earlier = self._commands.setdefault(name, [])
            # A command holds until the next one, so an equal command would only make the table longer.
            if earlier and earlier[-1].values == command.values:
                continue
            earlier.append(command)
            # The diagram may be another one than at the last step, and each has blocks of its own.
            block = diagram.GetSubsystemByName(f"controller.{name}")
            own_context = block.GetMyMutableContextFromRoot(context)
            cast(TakesCommands, block).command_by_hand(own_context, command.values)

    def config_with_commands(self, config: StationConfig) -> StationConfig:
        """Copy a configuration with the commands of this run in its controllers, so that its run repeats this one.

        Args:
            config: configuration of the station of this run. It is returned as it is if there were no commands.
        """
        if not self._commands:
            return config
        # Other controllers, and commands of the file before the first of these, stay.
        controllers = dict(config.controllers)
        for name, commands in self._commands.items():
            controllers[name] = controllers[name].with_commands(commands)
        return config.model_copy(update={"controllers": controllers})

    @property
    def commands(self) -> dict[str, tuple[TimedCommand, ...]]:
        """Commands of this run, by the name of the controller."""
        return {name: tuple(commands) for name, commands in self._commands.items()}


def functions_of(commands: Mapping[str, Sequence[TimedCommand]]) -> CommandFunctions:
    """Make functions that give the commands of an earlier run again, at the same times.

    Args:
        commands: commands in the order of their times, by the name of the controller.
    """

    def function_of(entries: Sequence[TimedCommand]) -> Callable[[float], Sequence[float] | None]:
        """Make the function of one controller from its commands, in the order of their times."""

        def latest_command(time: float) -> Sequence[float] | None:
            """Values of the last command up to a time [s], or None before the first command."""
            count = bisect_right(entries, time, key=lambda entry: entry.time)
            return entries[count - 1].values if count else None

        return latest_command

    return {name: function_of(entries) for name, entries in commands.items()}


def _checked_command(
    section: ControllerSection, name: str, time: float, answer: Sequence[float]
) -> TimedCommand:
    """Check the value that a user's function returned as a command, and make the command.

    Args:
        section: section of the controller.
        name: name of the controller.
        time: time of the run [s].
        answer: value that the function returned.

    Raises:
        InvalidParameter: the value does not have the finite numbers of the controller's command.
    """
    # A user's function may return any object, such as a list, a tuple or an array.
    values = numbers(answer)
    parts = section.command_parts
    if values.shape != (len(parts),) or not np.isfinite(values).all():
        described = join_texts(
            (compound("{part} [{unit}]", part=part.name, unit=part.unit) for part in parts), ", "
        )
        expected = message(
            "simulation.list_of_numbers",
            "a list of {count} numbers: {described}",
            count=len(parts),
            described=described,
        )
        raise InvalidParameter(
            message(
                "simulation.commands_at", "commands: {name} at {time:g} s", name=name, time=time
            ),
            quote_value(answer),
            expected,
        )
    return TimedCommand(time, tuple(values.tolist()))
