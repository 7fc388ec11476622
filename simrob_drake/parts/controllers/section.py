"""Base of all controllers of a station file: what a controller offers to runs, programs, results and the live view.

Runs, programs, results and the live view only use the members of this class. So they need not know any kind of
controller, and a controller of an extension works in them like those of this package.

A controller may be *commanded* during a run, as a walk is by a speed: by a program, or by hand on sliders of the live
view. A controller with *cells*, such as a sequencer, goes through them one after the other.
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
        keys: keys of a browser that move the slider down and up, such as ``("ArrowDown", "ArrowUp")``; empty texts if
            no keys do.
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
    """Whether it is a signal flow: a net of blocks that acts on torques, forces and the end of the run. All loops act
    on references, and so are above it."""
    command_parts: ClassVar[tuple[CommandPart, ...]] = ()
    """Numbers of which a command consists, in order. Empty if the controller takes no commands during a run."""
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
        """Robot that the section names under ``robot``. None if it names none.

        In a section with this key, None means the only robot. A section without it drives no robot of the station, or
        all of them.
        """
        # Not all kinds of controller have the key.
        return getattr(self, "robot", None)

    def command_limits(self, robot: ResolvedRobot) -> Sequence[tuple[float, float]]:
        """Lower and upper limit of each slider of the live view.

        Args:
            robot: robot of the controller.

        Returns:
            The limits in the slider's unit, in the order of `command_parts`.
        """
        # Only a controller with `command_parts` needs it. So do the other methods of commands.
        raise NotImplementedError

    def command_at(self, time: float) -> tuple[float, ...]:
        """Command that the section itself gives, in the order of `command_parts`.

        Args:
            time: time of the run [s].
        """
        raise NotImplementedError

    def rounded_command(self, command: TimedCommand) -> TimedCommand:
        """Round a command to the digits that the section's file keeps."""
        # A run rounds a command before it applies it: a later run of the file then gets the same numbers.
        return command

    def with_commands(self, commands: Sequence[TimedCommand]) -> Self:
        """Copy the section with commands that a user or a program gave during a run, to save them in a station file.

        The section's own commands before the first given one are kept, its later ones are dropped.

        Args:
            commands: commands in the order of their times, at least one, as `rounded_command` returns them.
        """
        raise NotImplementedError

    def cell_times(self, groups: Sequence[Vector]) -> list[float | None] | None:
        """Times at which the controller reached its cells, for the result of a run.

        Args:
            groups: discrete state of the controller's block at the end of the run, one vector for each group of Drake's
                discrete state.

        Returns:
            For each cell the time since the controller's start [s], or None if the cell was not reached. None in place
            of the list if the controller has no cells.
        """
        return None  # the controller has no cells unless a subclass says otherwise

    def distances_at_end(self, robot: ResolvedRobot, positions: Vector) -> Vector | None:
        """Distances of the axes from a posture of the controller at the end of a run, which the run's verdict judges.

        Args:
            robot: robot of the controller.
            positions: positions of its axes at the end, shape (n,) [rad or m].

        Returns:
            Distances, not negative, shape (n,) [rad or m]. None if the controller has no posture of its own: then the
            verdict compares the axes with their reference.
        """
        return None


def commanded_sections(
    controllers: Mapping[str, ControllerSection],
) -> dict[str, ControllerSection]:
    """Select the controllers that take commands during a run, by name."""
    return {name: section for name, section in controllers.items() if section.command_parts}
