"""The commands of searches: tune and dashboard; and prove, which takes a winner through what it has never seen."""

from contextlib import suppress
from pathlib import Path
from statistics import mean
from typing import TYPE_CHECKING, Annotated, get_args

import typer

from simrob_drake.base.errors import one_of
from simrob_drake.base.messages import compound, message
from simrob_drake.cli import ExitCode
from simrob_drake.cli.options import Force, Scheduler, Workers, with_mesh_path
from simrob_drake.cli.screen import RESULT, console, say_place, say_text, table
from simrob_drake.results.files import default_folder

if TYPE_CHECKING:
    from simrob_drake.extensions.tuning.journal import Row
    from simrob_drake.extensions.tuning.study_folder import StudyFolder


@with_mesh_path
def tune(
    study: Annotated[
        Path,
        typer.Argument(
            metavar="STUDY",
            help=message(
                "tuning.help_tune_study", "A YAML file: what varies, what it costs, when."
            ),
        ),
    ],
    method: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help=message(
                "tuning.help_tune_method",
                "Method, in place of the study's; given several times, the methods are compared.",
            ),
        ),
    ] = None,
    trials: Annotated[
        int | None,
        typer.Option(
            min=1,
            help=message("tuning.help_tune_trials", "Count of trials, in place of the study's."),
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help=message("tuning.help_tune_out", "Folder; runs/STUDY-TIME by default.")),
    ] = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    force: Force = False,
) -> int:
    """Search for figures of a station that cost least, and prove them where they were never tried.

    A search that was interrupted goes on when it is given again with the same --out, and so does one that gets more
    --trials.

    For example:

        simrob tune gains.yaml --out runs/gains

        simrob tune gains.yaml --method nelder_mead --method cma --method genetic
    """
    from simrob_drake.extensions.tuning.analysis import (
        plots_there,
        save_convergence,
        study_in_optuna,
    )
    from simrob_drake.extensions.tuning.study import Method, Study
    from simrob_drake.extensions.tuning.study_folder import StudyFolder

    search = Study.read(study)
    if trials is not None:
        search = search.model_copy(update={"trials": trials})
    methods = [
        one_of(message("tuning.method", "method"), name, get_args(Method))
        for name in dict.fromkeys(method or [search.method])
    ]
    whole = out or default_folder(study.stem)
    places = {
        name: StudyFolder(
            whole / name if len(methods) > 1 else whole,
            search.model_copy(update={"method": name}),
            force=force,
        )
        for name in methods
    }
    for name, place in places.items():
        say_text(f"{name}:")
        _tell(place, place.run(workers=workers, scheduler=scheduler))
    if plots_there():
        found = [
            study_in_optuna(name, place.study, place.journal.records)
            for name, place in places.items()
        ]
        save_convergence(whole / "convergence.png", found)
    say_place(RESULT, whole)
    return ExitCode.DONE


def _tell(place: "StudyFolder", proof: "list[Row]") -> None:
    """Show the values of the start and of the best trial: parameters, cost, and measures of the proof.

    Args:
        place: folder of the study.
        proof: runs of the proof, of the start and of the best trial. Empty if the study has no proof.
    """
    from simrob_drake.extensions.tuning.conclusion import cost_columns
    from simrob_drake.extensions.tuning.study import in_table

    parameters, cost = place.best
    rows = [
        (key, in_table(place.study.start.get(key)), in_table(value))
        for key, value in parameters.items()
    ]
    start_word = message("tuning.start", "start")
    best_word = message("tuning.best", "best")
    for start_cost, best_cost in zip(place.trials[0][1], cost, strict=True):
        start_cell = compound("{cost:.5g}", cost=start_cost)
        rows.append(
            (message("tuning.cost", "cost"), start_cell, compound("{cost:.5g}", cost=best_cost))
        )
    if len(cost) > 1:
        # With several costs there is no single best: the file has all trials that no other one beats in every cost.
        count = message("tuning.in_front_file", "{count} in front.csv", count=len(place.front()))
        rows.append((message("tuning.trade_offs", "trade-offs"), "", count))
    console.print(
        table((message("tuning.key", "key"), start_word, best_word), *rows, numbers=False)
    )
    if not proof:
        say_text(
            message(
                "tuning.no_cases_of_proof",
                "Not proven: the study has no cases of its own under proof.",
            )
        )
        return
    runs = [[row for row in proof if row["of"] == of] for of in ("start", "best")]
    ends = [
        message(
            "tuning.count_of",
            "{count} of {total}",
            count=sum(row["ended"] == "completed" for row in own),
            total=len(own),
        )
        for own in runs
    ]
    lines: list[tuple[str, ...]] = [(message("tuning.completed", "completed"), *ends, "")]
    for name in dict.fromkeys([*cost_columns(proof[0]), *place.study.measures]):
        before, after = (
            mean(found)
            if (found := [row[name] for row in own if row.get(name) is not None])
            else None
            for own in runs
        )
        ratio = ""
        if before and after and before * after > 0:
            ratio = compound("{ratio:.2f}", ratio=after / before)
        lines.append((name, in_table(before), in_table(after), ratio))
    headings = (
        message("tuning.proof", "proof"),
        start_word,
        best_word,
        message("tuning.ratio", "ratio"),
    )
    console.print(table(headings, *lines, numbers=False))


def dashboard(
    folders: Annotated[
        list[Path],
        typer.Argument(
            metavar="FOLDER...",
            help=message(
                "tuning.help_dashboard_folders", "Folders of searches, ended or under way."
            ),
        ),
    ],
    port: Annotated[
        int | None,
        typer.Option(
            min=0,
            max=65535,
            help=message("tuning.help_dashboard_port", "Port; 8080, or a free one, by default."),
        ),
    ] = None,
) -> int:
    """Show searches in Optuna's dashboard, to browsers of this computer alone; Ctrl-C ends it.

    Trials appear as they end. What is changed there is forgotten: the folder stays as it is.

    For example:

        simrob dashboard runs/gains
    """
    from simrob_drake.extensions.tuning.dashboard import Dashboard
    from simrob_drake.extensions.tuning.study_folder import StudyFolder

    shown = Dashboard({str(folder): StudyFolder.there(folder) for folder in folders}, port)
    say_place(message("tuning.dashboard", "dashboard"), shown.address)
    with suppress(KeyboardInterrupt):
        shown.serve()
    return ExitCode.DONE


@with_mesh_path
def prove(
    winner: Annotated[
        str,
        typer.Argument(
            metavar="STUDY|STATION",
            help=message(
                "tuning.help_prove_winner", "The folder of a study that ended, or a station."
            ),
        ),
    ],
    seeds: Annotated[
        int, typer.Option(min=1, help=message("tuning.help_prove_seeds", "Draws of each doubt."))
    ] = 10,
    out: Annotated[
        Path | None,
        typer.Option(
            help=message(
                "tuning.help_prove_out",
                "Folder; STUDY/prove, or runs/STATION-prove-TIME by default.",
            )
        ),
    ] = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    force: Force = False,
) -> int:
    """Run a winner, and where its search began, under doubts: pushes, masses, moves, gains, solvers ...

    A page with table, plots and the conclusion in words comes of it. One that was interrupted goes on when it is given
    again with the same --out.

    For example:

        simrob tune gains.yaml --out runs/gains && simrob prove runs/gains

        simrob prove humanoid_balance --seeds 5
    """
    from simrob_drake.extensions.tuning.proof import PAGE, Proof, ProofFolder

    proof = Proof.of(winner, seeds)
    folder = out or (
        Path(winner) / "prove" if proof.study else default_folder(f"{Path(winner).stem}-prove")
    )
    _, words = ProofFolder(folder, proof, force=force).run(workers=workers, scheduler=scheduler)
    for sentence in words:
        say_text(sentence)
    say_place(message("tuning.page", "page"), folder / PAGE)
    return ExitCode.DONE
