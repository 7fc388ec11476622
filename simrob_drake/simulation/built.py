"""The diagrams of a station: built when they are needed, and used again for other references and pushes."""

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Protocol, TypeAlias, cast

import numpy as np
from pydrake.systems.framework import Context, Diagram, LeafSystem

from simrob_drake.base.arguments import instance
from simrob_drake.base.errors import InvalidParameter, one_of, quoted
from simrob_drake.base.frames import numbers
from simrob_drake.base.messages import compound, join_texts, message
from simrob_drake.blocks.references import Reference, as_reference, corner_times, hold
from simrob_drake.parts.controllers import readers_of
from simrob_drake.parts.controllers.loop import sensors_read
from simrob_drake.parts.controllers.own import output_owners
from simrob_drake.parts.controllers.section import ControllerSection, TimedCommand, commanded_sections
from simrob_drake.parts.forces import ForceConfig, Push
from simrob_drake.stations.closed import ClosedStation, closed_station
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.resolve import ResolvedStation


class StationDiagrams:
    """The diagrams of a station of given robots, pieces, parts and places of forces.

    Several, because what nothing reads still costs a solver time: one with everything, in which signals are evaluated
    after a run, and leaner ones to be stepped, without monitors, without sensors that only report and, under ``cenic``,
    without the forces of pushes while nothing pushes. A user's own block stands in one diagram only, so with any there
    is just the first. All have the same states in the same order.
    """

    def __init__(
        self,
        station: ResolvedStation,
        references: Mapping[str, Reference],
        blocks: Mapping[str, LeafSystem],
        *,
        watched: bool = False,
    ) -> None:
        """Prepare diagrams of a station, its references and the user's blocks by name, built when needed.

        With ``watched`` the one with everything is stepped, since somebody looks at it meanwhile.
        """
        self._station, self._blocks, self._watched = station, blocks, watched
        self._driven = output_owners(blocks)
        self.references, self.forces = dict(references), dict(station.config.forces)

    def fits(self, references: Mapping[str, Reference]) -> bool:
        """Whether the sources of the diagrams can play these references.

        The source of a trajectory can play any trajectory, and that of a sine only this sine.

        Args:
            references: reference of each robot, by the robot's name.
        """
        return all(
            as_reference(self.references[robot]).player_key == as_reference(reference).player_key
            for robot, reference in references.items()
        )

    def play(self, references: Mapping[str, Reference], forces: Mapping[str, ForceConfig]) -> None:
        """Let all diagrams give other references, and other pushes at the same places."""
        self.references, self.forces = dict(references), dict(forces)
        self._play(references, forces)

    def forget(self) -> None:
        """Let the sources of all diagrams forget their trajectories, which may be long."""
        self._play({robot.name: hold(np.zeros(len(robot.axes))) for robot in self._station.robots.values()}, {})

    def _play(self, references: Mapping[str, Reference], forces: Mapping[str, ForceConfig]) -> None:
        for name in ("whole", "_lean", "_unpushed"):
            if name in self.__dict__:
                self.__dict__[name].play(references, forces)

    @property
    def edges(self) -> list[float]:
        """Times at which a step must end: corners of references, edges of pushes [s]."""
        robots = self._station.robots.values()
        played = [self.references[robot.name] for robot in robots if f"{robot.prefix}reference" not in self._driven]
        played += [reference for robot in robots for reference in robot.prescribed.values()]
        corners = {time for reference in played for time in corner_times(reference)}
        return sorted(corners | {edge for force in self.forces.values() for edge in force.edges})

    def stepped(self, time: float) -> ClosedStation:
        """Return the diagram to be stepped from a time on [s], up to the next edge."""
        if self._blocks or self._watched:
            return self.whole
        pushes = [force for force in self.forces.values() if isinstance(force, Push)]
        only_pushes = self._station.engine.holds_inputs_over_steps and pushes and len(pushes) == len(self.forces)
        if only_pushes and not any(push.start <= time < push.end for push in pushes):
            return self._unpushed
        return self._lean

    @cached_property
    def whole(self) -> ClosedStation:
        """The diagram with everything but monitors."""
        return self._built(sensors=list(self._station.sensors))

    @cached_property
    def _lean(self) -> ClosedStation:
        """The diagram without sensors that only report."""
        return self.whole if len(self._stepped_sensors) == len(self._station.sensors) else self._built()

    @cached_property
    def _unpushed(self) -> ClosedStation:
        """The diagram without forces, too."""
        return self._built(forces=False)

    @property
    def _stepped_sensors(self) -> list[str]:
        return sorted(sensors_read(readers_of(self._station.config.controllers), self._station.sensors))

    def _built(self, *, sensors: list[str] | None = None, forces: bool = True) -> ClosedStation:
        kept = self._stepped_sensors if sensors is None else sensors
        leave = {"forces": forces, "monitors": False, "lean": not self._watched}
        made = closed_station(self._station, self.references, sensors=kept, blocks=self._blocks, **leave)
        made.play_forces(self.forces)  # which may be others by now than the station's own
        return made


Hands: TypeAlias = Mapping[str, Callable[[float], Sequence[float] | None]]
"""Functions that command controllers, by the name of the controller.

A function gets the time [s] and returns the numbers of the controller's command, such as the speeds ahead and to the
left [m/s] and the turn [rad/s] of a walk. None leaves the command as it is.
"""


class TakesCommands(Protocol):
    """The block of a controller that takes commands."""

    def command_by_hand(self, context: Context, values: Sequence[float]) -> None:
        """Make a command hold from the next sample on. The context of the block is changed."""


class ByHand:
    """Passes commands to controllers during a run, after each accepted step. They act from the next sample on."""

    def __init__(self, config: StationConfig, hands: Hands | None, *, begin: float = 0.0) -> None:
        """Take the functions that command the controllers of a station.

        Args:
            config: the station.
            hands: the functions by the name of the controller; None if there are none.
            begin: start of the run [s].

        Raises:
            InvalidParameter: `hands` is no mapping of names to functions.
            UnknownName: no controller of this name takes commands.
        """
        self._begin = begin
        self._hands = (
            {}
            if hands is None
            else instance(
                hands, "commands", Mapping, message("simulation.commands_by_controller", "a mapping by controller")
            )
        )
        self._sections = commanded_sections(config.controllers)
        self._commands: dict[str, list[TimedCommand]] = {}  # commands up to now, by controller
        for name, ask in self._hands.items():
            one_of(
                message("simulation.controller_with_commands", "controller that takes commands"), name, self._sections
            )
            if not callable(ask):
                raise InvalidParameter(
                    message("simulation.commands_of", "commands: {name}", name=name),
                    ask,
                    message("simulation.function_of_time", "a function of the time"),
                )

    def look(self, diagram: Diagram, context: Context) -> None:
        """Call the functions for commands, and pass on the commands that have changed.

        At the start of the run no function is called: the first sample of a controller is not yet taken, and would
        drop the command.

        Args:
            diagram: the diagram that is stepped.
            context: its context, which is changed.

        Raises:
            InvalidParameter: a function returns something that is no command.
        """
        time = context.get_time()
        if time <= self._begin:
            return
        for name, ask in self._hands.items():
            answer = ask(time)
            if answer is None:
                continue
            section = self._sections[name]
            command = section.rounded_command(_checked_command(section, name, time, answer))
            earlier = self._commands.setdefault(name, [])
            if earlier and earlier[-1].values == command.values:
                continue
            earlier.append(command)
            block = diagram.GetSubsystemByName(f"controller.{name}")
            own_context = block.GetMyMutableContextFromRoot(context)
            cast(TakesCommands, block).command_by_hand(own_context, command.values)

    def commanded(self, config: StationConfig) -> StationConfig:
        """Copy a configuration with the commands of this run in its controllers, so that its run repeats this one.

        Args:
            config: configuration of the station of this run.
        """
        if not self._commands:
            return config
        controllers = dict(config.controllers)
        for name, commands in self._commands.items():
            controllers[name] = controllers[name].with_commands(commands)
        return config.model_copy(update={"controllers": controllers})

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the controllers that were commanded."""
        return tuple(self._commands)


def _checked_command(section: ControllerSection, name: str, time: float, answer: Sequence[float]) -> TimedCommand:
    """Check the value that a user's function returned as a command, and make the command.

    Args:
        section: section of the controller.
        name: name of the controller.
        time: time of the run [s].
        answer: value that the function returned.

    Raises:
        InvalidParameter: the value does not have the finite numbers of the controller's command.
    """
    values = numbers(answer)
    parts = section.command_parts
    if values.shape != (len(parts),) or not np.isfinite(values).all():
        described = join_texts((compound("{part} [{unit}]", part=part.name, unit=part.unit) for part in parts), ", ")
        expected = message(
            "simulation.list_of_numbers",
            "a list of {count} numbers: {described}",
            count=len(parts),
            described=described,
        )
        raise InvalidParameter(
            message("simulation.commands_at", "commands: {name} at {time:g} s", name=name, time=time),
            quoted(answer),
            expected,
        )
    return TimedCommand(time, tuple(values.tolist()))
