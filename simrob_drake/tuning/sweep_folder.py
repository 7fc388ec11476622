"""The folder of a sweep: what was asked for, each run as it ends, and in the end all of them as table and plots."""

from pathlib import Path

from simrob_drake.arguments import as_path
from simrob_drake.importer.packages import Border
from simrob_drake.stations.located import located_changes
from simrob_drake.tuning.analysis import plots_there, save_sensitivity, sweep_in_optuna
from simrob_drake.tuning.journal import Journal, columns_of, read_spec, run
from simrob_drake.tuning.sweep import Sweep
from simrob_drake.tuning.sweep_plots import save_sweep_plots
from simrob_drake.tuning.table import write_rows
from simrob_drake.tuning.trial import Row, table

SWEEP, TABLE = "sweep.yaml", "sweep.csv"


class SweepFolder:
    """A sweep and its runs, in a folder.

    Attributes:
        folder: where they stand.
        sweep: what is run.
        cases: all of its runs.
        journal: those that are made.
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
        digest = self.cases[0].scene().digest
        self.journal = Journal(self.folder, SWEEP, sweep, digest, columns=columns_of(self.cases), force=force)

    @classmethod
    def there(cls, folder: Path | str, *, allow_code: bool = False) -> "SweepFolder":
        """Return the sweep that stands in a folder.

        Raises:
            InvalidConfig: there is none, it is damaged, names files that may not be read, or its station has changed.
        """
        place = as_path(folder, "folder")
        sweep = read_spec(place, SWEEP, Sweep)
        changes = located_changes(sweep.overrides, place.absolute(), Border(place / SWEEP))
        return cls(place, sweep.model_copy(update={"overrides": changes}), allow_code=allow_code)

    def run(self, *, workers: int | None = None, scheduler: str | None = None, progress: bool = True) -> list[Row]:
        """Make the runs that are not done yet, write the table and the plots of all, and return the rows.

        Args and errors are those of :func:`simrob_drake.tuning.journal.run`.
        """
        rows = table(run(self.journal, self.cases, workers=workers, scheduler=scheduler, progress=progress))
        write_rows(self.folder / TABLE, rows)
        save_sweep_plots(self.sweep, rows, self.folder / "plots")
        if plots_there():
            found = sweep_in_optuna(self.sweep.station, self.sweep.vary, rows)
            save_sensitivity(self.folder / "plots/sensitivity.png", found)
        return rows
