"""The commands about stations: run, check, diagram."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, cast

import typer

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.cli import ExitCode
from simrob_drake.cli.arguments import check_file, is_program_file, refuse, refuse_import, station_from
from simrob_drake.cli.options import (
    AllowCode,
    Force,
    RapidOptions,
    Saving,
    Settings,
    StationArgument,
    completed_station,
    with_import_options,
    with_mesh_path,
    with_rapid,
    with_saving,
)
from simrob_drake.cli.programs import (
    check_program,
    is_rapid_file,
    module_program,
    own_program,
    program_from,
    refuse_rapid,
    run_program,
)
from simrob_drake.cli.robots import examine_file, show_robot
from simrob_drake.cli.saving import Frames, exit_code, prepared_folder, saved, wait_for_watcher
from simrob_drake.cli.screen import console, say
from simrob_drake.cli.simulink import (
    ModelReading,
    examine_model,
    is_model_file,
    model_options,
    refuse_model,
    with_model_reading,
)
from simrob_drake.cli.tables import convergence_table, findings_table
from simrob_drake.importer.options import ImportOptions
from simrob_drake.importer.packages import is_robot_file
from simrob_drake.results.result import SimulationResult
from simrob_drake.robots.catalog import load_robot, load_robot_file, robot_names
from simrob_drake.robots.description_files import is_description_file
from simrob_drake.simulation import Runner, simulate
from simrob_drake.stations.checks import check_station
from simrob_drake.stations.config import StationConfig


@with_mesh_path
@with_saving
@with_rapid
def run(
    *,
    station: Annotated[
        str,
        typer.Argument(
            metavar="STATION|PROGRAM",
            help="A name from `simrob list`, the YAML file of either, or a RAPID module.",
            autocompletion=completed_station,
        ),
    ],
    duration: Annotated[float | None, typer.Option(help="Simulated time [s], in place of the station's.")] = None,
    set_: Settings = None,
    saving: Saving,
    frames: Annotated[
        str | None, typer.Option(metavar="N|events", help="Of the film strip; events by default for programs, else 7.")
    ] = None,
    converge: Annotated[
        bool, typer.Option("--converge", help="Run again ten times tighter and print the difference.")
    ] = False,
    allow_code: AllowCode = False,
    rapid: RapidOptions,
) -> int:
    """Run a station, or a program on the station that it names, and save signals, plots and a recording.

    For example:

        simrob run irb120_dynamic --duration 2 --out runs/first

        simrob run irb120_dynamic --set servo.torque_limit=10 --set reference.duration=1.5

        simrob run program.yaml --set servo.kp=50

        simrob run Module.mod --robot irb120
    """
    shown = _frames(frames)
    if is_rapid_file(station):
        refuse("left out with a program", duration=duration, converge=converge, allow_code=allow_code)
        program, config, lines = module_program(Path(station), rapid, set_)
        return run_program(program, config, saving, shown, lines=lines)
    refuse_rapid(rapid)
    if is_program_file(station):
        refuse("left out with a program", duration=duration, converge=converge, allow_code=allow_code)
        program, config = program_from(station, set_)
        return run_program(program, config, saving, shown, station)
    config = station_from(station, set_, allow_code=allow_code, duration=duration)
    if config.program is not None:
        refuse(
            "left out with a station that has a program, or with --set program=null",
            duration=duration,
            converge=converge,
        )
        return run_program(own_program(config), config, saving, shown)
    folder = prepared_folder(config, saving)
    result = _simulated(config, saving.live)
    code = saved(result, folder, saving, frames=shown)
    return _converged(result) if converge and code == ExitCode.DONE else code


def demo(
    out: Annotated[Path, typer.Option(help="Folder of the result, which is replaced.")] = Path("runs/demo"),
) -> int:
    """Run the main job: an IRB120 moves by joint torque; the recording opens in any browser."""
    config = station_from("irb120_dynamic", None)
    saving = Saving(out=out, force=True)
    folder = prepared_folder(config, saving)
    return saved(_simulated(config, live=False), folder, saving)


@with_model_reading
@with_import_options("mesh_path", "estimate_inertia", "xacro_arg", "drop_loops")
def check(
    *,
    station: Annotated[
        str,
        typer.Argument(
            metavar="STATION|ROBOT|FILE",
            help="A station, a program, a robot or its file, a Simulink model, or a CAD assembly.",
        ),
    ],
    set_: Settings = None,
    options: ImportOptions | None,
    allow_code: AllowCode = False,
    reading: ModelReading,
) -> None:
    """Say before any run what will go wrong in a station, what a robot can carry, or what an import would do."""
    if is_model_file(station):
        examine_model(Path(station), model_options(options, reading, set_))
        return
    refuse_model(reading)
    choices = options and options.model_copy(update={"mesh_path": ()})
    if is_program_file(station):
        refuse_import("left out with a program: it goes with a robot's file", choices)
        refuse("left out with a program", allow_code=allow_code)
        program, config = program_from(station, set_)
        console.print(findings_table([check_program(program, config, station)]))
        return
    if is_robot_file(station):
        refuse("left out with a robot's file: it changes stations", set=set_, allow_code=allow_code)
        examine_file(Path(station), options)
        return
    if is_description_file(station):
        refuse("left out with a robot's file: it changes stations", set=set_, allow_code=allow_code)
        refuse_import("left out with a robot's description: it is no import", options)
        show_robot(load_robot_file(station))
        return
    if station in robot_names():
        refuse("left out with a robot: it changes stations", set=set_, allow_code=allow_code)
        refuse_import("left out with a robot of the package: it is no import", options)
        show_robot(load_robot(station))
        return
    refuse_import("left out with a station: it goes with a robot's file", choices)
    config = station_from(station, set_, allow_code=allow_code)
    Runner(config).check()
    own = [] if config.program is None else [check_program(own_program(config), config)]
    console.print(findings_table([*check_station(config), *own]))


@with_mesh_path
def diagram(
    station: StationArgument,
    out: Annotated[
        Path | None, typer.Option(help="FILE.svg, .png, .pdf, .dot or .mmd; DOT on the screen unless given.")
    ] = None,
    set_: Settings = None,
    force: Force = False,
    allow_code: AllowCode = False,
) -> None:
    """Draw the block structure of a station."""
    from simrob_drake.results.block_diagram.picture import save_block_picture, station_dot

    config = station_from(station, set_, allow_code=allow_code)
    if out is None:
        print(station_dot(config))
        return
    check_file(out, force=force)
    say(str(save_block_picture(config, out)))


def _frames(text: str | None) -> Frames:
    """Return how many frames a strip shall have; raises InvalidParameter: neither two or more nor "events"."""
    if text is None or text == "events":
        return cast(Frames, text)
    if not text.isdecimal() or int(text) < 2:
        raise InvalidParameter("--frames", text, 'a number of at least 2, or "events"')
    return int(text)


def _simulated(config: StationConfig, live: bool) -> SimulationResult:
    if not live:
        return simulate(config)
    from simrob_drake.results.animation.live import LiveView, Steering

    steering = Steering(config)
    view = LiveView(config, steering=steering)
    wait_for_watcher(view.url)
    try:
        result = simulate(config, progress=False, on_step=view.on_step, commands=steering.hands)
        view.say(result.message)
        return result
    finally:
        view.close()


def _converged(result: SimulationResult) -> ExitCode:
    """Show the difference to a tighter run, and return the exit code of that."""
    if not result.config.engine.moves_by_forces:
        console.print("a kinematic station has no solver: nothing to converge")
        return ExitCode.DONE
    tight = simulate(result.config.model_copy(update={"solver": result.config.solver.tighter()}))
    console.print(convergence_table(result, tight))
    return exit_code(tight)


COMMANDS: dict[str, Callable[..., Any]] = {"demo": demo, "run": run, "check": check, "diagram": diagram}
