"""The commands that run and draw stations: demo, run, diagram."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, cast

import typer

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.folders import check_new_file
from simrob_drake.base.messages import message
from simrob_drake.cli import ExitCode
from simrob_drake.cli.arguments import refuse, station_from
from simrob_drake.cli.language import with_output_language
from simrob_drake.cli.options import (
    AllowCode,
    Force,
    LanguageOptions,
    Saving,
    Settings,
    StationArgument,
    completed_station,
    with_language,
    with_mesh_path,
    with_saving,
)
from simrob_drake.cli.programs import (
    is_language_file,
    language_program,
    own_program,
    program_from,
    refuse_language,
    run_program,
)
from simrob_drake.cli.saving import Frames, exit_code, prepared_folder, saved, wait_for_watcher
from simrob_drake.cli.screen import console, say, say_text
from simrob_drake.cli.tables import convergence_table
from simrob_drake.programs.program_files import is_program_file
from simrob_drake.results.result import SimulationResult
from simrob_drake.simulation import simulate
from simrob_drake.stations.config import StationConfig


@with_output_language
@with_mesh_path
@with_saving
@with_language
def run(
    *,
    station: Annotated[
        str,
        typer.Argument(
            metavar="STATION|PROGRAM",
            help=message(
                "cli.help_run_station", "A name from `simrob list`, the YAML file of either, or a RAPID module."
            ),
            autocompletion=completed_station,
        ),
    ],
    duration: Annotated[
        float | None,
        typer.Option(help=message("cli.help_run_duration", "Simulated time [s], in place of the station's.")),
    ] = None,
    set_: Settings = None,
    saving: Saving,
    frames: Annotated[
        str | None,
        typer.Option(
            metavar="N|events",
            help=message("cli.help_run_frames", "Pictures of the film strip; events by default for programs, else 7."),
        ),
    ] = None,
    converge: Annotated[
        bool,
        typer.Option(
            "--converge", help=message("cli.help_run_converge", "Run again ten times tighter and print the difference.")
        ),
    ] = False,
    allow_code: AllowCode = False,
    language: LanguageOptions,
) -> int:
    """Run a station, or a program on the station that it names, and save signals, plots and a recording.

    For example:

        simrob run irb120_dynamic --duration 2 --out runs/first

        simrob run irb120_dynamic --set servo.kp=300 --set servo.kd=30

        simrob run program.yaml --set servo.kp=50

        simrob run Module.mod --robot irb120
    """
    shown = _frames(frames)
    if is_language_file(station):
        refuse(
            message("cli.program_has_duration", "a program has its own duration and names no code"),
            duration=duration,
            converge=converge,
            allow_code=allow_code,
        )
        program, config, lines = language_program(Path(station), language, set_)
        return run_program(program, config, saving, shown, lines=lines)
    refuse_language(language)
    if is_program_file(station):
        refuse(
            message("cli.program_has_duration", "a program has its own duration and names no code"),
            duration=duration,
            converge=converge,
            allow_code=allow_code,
        )
        program, config = program_from(station, set_)
        return run_program(program, config, saving, shown, station)
    config = station_from(station, set_, allow_code=allow_code, duration=duration)
    if config.program is not None:
        refuse(
            message("cli.station_has_program", "the station has a program (--set program=null runs its reference)"),
            duration=duration,
            converge=converge,
        )
        return run_program(own_program(config), config, saving, shown)
    prepared = prepared_folder(config, saving)
    result = _simulated(config, saving.live)
    code = saved(result, prepared, saving, frames=shown)
    return _converged(result) if converge and code == ExitCode.DONE else code


def demo(
    out: Annotated[
        Path, typer.Option(help=message("cli.help_demo_out", "Folder of the result, which is replaced."))
    ] = Path("runs/demo"),
) -> int:
    """Run the main job: an IRB120 moves by joint torque; the recording opens in any browser."""
    config = station_from("irb120_dynamic", None)
    saving = Saving(out=out, force=True)
    prepared = prepared_folder(config, saving)
    return saved(_simulated(config, live=False), prepared, saving)


@with_mesh_path
def diagram(
    station: StationArgument,
    out: Annotated[
        Path | None,
        typer.Option(
            help=message("cli.help_diagram_out", "FILE.svg, .png, .pdf, .dot or .mmd; DOT on the screen unless given.")
        ),
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
    check_new_file(out, force=force)
    say(str(save_block_picture(config, out)))


def _frames(text: str | None) -> Frames:
    """Read the value of the option ``--frames``.

    Raises:
        InvalidParameter: the value is neither a number of at least 2 nor ``events``.
    """
    if text is None or text == "events":
        return cast(Frames, text)
    if not text.isdecimal() or int(text) < 2:
        raise InvalidParameter("--frames", text, message("cli.two_or_events", 'a number of at least 2, or "events"'))
    return int(text)


def _simulated(config: StationConfig, live: bool) -> SimulationResult:
    """Simulate a station. If `live` is set, show the motion in the browser and let the user steer it."""
    if not live:
        return simulate(config)
    from simrob_drake.results.animation.live import LiveView, Steering

    steering = Steering(config)
    view = LiveView(config, steering=steering)
    wait_for_watcher(view.url)
    try:
        result = simulate(config, progress=False, on_step=view.on_step, commands=steering.hands)
        view.say(result.end_in_words)
        return result
    finally:
        view.close()


def _converged(result: SimulationResult) -> ExitCode:
    """Run a station again with ten times tighter accuracy, and show the differences.

    Returns:
        exit code of the tighter run.
    """
    if not result.config.engine.moves_by_forces:
        text = message(
            "cli.no_solver_to_converge",
            "--converge has no effect: a kinematic station has no solver whose accuracy could be tightened",
        )
        say_text(text)
        return ExitCode.DONE
    tight = simulate(result.config.model_copy(update={"solver": result.config.solver.tighter()}))
    console.print(convergence_table(result, tight))
    return exit_code(tight)


COMMANDS: dict[str, Callable[..., Any]] = {"demo": demo, "run": run, "diagram": diagram}
