"""The commands about legged robots: walk, act."""

from collections.abc import Callable, Mapping
from functools import cache
from typing import TYPE_CHECKING, Annotated, Any

import typer

from simrob_drake.base.errors import InvalidParameter, SimrobError, Unsuitable
from simrob_drake.base.messages import compound, join_texts, message
from simrob_drake.cli import ExitCode
from simrob_drake.cli.arguments import changes_of, station_from
from simrob_drake.cli.options import (
    OptionalStation,
    Saving,
    Settings,
    with_mesh_path,
    with_saving,
)
from simrob_drake.cli.saving import done_in_workcell, locomotion_sentence
from simrob_drake.cli.screen import NEXT, say_place, say_text
from simrob_drake.results.result import SimulationResult
from simrob_drake.stations.load import load_station, station_names

if TYPE_CHECKING:
    from simrob_drake.programs.arm import Workcell
    from simrob_drake.programs.legged_robot import LeggedRobot
    from simrob_drake.programs.moves.move import Move

RobotOption = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help=message(
            "cli.help_robot_option", "Robot of the station; required if the station has several."
        ),
    ),
]


@with_mesh_path
@with_saving
def walk(
    *,
    station: OptionalStation = None,
    gait: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help=message(
                "cli.help_walk_gait", "Gait of the robot; by default the first one for its feet."
            ),
        ),
    ] = None,
    steps: Annotated[
        int,
        typer.Option(
            help=message(
                "cli.help_walk_steps",
                "Distance ahead, in full step lengths; shorter steps are added at both ends.",
            )
        ),
    ] = 6,
    amplitude: Annotated[
        float,
        typer.Option(
            help=message(
                "cli.help_walk_amplitude", "Factor for the lengths and the turns of the steps."
            )
        ),
    ] = 1.0,
    step_time: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            help=message(
                "cli.help_walk_step_time", "Duration of each step [s]; by default that of the gait."
            ),
        ),
    ] = None,
    robot: RobotOption = None,
    set_: Settings = None,
    saving: Saving,
) -> int:
    """Make a legged robot walk, and save what `simrob run` saves.

    The robot takes the posture in which its gait begins, and walks; the gait decides how long that takes. If the robot
    does not have the gait, the message lists its gaits. To do several walks and acts one after the other, write them in
    a program.yaml, and run it with `simrob run program.yaml`.

    For example:

        simrob walk humanoid_dynamic --steps 4

        simrob walk yobotics_dynamic --gait crawl --amplitude 0.5 --live
    """
    if station is None:
        raise _missing_station("simrob walk", with_steps=True)

    def walk_of_options() -> "Move":
        """Make the walk. Raises InvalidParameter if an option has a wrong value."""
        # Few commands need programs, which load scipy.
        from simrob_drake.programs.moves.move import make_move
        from simrob_drake.programs.moves.walk import WalkMove

        # The gait keeps its own step time unless the user gives one: None would be a wrong value.
        changes: dict[str, Any] = {} if step_time is None else {"step_time": step_time}
        return make_move(WalkMove, steps=steps, amplitude=amplitude, gait=gait, **changes)

    return _do_move(
        station, set_, robot, saving, walk_of_options, entry=f"walk: {{steps: {steps}}}"
    )


@with_mesh_path
@with_saving
def act(
    *,
    station: OptionalStation = None,
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="[ACT]",
            help=message(
                "cli.help_act_name",
                "Act of the robot, such as `bow`. Without a name, the acts of the robot are listed.",
            ),
        ),
    ] = None,
    robot: RobotOption = None,
    set_: Settings = None,
    saving: Saving,
) -> int:
    """Make a legged robot go through postures or stand on three legs, and save what `simrob run` saves.

    Without the name of an act, the acts of the robot are listed; without a station, the stations whose robots have
    acts. To do several walks and acts one after the other, write them in a program.yaml, and run it with
    `simrob run program.yaml`.

    For example:

        simrob act humanoid_dynamic

        simrob act humanoid_dynamic bow

        simrob act yobotics_dynamic three_legs --live
    """
    if station is None:
        raise _missing_station("simrob act", with_steps=False)
    if name is None:
        return _list_acts(station, set_, robot)
    act_name = name

    def act_of_name() -> "Move":
        """Make the act."""
        # Few commands need programs, which load scipy.
        from simrob_drake.programs.moves.move import make_move
        from simrob_drake.programs.moves.walk import ActMove

        return make_move(ActMove, name=act_name)

    return _do_move(station, set_, robot, saving, act_of_name, entry=f"act: {name}")


def _missing_station(command: str, *, with_steps: bool) -> SimrobError:
    """Make the error for a command without a station: the stations of the package on which it works.

    Args:
        command: the command, such as ``simrob act``.
        with_steps: whether the command needs a gait that consists of steps.
    """
    names = _stations_with_gaits(with_steps=with_steps)
    # The stations named <robot>_dynamic are the plain ones, so one of them is the example.
    # Others, such as humanoid_walking, have controllers or obstacles of their own.
    example = next((name for name in names if name.endswith("_dynamic")), names[0])
    text = message(
        "cli.name_a_station",
        "{command} needs the name of a station, for example: {command} {example}. Suitable stations: {names}",
        command=command,
        example=example,
        names=", ".join(names),
    )
    return SimrobError(text)


def _stations_with_gaits(*, with_steps: bool) -> list[str]:
    """Names of the package's stations on which a robot has a gait.

    Args:
        with_steps: whether gaits that consist of steps are meant, which need a floor and contact forces. Otherwise the
            acts are meant, which a robot also does on a kinematic station.
    """
    # Few commands need programs, which load scipy.
    from simrob_drake.programs.gaits.registry import gaits_of

    @cache
    def has_gaits(model: str) -> bool:
        """Whether a robot of the package, given by name, has gaits of this kind."""
        try:
            return bool(gaits_of(model, steps=with_steps))
        # The robot has no file of gaits.
        except InvalidParameter:
            return False

    found = []
    for name in station_names():
        config = load_station(name)
        # Contact forces move a robot that steps: a station without a floor, or a kinematic one, has none.
        can_walk = config.engine.moves_by_forces and config.contact is not None
        models = [robot.model for robot in config.robots.values() if robot.model is not None]
        if (can_walk or not with_steps) and any(has_gaits(model) for model in models):
            found.append(name)
    return found


def _list_acts(station: str, settings: list[str] | None, robot: str | None) -> ExitCode:
    """List the acts of a robot of a station, and show how to call one.

    Args:
        station: name or file of the station.
        settings: changes of the station, as the option ``--set`` takes them.
        robot: name of the robot. None if the station has only one.

    Raises:
        SimrobError: the station or a change is wrong, the station has no such robot, or has several and none is named,
            or the robot has no acts.
    """
    # Few commands need programs, which load scipy.
    from simrob_drake.programs.arm import Workcell
    from simrob_drake.programs.gaits.registry import gaits_of

    cell = Workcell(station_from(station, settings))
    model = cell.robot(cell.robot_name(robot)).model
    acts = list(gaits_of(model, steps=False))
    if not acts:
        problem = message("cli.no_acts", "{robot} has no acts", robot=model.name)
        raise Unsuitable(station, problem)
    # The next command is shown with an act that the robot has, so that a user can copy it.
    names = ", ".join(acts)
    say_text(
        message("cli.acts_of_robot", "acts of {robot}: {names}", robot=model.name, names=names)
    )
    say_place(NEXT, f"simrob act {station} {acts[0]}")
    return ExitCode.DONE


def _steps_taken(legged_robot: "LeggedRobot", move: "Move") -> str:
    """Sentence about the count of steps of a walk that begins and ends with shorter steps.

    It is empty for any other move, and for a gait without shorter steps, such as a crawl.

    Args:
        legged_robot: the robot.
        move: the move, which the robot can do.
    """
    from simrob_drake.programs.gaits.phases import ramp_shares
    from simrob_drake.programs.gaits.registry import first_gait, gaits_of
    from simrob_drake.programs.moves.walk import WalkMove

    if not isinstance(move, WalkMove):
        return ""
    steps = move.steps
    gaits = gaits_of(legged_robot.model, steps=True)
    name = move.gait
    if name is None:
        name = first_gait(legged_robot.model, legged_robot.worn_feet, gaits)
    # Gaits without full steps of one length, such as a crawl, have no such key.
    ramp_steps = getattr(gaits[name], "ramp_steps", 0)
    if not ramp_steps:
        return ""
    # The shorter steps are extra steps: without a remark, a user who asks for 6 steps would count 10.
    taken = len(ramp_shares(steps, ramp_steps))
    return message(
        "cli.steps_taken",
        "it took {taken} steps for the distance of {steps} full {steps:step|steps}: the "
        "steps grow at the start and shrink at the end",
        taken=taken,
        steps=steps,
    )


def _do_move(
    station: str,
    settings: list[str] | None,
    robot: str | None,
    saving: Saving,
    make: "Callable[[], Move]",
    *,
    entry: str,
) -> ExitCode:
    """Do a move with a robot of a station, save and show the run, and show how a program has several moves.

    Args:
        station: name or file of the station.
        settings: changes of the station, as the option ``--set`` takes them.
        robot: name of the robot. None if the station has only one.
        saving: how the run is shown and saved.
        make: makes the move. It may raise an error about an option of the command.
        entry: the move as an entry of a program's file, such as ``act: bow``.

    Returns:
        exit code of the run.

    Raises:
        Unsuitable: a change is of the duration or the reference, which the move decides.
        SimrobError: another change is wrong, or the robot cannot do the move.
    """
    _refuse_changes_of_motion(settings)

    def prepare(cell: "Workcell") -> Callable[[], tuple[SimulationResult, str]]:
        """Plan the move in the workcell. Returns the function that does the move."""
        from simrob_drake.programs.legged_robot import LeggedRobot
        from simrob_drake.programs.stages import stages_of

        legged_robot = LeggedRobot(cell, robot)
        move = make()
        # The plan is made here, so that a wrong name or a step out of reach is reported before the user opens the
        # browser. One move is one stage, which keeps the plan until it runs.
        [stage] = stages_of(legged_robot, [move], cell.config)

        def do_move() -> tuple[SimulationResult, str]:
            """Do the move. Returns the run, and the sentences about it, joined."""
            result = stage.run(legged_robot)
            # Only an action without a run, such as attaching a piece, has no result.
            assert result is not None
            sentences = [
                locomotion_sentence(result, legged_robot.name),
                _steps_taken(legged_robot, move),
            ]
            return result, join_texts([sentence for sentence in sentences if sentence], "; ")

        return do_move

    code = done_in_workcell(station_from(station, settings), saving, prepare)
    # Users who want several moves would otherwise look for an option of this command.
    say_text(
        message(
            "cli.chain_moves",
            "for several moves, list them in a program.yaml (moves: [{entry}, ...]) and run "
            "it: simrob run program.yaml",
            entry=f"{{{entry}}}",
        ),
        "dim",
    )
    return code


def _refuse_changes_of_motion(settings: list[str] | None) -> None:
    """Check that no change of a station is one that a gait or an act would overwrite.

    Args:
        settings: changes of the station, as the option ``--set`` takes them.

    Raises:
        Unsuitable: a change is of the duration or the reference.
        SimrobError: a change has another form, or its file cannot be read.
    """
    for setting in settings or []:
        # The keys are read as for the station: a setting may be a YAML file, whose name says nothing about its keys.
        for key, value in changes_of([setting], "--set").items():
            if not _sets_motion(key, value):
                continue
            option: str = message("cli.set_option", "--set {setting}", setting=setting)
            # The setting is a file, so the user needs the key in it, too.
            if "=" not in setting:
                option = compound("{option}: {key}", option=option, key=key)
            raise Unsuitable(
                option,
                message(
                    "cli.gait_says_how",
                    "the gait or act decides how the robot moves, and for how long",
                ),
            )


def _sets_motion(key: str, value: object) -> bool:
    """Whether a change of a station sets its duration, or the reference of the station or of a robot.

    Args:
        key: dotted key of the change.
        value: the new value. The value of a section is a mapping.
    """
    path = key.split(".")
    if isinstance(value, Mapping) and value:
        return any(_sets_motion(f"{key}.{name}", part) for name, part in value.items())
    # The section of a robot is `robot`, or `robots.<name>`: so many words stand in front of its own keys.
    word_count = {"robot": 1, "robots": 2}.get(path[0])
    if word_count is None:
        return path[0] in ("duration", "reference")
    return len(path) > word_count and path[word_count] == "reference"


COMMANDS: dict[str, Callable[..., Any]] = {"walk": walk, "act": act}
