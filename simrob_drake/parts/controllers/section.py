"""Base of all controllers of a station file: what a controller offers to runs, programs, results and the live view.

The toolbox asks these questions of every controller, so a controller of an extension answers them as its own do.
"""

from collections.abc import Mapping, Sequence
from typing import ClassVar, NamedTuple, Self

from simrob_drake.base.frames import Vector
from simrob_drake.base.sections import Strict
from simrob_drake.parts.resolved import ResolvedRobot


class CommandPart(NamedTuple):
    """One number of a controller's commands.

    Attributes:
        name: name of the number. Changes of programs (``drive``) set the numbers ``ahead``, ``left`` and ``turn``.
        unit: unit of the number.
        label: label of its slider in the live view, with the unit of the slider and the keys that move it.
        keys: keys of a browser that move the slider down and up, such as ``("ArrowDown", "ArrowUp")``.
        slider_unit: size of the slider's unit in the unit of the number: pi/180 if the slider shows degrees of a number
            in radians.
    """

    name: str
    unit: str
    label: str
    keys: tuple[str, str] = ("", "")
    slider_unit: float = 1.0


class TimedCommand(NamedTuple):
    """A command and the time of the run [s] from which on it holds."""

    time: float
    values: tuple[float, ...]


class ControllerSection(Strict):
    """A section of ``controllers``.

    A controller that is commanded during a run sets ``command_parts`` and implements the four methods of commands. Its
    block has a method ``command_by_hand(context, values)``, which makes the numbers (k,) hold from the next sample on.

    Attributes:
        kind: name of the controller's class in a station file.
    """

    runs_code: ClassVar[bool] = False
    """Whether the section names Python code of the user's that is run. It is loaded only where this is allowed."""
    is_flow: ClassVar[bool] = False
    """Whether it is a net of blocks that acts on torques, forces and the end of the run, below all loops."""
    command_parts: ClassVar[tuple[CommandPart, ...]] = ()
    """Numbers of a command, in order. Empty if the controller takes no commands during a run."""
    command_key: ClassVar[str] = ""
    """Key of the section that contains the commands of `with_commands`."""
    remarks: ClassVar[Mapping[str, str]] = {}
    """Sentences for the summary of a run, by the name of an output: "NAME SENTENCE: 1.20 to 1.50 s" tells at which
    times this output was not zero."""
    camera_follows: ClassVar[bool] = False
    """Whether the camera of the live view goes with the robot of the controller, as it does with a robot that walks."""

    kind: str

    @property
    def robot_name(self) -> str | None:
        """Robot that the section names under ``robot``. None if it names none, which means the only robot."""
        return getattr(self, "robot", None)

    def command_limits(self, robot: ResolvedRobot) -> Sequence[tuple[float, float]]:
        """Lower and upper limit of each slider of the live view, in the slider's unit, in the order of `command_parts`.

        Args:
            robot: robot of the controller.
        """
        raise NotImplementedError

    def command_at(self, time: float) -> tuple[float, ...]:
        """Command that the section itself gives at a time of a run [s]: the numbers in the order of `command_parts`."""
        raise NotImplementedError

    def rounded_command(self, command: TimedCommand) -> TimedCommand:
        """Round a command to what the section's file can hold, so that a run of the file gets equal numbers."""
        return command

    def with_commands(self, commands: Sequence[TimedCommand]) -> Self:
        """Copy the section with these commands.

        Its own commands before the first of them are kept, later ones are dropped.

        Args:
            commands: commands in the order of their times, at least one, as `rounded_command` returns them.
        """
        raise NotImplementedError

    def cell_times(self, groups: Sequence[Vector]) -> list[float | None] | None:
        """Times at which the controller reached its cells, for the result of a run.

        Args:
            groups: discrete state of the controller's block at the end of the run, one vector for each group.

        Returns:
            for each cell the time since the controller's start [s], or None if the cell was not reached. None in place
            of the list if the controller has no cells.
        """
        return None

    def distances_at_end(self, robot: ResolvedRobot, positions: Vector) -> Vector | None:
        """Distances of the axes from a posture of the controller, which the verdict judges at the end of a run.

        Args:
            robot: robot of the controller.
            positions: positions of its axes at the end, shape (n,) [rad or m].

        Returns:
            distances, not negative, shape (n,) [rad or m]. None if the controller has no posture of its own: then the
            verdict compares the axes with their reference.
        """
        return None


def commanded_sections(controllers: Mapping[str, "ControllerSection"]) -> dict[str, "ControllerSection"]:
    """The controllers that take commands during a run, by name."""
    return {name: section for name, section in controllers.items() if section.command_parts}
