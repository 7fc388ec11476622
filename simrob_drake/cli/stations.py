"""The commands that run and draw stations: demo, run, diagram.

A *station* is a closed system of robots, controllers and pieces that one YAML file describes. A *program*, a list of
moves, runs on a station: it has a file of its own, a file in the language of a robot such as RAPID, or a section of the
station's file.
"""

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
from simrob_drake.cli.saving import (
    Frames,
    exit_code,
    prepared_folder,
    save_and_show,
    wait_for_watcher,
)
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
                "cli.help_run_station",
                "A name from `simrob list`, the YAML file of a station or a program, or a RAPID module.",
            ),
            autocompletion=completed_station,
        ),
    ],
    duration: Annotated[
        float | None,
        typer.Option(
            help=message(
                "cli.help_run_duration", "Simulated time [s], in place of that of the station."
            )
        ),
    ] = None,
    set_: Settings = None,
    saving: Saving,
    frames: Annotated[
        str | None,
        typer.Option(
            metavar="N|events",
            help=message(
                "cli.help_run_frames",
                "Frames of the film strip; by default events for programs, otherwise 7.",
            ),
        ),
    ] = None,
    converge: Annotated[
        bool,
        typer.Option(
            "--converge",
            help=message(
                "cli.help_run_converge",
                "Run again with ten times tighter accuracy, and show the difference.",
            ),
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
    # The value is read first: a wrong one should not be found only after a long run.
    film_frames = _read_frames(frames)
    # Options without an effect on this kind of file are refused, before anything is loaded from the file.
    is_in_language = is_language_file(station)
    is_program = not is_in_language and is_program_file(station)
    # These options would have no effect on a station or on a program in YAML.
    if not is_in_language:
        refuse_language(language)
    # The moves of a program take as long as they need, and its file names no code that could be allowed.
    if is_in_language or is_program:
        refuse(
            message(
                "cli.program_has_duration",
                "a program has its own duration, and its file names no code",
            ),
            duration=duration,
            converge=converge,
            allow_code=allow_code,
        )
    if is_in_language:
        program, config, lines = language_program(Path(station), language, set_)
        return run_program(program, config, saving, film_frames, lines=lines)
    if is_program:
        program, config = program_from(station, set_)
        return run_program(program, config, saving, film_frames, station)
    config = station_from(station, set_, allow_code=allow_code, duration=duration)
    if config.program is not None:
        # The station's moves take as long as they need; --allow-code has an effect, unlike on a program's own file.
        refuse(
            message(
                "cli.station_has_program",
                "the station has a program (--set program=null runs its reference)",
            ),
            duration=duration,
            converge=converge,
        )
        return run_program(own_program(config), config, saving, film_frames)
    prepared = prepared_folder(config, saving)
    result = _simulate(config, saving.live)
    code = save_and_show(result, prepared, saving, frames=film_frames)
    # After a run that diverged or was interrupted, there is nothing to compare.
    if converge and code == ExitCode.DONE:
        return _run_tighter(result)
    return code


def demo(
    out: Annotated[
        Path,
        typer.Option(help=message("cli.help_demo_out", "Folder of the result, which is replaced.")),
    ] = Path("runs/demo"),
) -> int:
    """Run a demonstration: an IRB120 moves by joint torques; the recording opens in any browser."""
    # The demonstration needs no file of the user's, and can be repeated: its former result is replaced.
    config = station_from("irb120_dynamic", None)
    saving = Saving(out=out, force=True)
    prepared = prepared_folder(config, saving)
    return save_and_show(_simulate(config, live=False), prepared, saving)


@with_mesh_path
def diagram(
    station: StationArgument,
    out: Annotated[
        Path | None,
        typer.Option(
            help=message(
                "cli.help_diagram_out",
                "FILE.svg, .png, .pdf, .dot or .mmd; by default DOT on the screen.",
            )
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
        # Not through the console, which would break long lines: the text is input of another tool.
        print(station_dot(config))
        return
    check_new_file(out, force=force)
    say(str(save_block_picture(config, out)))


def _read_frames(text: str | None) -> Frames:
    """Read the value of the option ``--frames``: the count of pictures of the film strip, or ``events``.

    Args:
        text: the value. None if the option is not given; the result, then None, stands for the default.

    Raises:
        InvalidParameter: the value is neither a number of at least 2 nor ``events``.
    """
    # None is the default of the result: `events` for programs, otherwise a fixed count of frames.
    if text is None or text == "events":
        return cast(Frames, text)
    # A film strip shows at least the begin and the end.
    if not text.isdecimal() or int(text) < 2:
        raise InvalidParameter(
            "--frames", text, message("cli.two_or_events", 'a number of at least 2, or "events"')
        )
    return int(text)


def _simulate(config: StationConfig, live: bool) -> SimulationResult:
    """Simulate a station.

    Args:
        config: the station.
        live: whether the motion is shown in the browser, where the user can also steer the station.

    Returns:
        the run; an interrupted run up to the interrupt.
    """
    if not live:
        return simulate(config)
    from simrob_drake.results.animation.live import LiveView, Steering

    steering = Steering(config)
    view = LiveView(config, steering=steering)
    wait_for_watcher(view.url)
    try:
        # The browser shows the time, so a progress bar would only repeat it. Commands of the user reach the station
        # through the steering.
        result = simulate(config, progress=False, on_step=view.on_step, commands=steering.commands)
        # The page stays open after the run, and shows how it ended.
        view.say(result.end_in_words)
        return result
    finally:
        view.close()


def _run_tighter(result: SimulationResult) -> ExitCode:
    """Run a station again with a ten times tighter solver, and show the differences between the two runs.

    Its accuracy and its longest step are divided by ten; of a solver with fixed steps, the step.

    Small differences mean that the accuracy of the solver does not decide the result.

    Args:
        result: the run with the station's own accuracy.

    Returns:
        exit code of the tighter run; DONE if the station has no solver.
    """
    if not result.config.engine.moves_by_forces:
        text = message(
            "cli.no_solver_to_converge",
            "--converge has no effect: a kinematic station has no solver whose accuracy could be tightened",
        )
        say_text(text)
        return ExitCode.DONE
    # A factor of ten is far more than rounding changes, and the run still ends in a reasonable time.
    tighter_solver = result.config.solver.tighter()
    # All other keys stay, and the seeds with them: the solver is the only difference.
    tight = simulate(result.config.model_copy(update={"solver": tighter_solver}))
    console.print(convergence_table(result, tight))
    usual = result.config.solver.model_dump()
    changed = {
        f"solver.{key}": value
        for key, value in tighter_solver.model_dump().items()
        if value != usual[key]
    }
    text = message(
        "cli.convergence_means",
        "The solver's accuracy changes the result by about as much. If that is too much, run with {options}",
        options=" ".join(f"--set {key}={value:g}" for key, value in changed.items()),
    )
    say_text(text)
    return exit_code(tight)


COMMANDS: dict[str, Callable[..., Any]] = {"demo": demo, "run": run, "diagram": diagram}
