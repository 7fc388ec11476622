"""A station whose runs are shown and recorded: run again, saved as one result, done again elsewhere."""

from collections.abc import Mapping
from pathlib import Path
from typing import Literal, Unpack

from simrob_drake.base.arguments import instance
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.programs.model import one_posture
from simrob_drake.programs.program import Program
from simrob_drake.programs.stateful_station import GOES_ON, StatefulStation
from simrob_drake.programs.tape import Take
from simrob_drake.results.animation.live import LiveView
from simrob_drake.results.files import Saved
from simrob_drake.results.record.state import State
from simrob_drake.results.result import SimulationResult, joined
from simrob_drake.stations.station import StationLike, config_of


class RecordedStation(StatefulStation):
    """An :class:`StatefulStation` that shows what is done with it, and records it from :meth:`record` on."""

    def record(self) -> None:
        """Forget what was recorded, and record everything from now on (SimRob's ``Rec()``)."""
        self.tape.record()

    def pause(self) -> None:
        """Stop recording (``Rec(0)``)."""
        self.tape.running = False

    def resume(self) -> None:
        """Go on recording (``Rec(1)``)."""
        self.tape.running = True

    def show(self) -> str:
        """Open a browser window, in which everything from now on is shown at the pace of the clock.

        Returns:
            its address, on this computer only.
        """
        if self._window is None:
            self._window = LiveView(self.config, self._shown_state())
        return self._window.url

    def draw(self, postures: dict[str, Vector]) -> None:
        """Show robots in postures (n,) in the window, without moving them."""
        shown = instance(
            postures, "postures", Mapping, message("programs.mapping_by_robot", "a mapping by robot")
        ).items()
        postures = {
            name: one_posture(
                q, len(self.robot(name).axes), message("programs.posture_called", "postures: {name}", name=name)
            )
            for name, q in shown
        }
        self.show()
        assert self._window is not None
        now = self._shown_state()
        self._window.draw(self.config, State({**now.positions, **postures}, now.velocities, now.references))

    def close(self) -> None:
        """Close the window."""
        if self._window is not None:
            self._window.close()
            self._window = None

    def replay(self) -> list[SimulationResult]:
        """Run the recorded moves again, each from the state that it began in (``Rep()``); nothing else changes."""
        return self.tape.replay()

    def result(self) -> SimulationResult:
        """Return all that was recorded as one result: what happened, stitched by time, and nothing run again.

        Pieces that change hands stand free in it: their poses are signals, ``piece.<piece>.x`` and so on.

        Raises:
            InvalidParameter: nothing was recorded.
        """
        self.tape.check_some()
        moves, last = self.tape.moves(), self.tape.takes[-1]
        text = Program(station=STATION, moves=tuple(moves)).text() if moves else ""
        left = last.config if self.tape.entries[-1] is last else self.config
        numbered = enumerate(self.tape.entries)
        runs = [entry.result.numbered(number) for number, entry in numbered if isinstance(entry, Take)]
        return joined(runs, left=left, program=text)

    def save(self, folder: Path | str | None = None, **options: Unpack[Saved]) -> Path:
        """Write all that was recorded to a folder; see :meth:`SimulationResult.save`.

        ``program.yaml`` is in it where a file can say all that was done: moves of arms without a solver of your own,
        pieces, tools and waits.

        Raises:
            InvalidParameter: nothing was recorded.
            OutputError: the folder cannot be written, or exists.
        """
        return self.result().save(folder, **options)

    def film(self, file: Path | str, *, frames: int | Literal["events"] = 7) -> Path:
        """Write all that was recorded as a film; see :meth:`SimulationResult.film`."""
        return self.result().film(file, frames=frames)

    def simulate(
        self, station: "StationLike | None" = None, *, duration: float | None = None, strict: bool = False
    ) -> SimulationResult:
        """Do again all that was recorded, on this station or another (SimRob's ``Sim``); this one stays as it is.

        Moves that follow each other are one run; what is attached and let go in between is so there, too.

        Args:
            station: another one with robots and pieces of the same names, such as the dynamic one; it begins at its
                own initial posture if the recording began at that of its station.
            duration: of the whole [s]; as recorded unless given.
            strict: as the station's own.

        Raises:
            VerdictError: with ``strict`` a run that has warnings.
            InvalidParameter: nothing was recorded, or the takes do not join: such a tape can be replayed.
            SimrobError: a piece that cannot be taken or let go there.
        """
        stages, first = self.tape.stages(duration), self.tape.takes[0]
        cell = type(self)(first.config if station is None else config_of(station))
        cell.state, cell.progress, cell.strict = first.start or cell.state, self.progress, self.strict or strict
        runs: list[SimulationResult] = []
        for stage in stages:
            if not isinstance(stage, tuple):
                ((key, content),) = stage.items()  # what was noted between runs
                if key == "tool":
                    cell.tool(cell.robot_name(content["robot"]), content.get("name") or content["pose"])
                else:
                    (cell.attach if key == "attach" else cell.release)(**content)
                continue
            runs.append(cell.follow(*stage))
            if runs[-1].ending not in GOES_ON:
                break
        return runs[0] if len(runs) == 1 else joined(runs, left=cell.config)


STATION = "station.yaml"  # where a saved program finds the station that it began in
