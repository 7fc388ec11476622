"""The commands about legged robots: walk, act."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any

import typer

from simrob_drake.base.errors import Unsuitable
from simrob_drake.base.messages import message
from simrob_drake.cli import ExitCode
from simrob_drake.cli.arguments import station_from
from simrob_drake.cli.options import Saving, Settings, StationArgument, with_mesh_path, with_saving
from simrob_drake.cli.saving import done_in_workcell, way_of
from simrob_drake.results.result import SimulationResult

if TYPE_CHECKING:
    from simrob_drake.programs.arm import Workcell
    from simrob_drake.programs.legged_robot import LeggedRobot

RobotOption = Annotated[
    str | None, typer.Option(metavar="NAME", help="Which robot of the station; needed where there are several.")
]


@with_mesh_path
@with_saving
def walk(
    *,
    station: StationArgument,
    gait: Annotated[
        str | None, typer.Option(metavar="NAME", help="A gait of the robot; the first for its feet by default.")
    ] = None,
    steps: Annotated[int, typer.Option(help="How many step lengths ahead; shorter steps are added at both ends.")] = 6,
    amplitude: Annotated[float, typer.Option(help="Scales the length of the steps, and their turns.")] = 1.0,
    robot: RobotOption = None,
    set_: Settings = None,
    saving: Saving,
) -> int:
    """Let a legged robot walk, and save what `simrob run` saves.

    The robot takes the posture in which its gait begins, and goes. How long that takes is up to the gait. A gait that
    it does not have is answered with those that it has.

    For example:

        simrob walk humanoid_dynamic --steps 4

        simrob walk yobotics_dynamic --gait crawl --amplitude 0.5 --live
    """
    return _done(station, set_, robot, saving, lambda who: who.walk(steps, amplitude, gait))


@with_mesh_path
@with_saving
def act(
    *,
    station: StationArgument,
    name: Annotated[str, typer.Argument(metavar="ACT", help="An act of the robot, such as `bow` or `three_legs`.")],
    robot: RobotOption = None,
    set_: Settings = None,
    saving: Saving,
) -> int:
    """Let a legged robot go through postures or stand on three legs, and save what `simrob run` saves.

    An act that the robot does not have is answered with those that it has.

    For example:

        simrob act humanoid_dynamic bow

        simrob act yobotics_dynamic three_legs --live
    """
    return _done(station, set_, robot, saving, lambda who: who.act(name))


def _done(
    station: str,
    settings: list[str] | None,
    robot: str | None,
    saving: Saving,
    perform: "Callable[[LeggedRobot], SimulationResult]",
) -> ExitCode:
    """Let a robot of a station do something, and save it; changes are refused that the gait decides on."""
    for setting in settings or []:
        if setting.split("=")[0].split(".")[0].strip() in ("duration", "reference"):
            raise Unsuitable(
                message("cli.set_option", "--set {setting}", setting=setting),
                message("cli.gait_says_how", "the gait or act says how the robot moves, and how long"),
            )

    def prepared(cell: "Workcell") -> Callable[[], tuple[SimulationResult, str]]:
        from simrob_drake.programs.legged_robot import LeggedRobot

        who = LeggedRobot(cell, robot)
        return lambda: (result := perform(who), way_of(result, who.name))

    return done_in_workcell(station_from(station, settings), saving, prepared)


COMMANDS: dict[str, Callable[..., Any]] = {"walk": walk, "act": act}
