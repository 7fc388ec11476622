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
from simrob_drake.cli.screen import say_place, say_text
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
    steps: Annotated[
        int,
        typer.Option(help="Full step lengths ahead; at both ends shorter steps are added."),
    ] = 6,
    amplitude: Annotated[float, typer.Option(help="Scales the length of the steps, and their turns.")] = 1.0,
    robot: RobotOption = None,
    set_: Settings = None,
    saving: Saving,
) -> int:
    """Let a legged robot walk, and save what `simrob run` saves.

    The robot takes the posture in which its gait begins, and goes. How long that takes is up to the gait. A gait that
    it does not have is answered with those that it has. To do several walks and acts one after the other, write them in
    a program.yaml, and run it with `simrob run program.yaml`.

    For example:

        simrob walk humanoid_dynamic --steps 4

        simrob walk yobotics_dynamic --gait crawl --amplitude 0.5 --live
    """

    def perform(who: "LeggedRobot") -> tuple[SimulationResult, str]:
        result = who.walk(steps, amplitude, gait)
        return result, _steps_taken(who, gait, steps)

    return _done(station, set_, robot, saving, perform, entry=f"walk: {{steps: {steps}}}")


@with_mesh_path
@with_saving
def act(
    *,
    station: StationArgument,
    name: Annotated[
        str | None,
        typer.Argument(metavar="[ACT]", help="An act of the robot, such as `bow`. Without it, its acts are listed."),
    ] = None,
    robot: RobotOption = None,
    set_: Settings = None,
    saving: Saving,
) -> int:
    """Let a legged robot go through postures or stand on three legs, and save what `simrob run` saves.

    Without the name of an act, the acts of the robot are listed. To do several walks and acts one after the other,
    write them in a program.yaml, and run it with `simrob run program.yaml`.

    For example:

        simrob act humanoid_dynamic

        simrob act humanoid_dynamic bow

        simrob act yobotics_dynamic three_legs --live
    """
    if name is None:
        return _list_acts(station, set_, robot)
    act_name = name
    return _done(station, set_, robot, saving, lambda who: (who.act(act_name), ""), entry=f"act: {name}")


def _list_acts(station: str, settings: list[str] | None, robot: str | None) -> ExitCode:
    """List the acts of a robot of a station, and how to call one.

    Raises:
        SimrobError: the station has several robots and none is named, or the robot has no acts.
    """
    from simrob_drake.programs.arm import Workcell  # few commands need programs, which load scipy
    from simrob_drake.programs.gaits.registry import gaits_of

    cell = Workcell(station_from(station, settings))
    model = cell.robot(cell.robot_name(robot)).model
    acts = list(gaits_of(model, steps=False))
    if not acts:
        problem = message("cli.no_acts", "{robot} has no acts", robot=model.name)
        raise Unsuitable(station, problem)
    names = ", ".join(acts)
    say_text(message("cli.acts_of_robot", "acts of {robot}: {names}", robot=model.name, names=names))
    say_place("next   ", f"simrob act {station} {acts[0]}")
    return ExitCode.DONE


def _steps_taken(who: "LeggedRobot", gait: str | None, steps: int) -> str:
    """Say how many steps a walk took, if some are shorter than a full one. Empty otherwise.

    Args:
        who: the robot.
        gait: name of the gait, or None for the first one for its feet.
        steps: how many full step lengths it was to go.
    """
    from simrob_drake.programs.gaits.phases import ramp_shares
    from simrob_drake.programs.gaits.registry import first_gait, gaits_of

    gaits = gaits_of(who.model, steps=True)
    name = first_gait(who.model, who.worn_feet, gaits) if gait is None else gait
    ramp_steps = getattr(gaits[name], "ramp_steps", 0)
    taken = len(ramp_shares(steps, ramp_steps))
    if taken <= steps:
        return ""
    return message(
        "cli.steps_taken",
        "it took {taken} steps, which go as far as {steps} full ones: they grow at the start and shrink at the end",
        taken=taken,
        steps=steps,
    )


def _done(
    station: str,
    settings: list[str] | None,
    robot: str | None,
    saving: Saving,
    perform: "Callable[[LeggedRobot], tuple[SimulationResult, str]]",
    *,
    entry: str,
) -> ExitCode:
    """Let a robot of a station do a move, and save the run.

    Args:
        station: name or file of the station.
        settings: changes of the station.
        robot: name of the robot; None if the station has only one.
        saving: how the run is shown and saved.
        perform: does the move; returns the run and a sentence about it, which may be empty.
        entry: the move as an entry of a program's file.

    Raises:
        Unsuitable: a change is of a key that the move decides on.
    """
    for setting in settings or []:
        if setting.split("=")[0].split(".")[0].strip() in ("duration", "reference"):
            raise Unsuitable(
                message("cli.set_option", "--set {setting}", setting=setting),
                message("cli.gait_says_how", "the gait or act says how the robot moves, and how long"),
            )

    def prepared(cell: "Workcell") -> Callable[[], tuple[SimulationResult, str]]:
        from simrob_drake.programs.legged_robot import LeggedRobot

        who = LeggedRobot(cell, robot)

        def performed() -> tuple[SimulationResult, str]:
            result, remark = perform(who)
            sentences = [sentence for sentence in (way_of(result, who.name), remark) if sentence]
            return result, "; ".join(sentences)

        return performed

    code = done_in_workcell(station_from(station, settings), saving, prepared)
    say_text(
        message(
            "cli.chain_moves",
            "several moves: list them in a program.yaml (moves: [{entry}, ...]), and simrob run program.yaml",
            entry=f"{{{entry}}}",
        ),
        "dim",
    )
    return code


COMMANDS: dict[str, Callable[..., Any]] = {"walk": walk, "act": act}
