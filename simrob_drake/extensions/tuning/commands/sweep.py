"""The command about many runs: sweep."""

from collections import Counter
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Annotated, Any, get_args

import typer

from simrob_drake.base.errors import InvalidParameter, one_of
from simrob_drake.base.messages import compound, join_texts, message
from simrob_drake.cli import ExitCode
from simrob_drake.cli.arguments import changes_of, refuse, texts_by_key
from simrob_drake.cli.options import (
    AllowCode,
    Force,
    NoRecording,
    Saving,
    Scheduler,
    Settings,
    Workers,
    with_mesh_path,
)
from simrob_drake.cli.saving import prepared_folder, save_and_show
from simrob_drake.cli.screen import console, say_place, say_text, table
from simrob_drake.results.files import default_folder
from simrob_drake.stations.file_paths import changes_with_absolute_paths

if TYPE_CHECKING:
    from simrob_drake.extensions.tuning.journal import Row
    from simrob_drake.extensions.tuning.sweep_folder import SweepFolder


@with_mesh_path
def sweep(
    station: Annotated[
        str,
        typer.Argument(
            metavar="STATION|FOLDER",
            help=message(
                "tuning.help_sweep_station", "A station, or the folder of a sweep to go on with."
            ),
        ),
    ],
    vary: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY.PATH=VALUES",
            help=message(
                "tuning.help_sweep_vary",
                "V,V..., lin:FIRST:LAST:COUNT, log:FIRST:LAST:COUNT, uniform:LOW:HIGH, loguniform:LOW:HIGH, "
                "integer:LOW:HIGH, normal:MEAN:DEVIATION; may be given several times.",
            ),
        ),
    ] = None,
    seeds: Annotated[
        int,
        typer.Option(
            min=1,
            help=message(
                "tuning.help_sweep_seeds",
                "Runs of each combination, with other noise and other draws.",
            ),
        ),
    ] = 1,
    sampling: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help=message(
                "tuning.help_sweep_sampling",
                "Draw all keys at once: sobol, latin, random or grid, --count times.",
            ),
        ),
    ] = None,
    count: Annotated[
        int | None,
        typer.Option(
            min=1,
            help=message(
                "tuning.help_sweep_count", "Draws; of a grid, values of each key. 16 by default."
            ),
        ),
    ] = None,
    set_: Settings = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help=message(
                "tuning.help_sweep_out", "Folder of the sweep; runs/STATION-sweep-TIME by default."
            )
        ),
    ] = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    run: Annotated[
        int | None,
        typer.Option(
            metavar="NUMBER",
            help=message(
                "tuning.help_sweep_run",
                "Make this run of a folder's table again and save its result.",
            ),
        ),
    ] = None,
    force: Force = False,
    no_recording: NoRecording = False,
    allow_code: AllowCode = False,
) -> int:
    """Run a station over values of its keys, on all processors; a table and plots tell what became of each run.

    A sweep that was interrupted goes on when it is given again with the same --out, or by its folder's name.

    For example:

        simrob sweep irb120_dynamic --vary servo.kp=log:50:20000:9 --out runs/gains

        simrob sweep runs/gains --run 12
    """
    from simrob_drake.base.distributions import parse_distribution
    from simrob_drake.base.sampling import Sampling
    from simrob_drake.extensions.tuning.sweep import Sweep
    from simrob_drake.extensions.tuning.sweep_folder import SWEEP, TABLE, SweepFolder

    if (Path(station) / SWEEP).is_file():
        refuse(
            message("tuning.folder_says_it", "the folder of the sweep says it already"),
            vary=vary,
            sampling=sampling,
            count=count,
            set=set_,
            force=force and run is None,
        )
        place = SweepFolder.there(Path(station), allow_code=allow_code)
    else:
        refuse(
            message(
                "tuning.effect_with_folder", "it has an effect only with the folder of a sweep"
            ),
            run=run,
        )
        distributions = {
            key: parse_distribution(f"--vary {key}", text)
            for key, text in texts_by_key(vary, "--vary")
        }
        sampled: dict[str, Any] = {"vary": distributions, "sampling": sampling}
        if sampling is not None:
            one_of(message("tuning.sampling", "sampling"), sampling, get_args(Sampling))
        content = Sweep(
            station=str(Path(station).resolve()) if Path(station).is_file() else station,
            overrides=changes_with_absolute_paths(changes_of(set_, "--set"), Path.cwd()),
            seeds=seeds,
            **sampled,
            count=count,
        )
        folder = out or default_folder(f"{Path(station).stem}-sweep")
        place = SweepFolder(folder, content, force=force, allow_code=allow_code)
    if run is not None:
        return _run_again(place, run, out, force=force, recording=not no_recording)
    if scheduler:
        refuse(
            message(
                "tuning.cluster_decides",
                "with --scheduler the cluster decides how many workers there are",
            ),
            workers=workers,
        )
    rows = place.run(workers=workers, scheduler=scheduler)
    _tell(rows)
    say_place(TABLE, place.folder / TABLE)
    say_place(message("tuning.a_run", "a run"), f"simrob sweep {place.folder} --run NUMBER")
    return ExitCode.DONE


def _run_again(
    place: "SweepFolder", number: int, out: Path | None, *, force: bool, recording: bool
) -> ExitCode:
    """Make one run of a sweep again, and save what `simrob run` saves."""
    if not 1 <= number <= len(place.cases):
        raise InvalidParameter(
            "--run",
            number,
            message(
                "tuning.number_of_table",
                "a number of the table, 1 to {count}",
                count=len(place.cases),
            ),
        )
    case = place.cases[number - 1]
    scene = case.scene()
    saving = Saving(out or place.folder / f"run_{number}", force, no_recording=not recording)
    return save_and_show(scene.run(), prepared_folder(scene.config, saving), saving)


_ENDING_WORDS = {
    "completed": message("tuning.ended_completed", "completed"),
    "diverged": message("tuning.ended_diverged", "diverged"),
    "failed": message("tuning.ended_failed", "failed"),
    "interrupted": message("tuning.ended_interrupted", "interrupted"),
    "refused": message("tuning.ended_refused", "refused"),
    "killed": message("tuning.ended_killed", "killed"),
}
"""Words for how runs ended. A run that a monitor ended has the name of the monitor."""


def _tell(rows: "list[Row]") -> None:
    """Show how the runs ended, and for each measure its least value, its median and its largest value."""
    from simrob_drake.extensions.tuning.rollout import UNITS, measured

    ends = Counter(str(row["ended"]) for row in rows)
    counts = [
        compound("{count} {ending}", count=count, ending=_ENDING_WORDS.get(end, end))
        for end, count in ends.most_common()
    ]
    say_text(join_texts(counts, ", "))
    lines = list[tuple[str, ...]]()
    for name, found in measured(rows).items():
        least, largest = min(found), max(found)
        middle = median(value for value, _ in found)
        cells = (
            name,
            compound("{value:.4g}", value=least[0]),
            str(least[1]),
            compound("{value:.4g}", value=middle),
            compound("{value:.4g}", value=largest[0]),
            str(largest[1]),
            UNITS[name.rpartition(".")[2]],
        )
        lines.append(cells)
    in_run = message("tuning.in_run", "in run")
    headings = (
        message("tuning.measure", "measure"),
        message("tuning.least", "least"),
        in_run,
        message("tuning.median", "median"),
        message("tuning.largest", "largest"),
        in_run,
        message("tuning.unit", "unit"),
    )
    console.print(table(headings, *lines, numbers=False))
