"""A station whose runs can be shown, recorded, repeated, saved as one result, and done again on another station.

The *tape* of a station holds the recording: a *take* is one run, and an *entry* is a move as the file of a program has
it, such as a change of the station between two runs. A *stage* is several takes that are repeated as one run.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Literal, Unpack

from simrob_drake.base.arguments import instance
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.programs.model import one_posture
from simrob_drake.programs.program import Program
from simrob_drake.programs.stateful_station import GOES_ON, StatefulStation
from simrob_drake.programs.tape import Entry, Stage, Take
from simrob_drake.results.animation.live import LiveView
from simrob_drake.results.files import Saved
from simrob_drake.results.record.state import State
from simrob_drake.results.result import SimulationResult, join_runs
from simrob_drake.stations.station import StationLike, config_of


class RecordedStation(StatefulStation):
    """A :class:`StatefulStation` that shows its runs in a browser window, and records them from :meth:`record` on."""

    def record(self) -> None:
        """Delete the recording, and record all runs from now on (SimRob's ``Rec()``)."""
        self.tape.record()

    def pause(self) -> None:
        """Stop recording (``Rec(0)``)."""
        self.tape.running = False

    def resume(self) -> None:
        """Continue recording (``Rec(1)``)."""
        self.tape.running = True

    def show(self) -> str:
        """Open a browser window that shows all runs from now on, in real time. A window that is open already is kept.

        Returns:
            Address of the window, which is valid on this computer only.
        """
        if self._window is None:
            self._window = LiveView(self.config, self._shown_state())
        return self._window.url

    def draw(self, postures: dict[str, Vector]) -> None:
        """Show robots in other postures in the window, without moving them. The window is opened if there is none.

        Args:
            postures: posture of each robot by name, shape (n,) [rad or m]. The other robots are shown where they are.

        Raises:
            UnknownName: there is no such robot.
            InvalidParameter: a posture has another shape, or the value is no mapping.
        """
        instance(
            postures,
            "postures",
            Mapping,
            message("programs.mapping_by_robot", "a mapping by the names of robots"),
        )
        shown = {}
        for name, posture in postures.items():
            axis_count = len(self.robot(name).axes)
            label = message("programs.posture_called", "postures: {name}", name=name)
            shown[name] = one_posture(posture, axis_count, label)
        self.show()
        # `show` has just opened it: the type checker cannot know.
        assert self._window is not None
        now = self._shown_state()
        self._window.draw(
            self.config, State({**now.positions, **shown}, now.velocities, now.references)
        )

    def close(self) -> None:
        """Close the window."""
        if self._window is not None:
            self._window.close()
            self._window = None

    def replay(self) -> list[SimulationResult]:
        """Run the recorded moves again, each from its own start (``Rep()``). The station does not change."""
        return self.tape.replay()

    def result(self) -> SimulationResult:
        """Join all recorded runs to one result. Nothing is run again.

        The result has the program that repeats the recording, if the file of a program can describe all of it.

        Pieces that are attached or released between the runs are free pieces in the result: their poses are signals,
        ``piece.<piece>.x`` and so on.

        Raises:
            InvalidParameter: nothing was recorded.
        """
        self.tape.check_some()
        moves = self.tape.moves()
        # Without moves there is no program: a recording that a file cannot describe is saved without one.
        text = Program(station=STATION, moves=tuple(moves)).text() if moves else ""
        last_take = self.tape.takes[-1]
        # Changes after the last run, such as a released piece, are in the station of this object only.
        ends_with_run = self.tape.entries[-1] is last_take
        final_station = last_take.config if ends_with_run else self.config
        # Runs are numbered by their index among the moves of the program, in which changes are moves as well.
        runs = [
            entry.result.with_move_number(number)
            for number, entry in enumerate(self.tape.entries)
            if isinstance(entry, Take)
        ]
        return join_runs(runs, left=final_station, program=text)

    def save(self, folder: Path | str | None = None, **options: Unpack[Saved]) -> Path:
        """Write the recording to a folder; see :meth:`SimulationResult.save`.

        The folder has a ``program.yaml`` if a file can say all that was done: moves of arms without a solver of your
        own, pieces, tools and waits.

        Raises:
            InvalidParameter: nothing was recorded.
            OutputError: the folder cannot be written, or exists.
        """
        return self.result().save(folder, **options)

    def film(self, file: Path | str, *, frames: int | Literal["events"] = 7) -> Path:
        """Write the recording as a film; see :meth:`SimulationResult.film`."""
        return self.result().film(file, frames=frames)

    def simulate(
        self,
        station: "StationLike | None" = None,
        *,
        duration: float | None = None,
        strict: bool = False,
    ) -> SimulationResult:
        """Do again all that was recorded, on this station or on another one (SimRob's ``Sim``).

        This object does not change. Moves that follow each other are one run; pieces are attached and released between
        the runs as in the recording.

        Args:
            station: another station with robots and pieces of the same names, such as the dynamic one. If it is None,
                the station of the recording. It begins at its own initial posture if the recording began at that of its
                station.
            duration: duration of all runs together [s]. If it is None, as recorded.
            strict: whether a run with warnings raises an error. It does, too, if this station is strict.

        Returns:
            All runs as one result, up to a run that diverged, failed or was interrupted.

        Raises:
            VerdictError: a run has warnings, and ``strict`` is True or this station is strict.
            InvalidParameter: nothing was recorded, or two runs do not join (such a recording can be replayed).
            Unsuitable: a duration is given, and a run has references that are no planned moves.
            SimrobError: a piece cannot be attached or released there, or the other station lacks a robot.
        """
        stages = self.tape.stages(duration)
        # A new object of the same class runs the stages, so that this one does not change.
        first = self.tape.takes[0]
        cell = type(self)(first.config if station is None else config_of(station))
        # A recording that began at the initial posture has no state: the station begins at its own initial posture.
        cell.state = first.start or cell.state
        cell.progress = self.progress
        cell.strict = self.strict or strict
        runs = list[SimulationResult]()
        for stage in stages:
            if not isinstance(stage, Stage):
                cell._repeat_change(stage)
                continue
            runs.append(cell.follow(stage.references, stage.duration))
            if runs[-1].ending not in GOES_ON:
                break
        return runs[0] if len(runs) == 1 else join_runs(runs, left=cell.config)

    def _repeat_change(self, entry: Entry) -> None:
        """Change this station by a recorded entry: attach or release a piece, or change a tool.

        Args:
            entry: the entry, with the key ``attach``, ``release`` or ``tool`` and the arguments of that method.
        """
        # An entry has exactly one key: the kind of its move.
        ((key, content),) = entry.items()
        if key == "tool":
            # A tool is either named or given by its pose. The robot is None if the station has only one.
            self.tool(self.robot_name(content["robot"]), content.get("name") or content["pose"])
        elif key == "attach":
            self.attach(**content)
        else:
            self.release(**content)


STATION = "station.yaml"
"""File in which a saved program finds the station in which it began."""
