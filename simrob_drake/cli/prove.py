"""The command that takes a winner through what it has never seen: prove."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from simrob_drake.cli import ExitCode
from simrob_drake.cli.options import Force, Scheduler, Workers, with_mesh_path
from simrob_drake.cli.screen import console
from simrob_drake.results.files import default_folder


@with_mesh_path
def prove(
    winner: Annotated[
        str, typer.Argument(metavar="STUDY|STATION", help="The folder of a study that ended, or a station.")
    ],
    seeds: Annotated[int, typer.Option(min=1, help="Draws of each doubt.")] = 10,
    out: Annotated[
        Path | None, typer.Option(help="Folder; STUDY/prove, or runs/STATION-prove-TIME by default.")
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
    from simrob_drake.tuning.proof import PAGE, Proof, ProofFolder

    proof = Proof.of(winner, seeds)
    folder = out or (Path(winner) / "prove" if proof.study else default_folder(f"{Path(winner).stem}-prove"))
    _, words = ProofFolder(folder, proof, force=force).run(workers=workers, scheduler=scheduler)
    for sentence in words:
        console.print(sentence, highlight=False)
    console.print(f"page {folder / PAGE}", soft_wrap=True, highlight=False)
    return ExitCode.DONE


COMMANDS: dict[str, Callable[..., Any]] = {"prove": prove}
