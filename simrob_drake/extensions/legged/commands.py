"""The command that makes a robot on legs stand and walk: `simrob legged`."""

from pathlib import Path
from typing import Annotated

import typer

from simrob_drake.base.errors import SimrobError
from simrob_drake.base.extension import needed_extension
from simrob_drake.base.messages import compound, message
from simrob_drake.cli import ExitCode
from simrob_drake.cli.options import FileArgument, Force, with_import_options
from simrob_drake.cli.screen import NEXT, progress_note, say_place, say_text, say_warning
from simrob_drake.robots.imports import ImportOptions


@with_import_options("mesh_path", "collision", "estimate_inertia", "xacro_arg", "drop_loops")
def legged(
    *,
    file: FileArgument,
    out: Annotated[
        Path | None,
        typer.Option(
            help=message(
                "legged.help_legged_out", "Folder of the result; NAME_legged unless given."
            )
        ),
    ] = None,
    tune: Annotated[
        float,
        typer.Option(
            min=0,
            metavar="MINUTES",
            help=message(
                "legged.help_legged_tune",
                "Search for better parameters for this time, and prove them.",
            ),
        ),
    ] = 0.0,
    options: ImportOptions | None,
    force: Force = False,
) -> ExitCode:
    """Make a robot on legs ready to stand and to walk: robot, gait, stations and a report, from its tree alone.

    What cannot be done is told in a line, and the parts that could be are kept.

    For example:

        simrob legged robot.urdf --out robots/robot

        simrob legged robot.urdf --out robots/robot --tune 20
    """
    from simrob_drake.extensions.legged.making import WALK, make_legged  # loads what runs stations
    from simrob_drake.extensions.legged.report import REPORT, trial_name

    if tune:
        # The extension is looked for first, so that nothing is made in vain if it is missing.
        with needed_extension("tuning", message("legged.legged_tune", "simrob legged --tune")):
            from simrob_drake.extensions.legged.tuning import tune_walk

    folder = out or Path(f"{file.stem}_legged")
    with progress_note(message("legged.making", "making and trying {file}", file=file)):
        made = make_legged(file, folder, options, force=force)
    for line in (*made.found, *made.assumed):
        say_text(line)
    for attempt in made.attempts:
        say_text(
            compound("{trial}: {outcome}", trial=trial_name(attempt.trial), outcome=attempt.outcome)
        )
    for line in made.too_fast:
        say_warning(line)
    say_place(message("legged.report", "report"), folder / REPORT)
    if made.problem:
        raise SimrobError(
            message(
                "legged.could_be_done",
                "{problem}{stop} What could be done is in {folder}",
                problem=made.problem,
                # A problem in several sentences has its own full stop.
                stop="" if made.problem.endswith(".") else ".",
                folder=folder,
            )
        )
    say_place(NEXT, f"simrob run {folder / WALK}")
    if tune:
        for sentence in tune_walk(folder, tune):
            say_text(sentence)
    return ExitCode.DONE
