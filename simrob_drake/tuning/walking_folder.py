"""The folder of trials of a robot that walks: what was asked for, all trials as they end, and what they come to."""

import json
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from simrob_drake.arguments import as_path
from simrob_drake.folders import written_at_once
from simrob_drake.sections import validated
from simrob_drake.tuning.journal import Journal, columns_of, run
from simrob_drake.tuning.push_map import PushMap, save_push_picture
from simrob_drake.tuning.trial import Row, table, write_rows
from simrob_drake.tuning.walking import Walking


class WalkingFolder:
    """Trials of a robot that walks, in a folder."""

    def __init__(self, folder: Path | str, walking: Walking, *, force: bool = False, allow_code: bool = False) -> None:
        """Begin trials in a new folder, or go on with the same ones; ``force`` replaces what is there.

        Raises SimrobError: trials that cannot be; OutputError: the folder holds something else, or cannot be written;
        InvalidConfig: the station has changed since they began.
        """
        self.folder, self._walking = as_path(folder, "folder"), walking
        digest = walking.check(allow_code=allow_code)
        self._trials = walking.trials(allow_code=allow_code)
        columns = columns_of(self._trials)
        self._journal = Journal(self.folder, f"{walking.name}.yaml", walking, digest, columns=columns, force=force)

    def run(self, *, workers: int | None = None, scheduler: str | None = None, progress: bool = True) -> list[Row]:
        """Make trials as :func:`simrob_drake.tuning.journal.run`, write table, summary, picture; return the rows."""
        rows = table(run(self._journal, self._trials, workers=workers, scheduler=scheduler, progress=progress))
        walking, place = self._walking, self.folder / self._walking.name
        write_rows(place.with_suffix(".csv"), rows)
        content = {"asked": walking.model_dump(mode="json"), "summary": walking.summary(rows)}
        written_at_once(place.with_suffix(".json"), json.dumps(content, indent=1, ensure_ascii=False))
        if isinstance(walking, PushMap):
            save_push_picture(walking, rows, place.with_suffix(".png"))
        return rows


def push_map(
    station: str, folder: Path | str | None = None, *, workers: int | None = None, progress: bool = True, **keys: Any
) -> list[Row]:
    """Push a robot that walks, and return a row for each direction, moment, draw and set of settings.

    A row has the ``number`` of its trial, ``settings``, ``seed``, ``moment`` [s], ``direction_deg`` from ahead to the
    left, ``force`` [N], ``impulse`` [N·s], ``impulse_per_mass`` [N·s/kg], and ``ended``, how a run ended. Raises
    SimrobError: a map that cannot be.

    Args:
        station: a name, or a file.
        folder: where table, summary and picture go; they are not kept unless given.
        workers: how many processes; as many as there are processors unless given.
        progress: show a bar.
        keys: the other keys of :class:`~simrob_drake.tuning.push_map.PushMap`.
    """
    what = validated(PushMap, {"station": station, **keys}, "push map")
    with TemporaryDirectory() as nowhere:
        return WalkingFolder(folder or Path(nowhere) / what.name, what).run(workers=workers, progress=progress)
