"""The folder of a sweep: what was asked for, each run as it ends, and in the end all of them as table and plots."""

from pathlib import Path

from simrob_drake.given import as_path
from simrob_drake.tuning import journal
from simrob_drake.tuning.rollout import Row, killed, rollout
from simrob_drake.tuning.sweep import Sweep
from simrob_drake.tuning.sweep_plots import save_sweep_plots
from simrob_drake.tuning.table import write_rows
from simrob_drake.yaml_files import validated

SWEEP, TABLE = "sweep.yaml", "sweep.csv"


class SweepFolder:
    """A sweep and its runs, in a folder.

    Attributes:
        folder: where they stand.
        sweep: what is run.
        cases: all of its runs.
    """

    def __init__(self, folder: Path | str, sweep: Sweep, *, force: bool = False, allow_code: bool = False) -> None:
        """Begin a sweep in a new folder, or go on with the same one.

        Args:
            folder: where to.
            sweep: what to run.
            force: replace another sweep that is there, or the same one.
            allow_code: whether the station may name Python code.

        Raises:
            SimrobError: a sweep that cannot be.
            OutputError: the folder holds something else, or cannot be written.
            InvalidConfig: its station has changed since it began.
        """
        self.folder, self.sweep = as_path(folder, "folder"), sweep
        self.cases = sweep.cases(allow_code=allow_code)
        journal.take(self.folder, SWEEP, sweep, self.cases[0].scene().digest, force=force)

    @classmethod
    def there(cls, folder: Path | str, *, allow_code: bool = False) -> "SweepFolder":
        """Return the sweep that stands in a folder.

        Raises:
            InvalidConfig: there is none, it is damaged, or its station has changed since.
        """
        place = as_path(folder, "folder")
        return cls(place, validated(Sweep, journal.asked_of(place, SWEEP), place / SWEEP), allow_code=allow_code)

    def run(self, *, workers: int | None = None, scheduler: str | None = None, progress: bool = True) -> list[Row]:
        """Make the runs that are not done yet, write the table and the plots of all, and return the rows.

        Args and errors are those of :func:`simrob_drake.tuning.journal.run`.
        """
        rows = journal.run(
            self.folder, self.cases, rollout, killed, workers=workers, scheduler=scheduler, progress=progress
        )
        write_rows(self.folder / TABLE, rows)
        save_sweep_plots(self.sweep, rows, self.folder / "plots")
        return rows
