"""The commands about legged robots: walk, act."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from simrob_drake.cli.arguments import station_from
from simrob_drake.cli.options import Saving, Settings, StationArgument, with_mesh_path, with_saving
from simrob_drake.cli.saving import prepared_folder, saved, wait_for_watcher
from simrob_drake.errors import InvalidParameter
from simrob_drake.results.record.walks import legged_robots, locomotion
from simrob_drake.results.result import SimulationResult
from simrob_drake.stations.config import StationConfig

if TYPE_CHECKING:
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
    config = _own_timing(station, set_)
    folder = prepared_folder(config, saving)
    result, way = _performed(config, robot, saving.live, lambda who: who.walk(steps, amplitude, gait))
    return saved(result, folder, saving, more=way)


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
    config = _own_timing(station, set_)
    folder = prepared_folder(config, saving)
    result, way = _performed(config, robot, saving.live, lambda who: who.act(name))
    return saved(result, folder, saving, more=way)


def _performed(
    config: StationConfig, robot: str | None, live: bool, perform: "Callable[[LeggedRobot], SimulationResult]"
) -> tuple[SimulationResult, str]:
    """Let a robot of a station do something; return the run, and the robot's way in words."""
    from simrob_drake.programs.arm import Workcell
    from simrob_drake.programs.legged_robot import LeggedRobot  # few commands need programs, which load scipy

    cell = Workcell(config)
    cell.progress = not live
    who = LeggedRobot(cell, robot)
    if live:
        wait_for_watcher(cell.show())
    try:
        result = perform(who)
        return result, way_of(result, who.name)
    finally:
        cell.close()


def _own_timing(station: str, settings: list[str] | None) -> StationConfig:
    """Return a station with changes, but for those that would do nothing: the gait decides on them."""
    for setting in settings or []:
        if setting.split("=")[0].split(".")[0].strip() in ("duration", "reference"):
            raise InvalidParameter(
                f"--set {setting}", "given", "left out: the gait or act says how the robot moves, and how long"
            )
    return station_from(station, settings)


def way_of(result: SimulationResult, robot: str) -> str:
    """Return how far a robot came, and how it turned, in words; nothing of one that cannot tell."""
    if result.ending == "diverged" or robot not in legged_robots(result):
        return ""
    found = locomotion(result, robot)
    turn = np.rad2deg(found.yaw)
    way = f"{found.distance:.3f} m at {found.speed:.3f} m/s on average, {found.ahead:.3f} m ahead"
    side = f"{abs(found.drift):.3f} m to the {'left' if found.drift >= 0 else 'right'}"
    return f"{robot} came {way} and {side}, and turned by {abs(turn):.1f} deg to the {'left' if turn >= 0 else 'right'}"


COMMANDS: dict[str, Callable[..., Any]] = {"walk": walk, "act": act}
