"""The command that draws saved results over each other: plot."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from simrob_drake.base.folders import check_new_file, free_path
from simrob_drake.base.messages import message
from simrob_drake.cli import ExitCode
from simrob_drake.cli.options import Force
from simrob_drake.cli.screen import say_place

_FILE = Path("plot.png")
"""File of the figure if the user names none."""


def plot(
    results: Annotated[
        list[Path],
        typer.Argument(
            metavar="RESULT...",
            help=message("cli.help_plot_results", "Result folders of `simrob run`."),
        ),
    ],
    signal: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help=message(
                "cli.help_plot_signal",
                "A column of signals.csv, such as q.joint_2 or 'tau.*'; may be given several times. By default "
                "positions and torques of the joints that move.",
            ),
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help=message(
                "cli.help_plot_out",
                "FILE.png, .svg or .pdf. By default plot.png, with a number if it exists.",
            )
        ),
    ] = None,
    force: Force = False,
) -> ExitCode:
    """Draw signals of one or more results over each other, with a legend, to compare runs.

    For example:

        simrob run irb120_dynamic --out runs/a

        simrob run irb120_dynamic --set servo.kp=300 --out runs/b

        simrob plot runs/a runs/b --signal q.joint_2 --signal tau.joint_2
    """
    # These modules load matplotlib, which takes long.
    from simrob_drake.results.plots.overlay import overlay_figure, read_results
    from simrob_drake.results.plots.own import save_figure

    # Without a name and without --force, a former picture stays, and the new one gets a number.
    file = out or (_FILE if force else free_path(_FILE))
    check_new_file(file, force=force)
    figure = overlay_figure(read_results(results), signal or ())
    say_place(message("cli.plot", "plot"), save_figure(figure, file))
    return ExitCode.DONE


COMMANDS: dict[str, Callable[..., Any]] = {"plot": plot}
