"""Results of simulations: signals, verdict, plots, files; and results of programs, which join several runs to one.

A *program* is a sequence of runs. Each run begins in the state in which the one before ended. `join_runs` makes one
result of them; nothing is simulated again.

A *handed-over piece* is a piece that hangs on different things in these runs, or on the same thing at different poses,
such as a workpiece that a gripper grasps and releases. Its joints differ from run to run, so the runs have different
plants. The plant of the program is a further one, in which handed-over pieces are free bodies. They are put at the
poses that the plants of the runs give them, so that plots and recordings show them like any free piece.
"""

from base64 import b64encode
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from html import escape
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self, TypeAlias, TypeVar

import numpy as np
from pydrake.multibody.plant import MultibodyPlant

from simrob_drake.base.arguments import as_path, truth
from simrob_drake.base.errors import InvalidParameter, VerdictError, shorten
from simrob_drake.base.folders import check_ending
from simrob_drake.base.frames import XYZ_QUATERNION_NAMES, Vector, xyz_quaternion_from_transform
from simrob_drake.base.messages import compound, message
from simrob_drake.base.remarks import Remark
from simrob_drake.base.renaming import former_names_of
from simrob_drake.parts.station_plant import StationPlant, StationRobot
from simrob_drake.results.files import default_folder, save_result
from simrob_drake.results.html import html_of_remarks, html_table
from simrob_drake.results.plots.formats import PlotFormat
from simrob_drake.results.record.run import (
    DIVERGED,
    FAILED,
    ContactsAt,
    MoveSpan,
    RecordedRun,
    at_time_of_program,
    begins_of,
)
from simrob_drake.results.record.state import State, free_joint, joints_of
from simrob_drake.results.record.summary import summary_of
from simrob_drake.results.record.touch import Event
from simrob_drake.results.verdict.grips import empty_grips
from simrob_drake.results.verdict.judge import verdict_of
from simrob_drake.results.verdict.moves import judge_move
from simrob_drake.results.verdict.severity import severity_of_end
from simrob_drake.results.verdict.verdict import Verdict, join_verdicts, with_move_names
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.import_findings import estimated_inertias
from simrob_drake.stations.piece_config import PieceConfig
from simrob_drake.stations.posed import PosedStation
from simrob_drake.stations.poses import piece_pose_signal, unit_poses
from simrob_drake.stations.resolve import resolve

if TYPE_CHECKING:
    from simrob_drake.results.footage import Footage
    from simrob_drake.results.plots.own import NotebookFigure

_WIDTH = 100
"""Largest count of characters of a line of text about a result."""

FILM_ENDINGS = (".html", ".png", ".mp4")
"""Endings of files with the motion of a run."""

_TIME_DECIMALS = 12
"""Decimals to which times of runs in a program are rounded, so that sums of decimals such as 0.1 s are decimals."""

Table: TypeAlias = list[list[str]]
"""Rows of cells of a table; the first row contains the headings."""


def table_of(result: RecordedRun) -> Table:
    """Table of the end of a run: position and torques of each joint, in the units of users (degrees and metres).

    If the station has no robots, it is the position and the speed of each free piece instead.
    """
    return _table_of_joints(result) if result.plant.robots else _table_of_pieces(result)


def _table_of_pieces(result: RecordedRun) -> Table:
    """Table with the position of each free piece in the world, and its speed, at the end of a run."""
    piece_heading = message("results.heading_piece", "piece")
    speed_heading = message("results.heading_speed", "speed [m/s]")
    table = [[piece_heading, "x [m]", "y [m]", "z [m]", speed_heading]]
    for piece in result.config.free_pieces:
        position = result.piece_pose(piece)[-1, :3]
        velocity = result.piece_velocity(piece)[-1, :3]
        values = [*position, np.linalg.norm(velocity)]
        table.append([piece, *(compound("{value:.4f}", value=value) for value in values)])
    return table


def _table_of_joints(result: RecordedRun) -> Table:
    """Table of each axis of all robots: reference, position, torque at the end, largest torque, and its limit then."""
    unit_heading = message("results.heading_unit", "unit")
    table: Table = [
        [
            message("results.heading_joint", "joint"),
            message("results.heading_reference", "reference"),
            message("results.heading_position", "position"),
            unit_heading,
            message("results.heading_torque", "torque"),
            message("results.heading_peak_torque", "peak torque"),
            message("results.heading_limit", "limit"),
            unit_heading,
        ]
    ]
    for robot in result.plant.robots.values():
        table += [_row_of_axis(result, robot, index) for index in range(len(robot.axes))]
    return table


def _row_of_axis(result: RecordedRun, robot: StationRobot, index: int) -> list[str]:
    """Row of the table of joints for one axis; its cells are those of the headings of :func:`_table_of_joints`.

    Args:
        result: the run.
        robot: the robot.
        index: index of the axis.
    """
    axis = robot.axes[index]
    user_unit = robot.model.user_units[index]  # in rad or m: users read degrees and metres
    reference = result[f"{robot.prefix}q_ref.{axis}"][-1] / user_unit
    position = result[f"{robot.prefix}q.{axis}"][-1] / user_unit
    torque = result[f"{robot.prefix}tau.{axis}"]
    peak_row = int(np.argmax(np.abs(torque)))
    peak = torque[peak_row]  # with its sign
    is_prescribed = not result.config.engine.moves_by_forces
    has_limit = not is_prescribed and not robot.gains.passive[index]
    # A passive axis and a kinematic station have no torque that could be limited.
    limit = robot.gains.torque_limit[index]
    if robot.gains.line is not None:
        # A motor that brakes may give more than its limit at rest. Beside the peak stands what it could give then.
        speed = result.axes("v", robot.name)[peak_row]
        lower, upper = robot.gains.line.bounds(speed, robot.gains.torque_limit)
        limit = upper[index] if peak > 0 else -lower[index]
    return [
        f"{robot.prefix}{axis}",
        compound("{value:z.3f}", value=reference),
        compound("{value:z.3f}", value=position),
        robot.model.unit_names[index],
        compound("{value:z.3f}", value=torque[-1]),
        compound("{value:z.3f}", value=peak),
        compound("{limit:.4g}", limit=limit) if has_limit else "–",
        robot.model.effort_units[index],
    ]


@dataclass(frozen=True)
class SimulationResult(RecordedRun):
    """The result of a run: signals, verdict, plots and recording. A run that failed or was stopped has a result, too.

    For example, ``result["q.joint_2"]`` is a column (m,), ``result.axes("tau")`` the torques of all axes (m, n), and
    ``result.save("folder")`` writes plots, tables and a recording.

    Attributes:
        names: names of the columns of ``values``, such as ``q.joint_2``.
        times: times of the samples, shape (m,) [s].
        values: the signals, shape (m, k), in SI units and radians.
        units: units of the columns, by the name of the column.
        ending: how the run ended: completed, monitor, diverged, interrupted or failed.
        stopped_by: name of the monitor or block that ended the run; None if the run was completed.
        message: how the run ended, in words.
        verdict: comparison of the run with what was asked of it; ``warnings`` and ``remarks`` are parts of it.
        config: configuration of the station in this run.
        plant: the station's plant: ``plant.plant`` is the MultibodyPlant.
        final_state: state of the station at the end, from which another run can begin.
        context: function that returns a new context of the diagram at the end of the run. In a diagram of your own it
            contains the logs of your log sinks.
        start_time: time of the first sample [s].
        stop_time: time of the last sample [s].
        step_times: start of the run, and the ends of the accepted steps of the solver [s].
        positions_at: function that computes the plant's positions (k, nq) at times (k,) [s] of the run.
        contacts_at: function that yields Drake's contact results at times (k,) [s]; None if the station has no contact
            forces, and for a program of several runs or with handed-over pieces.
        images: images of the cameras, by the name of the camera.

    All further attributes are listed at :class:`simrob_drake.results.record.run.RecordedRun`.
    """

    def _pickled_content(self) -> dict[str, Any]:
        """Fields of the pickled result, by name.

        The verdicts about its moves are always among them. The verdict about the run is, if it was evaluated before, or
        could not be evaluated after reading.
        """
        # Judged now: the functions that measure distances need the plant, and are lost by pickling.
        moves = tuple(replace(move, verdict=judge_move(self, move)) for move in self.moves)
        content = super()._pickled_content() | {"moves": moves}
        # `cached_property` keeps a verdict that was evaluated in __dict__. The contacts that a verdict needs cannot be
        # evaluated again if there is a recorded motion only.
        if "verdict" in self.__dict__ or content["motion"] is not None:
            content["verdict"] = self.verdict
        return content

    def _rebuilt_fields(self) -> dict[str, Any]:
        """Fields that a pickled result makes again when one of them is first used, by name.

        They are its plant, and what is computed from the plant.
        """
        if not self.runs:
            return super()._rebuilt_fields()
        # A program has no states of its own: its runs are pickled, build their plants again, and give these fields.
        motion = _ProgramMotion(self.runs, self.config, self.wandering)
        return {
            "plant": motion.plant,
            "positions_at": motion.positions_at,
            "contacts_at": _contacts_of_program(self.runs, self.wandering),
            "context": self.runs[-1].context,
        }

    @cached_property
    def verdict(self) -> Verdict:
        """Verdict about the run: how far it did what was asked. Its bounds are set under ``verdict`` in a station.

        It is evaluated when it is first used.
        """
        verdict = self._verdict_of_program() if self.runs else verdict_of(self)
        # Inertias that an import has estimated are noted with every result.
        estimates = [estimated_inertias(robot.model) for robot in self.plant.robots.values()]
        notes = [estimate for estimate in estimates if estimate is not None]
        for run in self.runs or (self,):
            notes += empty_grips(run)
        # A program has no moves of its own: those of its runs are in their verdicts, which are joined to this one.
        own_moves = [judge_move(self, move) for move in self.moves]
        return replace(verdict, notes=tuple(notes), moves=(*own_moves, *verdict.moves))

    def _verdict_of_program(self) -> Verdict:
        """Combine the verdicts about the runs of a program, and add how the program ended and its doubts."""
        # A run that continues another one at its time has absolute times; those of the program count from 0.
        verdict = join_verdicts(
            [run.verdict for run in self.runs],
            durations=[run.simulated_time for run in self.runs],
            names=[run.place for run in self.runs],
            starts=[run.start_time for run in self.runs],
        )
        return replace(
            with_move_names(verdict, self.move_spans),
            ended=self.end_in_words,
            severity_of_end=severity_of_end(self),
            # The solver's doubts about all runs, each once, see `join_runs`.
            doubts=tuple(self.solver_warnings),
        )

    @cached_property
    def images(self) -> "dict[str, Footage]":
        """Images of the station's cameras, by the name of the camera. They are rendered when they are first used."""
        # imported here, since it takes long to load
        from simrob_drake.results.footage import (
            footage_of,
        )

        return footage_of(self)

    @property
    def warnings(self) -> list[str]:
        """Reasons why the result may be wrong, or not as requested, although the run was completed, in words."""
        return [*self.solver_warnings, *self.verdict.warnings]

    @property
    def remarks(self) -> list[Remark]:
        """Remarks about the run with severity and remedy: the sentence of its verdict, then warnings and notes.

        A run that failed has the sentence only.
        """
        return self.verdict.remarks

    def __repr__(self) -> str:
        """Three lines: how the run ended, how much was recorded, and the warnings, or else the verdict's judgement."""
        samples = (
            f"{len(self.times)} samples of {len(self.names)} columns to {self.stop_time:.4g} s"
        )
        # One line, since notebooks and debuggers show results among others.
        judgement = shorten("; ".join(self.warnings) or self.verdict.judgement, _WIDTH)
        return f"{self.config.name}: {self.message}\n{samples}, {self.speed_in_words}\n{judgement}"

    def _repr_html_(self) -> str:
        """HTML for notebooks: end of the run, verdict, film strip, and the table of last positions and torques."""
        # imported here, since it takes long to load
        from simrob_drake.results.animation.pictures import (
            film_strip,
        )

        # The picture is a part of the HTML, so that a notebook needs no further file.
        strip = b64encode(film_strip(self)).decode()
        end_and_size = repr(self).splitlines()[:2]
        verdict = self.verdict
        rows = [verdict.headings, *verdict.cells]
        return (
            f"<p>{'<br>'.join(map(escape, end_and_size))}</p>"
            f"{html_of_remarks(verdict.judgement, verdict.remarks, rows)}"
            f'<img alt="film strip" style="max-width: 100%" src="data:image/png;base64,{strip}">'
            f"{html_table(table_of(self))}"
        )

    def save(
        self,
        folder: Path | str | None = None,
        *,
        force: bool = False,
        recording: bool = True,
        video: bool = False,
        frames: int | Literal["events"] | None = None,
        plots: PlotFormat = "png",
    ) -> Path:
        """Write the result to a folder: see :func:`simrob_drake.results.files.save_result` for its files.

        Args:
            folder: the folder. If it is None, a new folder ``runs/<station>-<time>`` is taken.
            force: whether an earlier result in the folder is replaced.
            recording: whether a recording and a film strip are written.
            video: whether a video is written; it needs the extra ``video``.
            frames: count of frames of the film strip, or "events" for a frame of each event. If it is None, a program
                has a frame of each event, and other runs seven frames.
            plots: format of the plots.

        Returns:
            the folder.
        """
        target = default_folder(self.config.name) if folder is None else as_path(folder, "folder")
        return save_result(
            self,
            self.verdict,
            target,
            force=truth(force, "force"),
            recording=truth(recording, "recording"),
            video=truth(video, "video"),
            frames=frames,
            plots=plots,
        )

    def film(self, file: Path | str, *, frames: int | Literal["events"] = 7) -> Path:
        """Write the motion as a film, and return its file.

        Args:
            file: ``.html`` for a page that plays, ``.png`` for a strip of frames, ``.mp4`` for a video.
            frames: count of frames of a strip, or "events" for a frame of each event.

        Raises:
            InvalidParameter: the ending of the file is another one, or there are fewer than two frames.
            OutputError: the file cannot be written.
        """
        # Imported here, since these modules take long to load.
        from simrob_drake.results.animation.pictures import save_film_strip, save_video
        from simrob_drake.results.animation.recording import save_recording

        target = as_path(file, "file")
        match check_ending(target, FILM_ENDINGS, "file"):
            case ".png":
                return save_film_strip(self, target, frames=frames)
            case ".mp4":
                return save_video(self, target)
            case _:
                return save_recording(self, target)

    def plot(self, *signals: str) -> "NotebookFigure":
        """Draw signals of the run: a frame for each. A notebook shows the returned figure.

        Args:
            signals: names of signals, with ``*`` for any part, such as ``q.joint_2`` or ``tau.*``. If there are none,
                positions and torques of all joints that move are drawn.

        Raises:
            UnknownName: there is no signal of this name.
        """
        # Imported here, since Matplotlib takes long to load.
        from simrob_drake.results.saved import plot_results

        return plot_results(self, signals=signals)

    def check(self, strict: bool = True) -> Self:
        """Check that the run did what was asked.

        Args:
            strict: whether to check at all.

        Returns:
            the run itself.

        Raises:
            VerdictError: the run has warnings, diverged, or a block failed in it. The run is the ``result`` of the
                error.
        """
        if not truth(strict, "strict"):
            return self
        # A run that diverged has many warnings with the same cause, so only its end counts.
        problems = [self.message] if self.ending in (DIVERGED, FAILED) else self.warnings
        if problems:
            text = compound(
                "{station}: {problems}", station=self.config.name, problems="; ".join(problems)
            )
            raise VerdictError(text, self)
        return self

    def summary(self) -> dict[str, Any]:
        """Content of the file ``summary.json``."""
        return summary_of(self, self.verdict)


Run = TypeVar("Run", bound=RecordedRun)
"""Class of a run that is joined with others."""

_PositionsOfJoints: TypeAlias = dict[str, Vector]
"""Positions of joints (k, n) at k times, by the name that the joint has in a `State`."""


def join_runs(
    runs: Sequence[Run],
    *,
    begun: tuple[StationConfig, State | None] | None = None,
    left: StationConfig | None = None,
    program: str = "",
    move_spans: Sequence[MoveSpan] = (),
) -> Run:
    """Join runs that follow each other to one result.

    The result has the signals that all runs have, and the pose ``piece.<piece>`` of each handed-over piece. At a time
    at which one run ends and the next one begins, the values are those of the next one. Recordings show contact forces
    only if there is a single run, and no piece is handed over.

    Args:
        runs: the runs, in order. Each begins in the state in which the one before ended.
        begun: station and state before the first run. If it is None, they are those of the first run.
        left: the station after the last run, if it was changed after it, such as by a hand-over.
        program: YAML text that repeats the program; empty if it cannot be written as YAML.
        move_spans: when each move of the program began and ended.

    Raises:
        InvalidParameter: there is no run, or the stations of the runs have different robots or pieces.
    """
    if not runs:
        raise InvalidParameter(
            "runs", "empty", message("results.what_was_run_last", "at least one run")
        )
    stations = [run.config for run in runs]
    if left is not None:
        stations.append(left)
    _check_same_names(stations)
    first_station = runs[0].config
    start = runs[0].start
    if begun is not None:
        first_station, start = begun

    # As one run, the program lasts from the begin of its first run to the end of its last one.
    last = runs[-1]
    # Begin of each run, and then the end of the last one: one entry more than runs.
    boundaries = begins_of(*runs).round(_TIME_DECIMALS)
    begins = boundaries[:-1]
    ends = boundaries[1:]
    handed_over = _handed_over_pieces(stations)
    config = last.config.model_copy(update={"duration": float(ends[-1])})
    if handed_over:
        config = _with_free_pieces(config, handed_over)
    motion = _ProgramMotion(runs, config, handed_over)

    # Times of a program count from the begin of its first run.
    shifts = [begin - run.start_time for run, begin in zip(runs, begins.tolist(), strict=True)]
    # The last sample of each run but the last one is left out: the first sample of the next run replaces it.
    kept = [slice(None, -1)] * (len(runs) - 1) + [slice(None)]
    times = [run.times[part] + shift for run, part, shift in zip(runs, kept, shifts, strict=True)]
    step_times = [run.step_times[1:] + shift for run, shift in zip(runs, shifts, strict=True)]
    notes: dict[str, dict[str, str]] = {}
    for run in runs:
        notes |= run.notes
    solver_warnings = [warning for run in runs for warning in run.solver_warnings]
    # Fields that are not given here are those of the last run, such as its final state.
    whole = replace(
        last,
        config=config,
        plant=motion.plant,
        message=_end_of_program(last, len(runs), float(begins[-1])),
        times=np.concatenate(times),
        step_times=np.concatenate([[0.0], *step_times]),
        positions_at=motion.positions_at,
        stepping_time=sum(run.stepping_time for run in runs),
        signal_time=sum(run.signal_time for run in runs),
        notes=notes,
        start=start,
        references={},
        solver_warnings=list(dict.fromkeys(solver_warnings)),  # without repetitions
        contacts_at=_contacts_of_program(runs, handed_over),
        wandering=tuple(handed_over),
        did="",
        place="",
        moves=(),
        runs=tuple(runs),
        begun=first_station,
        marks=tuple(_marks(runs, stations, ends=ends)),
        move_spans=tuple(move_spans),
        program=program,
        trace=None,  # the states of the runs belong to different diagrams
        is_continued=False,
        continues=False,
    )
    return _with_signals(whole, kept, handed_over)


def _check_same_names(stations: Sequence[StationConfig]) -> None:
    """Check that stations have robots and pieces of the same names.

    Raises:
        InvalidParameter: they do not.
    """
    # Signals and plants are joined by names: a robot that is missing in one of the runs would have no motion
    # there.
    for key in ("robots", "pieces"):
        names = {frozenset(getattr(station, key)) for station in stations}
        if len(names) > 1:
            raise InvalidParameter(
                "runs",
                message("results.stations_with_other", "of stations with different {key}", key=key),
                message("results.one_station", "of stations with the same robots and pieces"),
            )


def _handed_over_pieces(stations: Sequence[StationConfig]) -> list[str]:
    """Names of the pieces that hang on different things, or at different poses, in some of the stations.

    Args:
        stations: stations with pieces of the same names.
    """
    handed_over = []
    for name in stations[0].pieces:
        pieces = [station.pieces[name] for station in stations]
        # Poses count, too: a gripper may grasp the same piece at another place.
        attachments = {(piece.parent, piece.frame, piece.pose, piece.free) for piece in pieces}
        if len(attachments) > 1:
            handed_over.append(name)
    return handed_over


def _marks(
    runs: Sequence[RecordedRun], stations: Sequence[StationConfig], ends: Vector
) -> list[Event]:
    """Events at the ends of the runs of a program: the pieces that were handed over there, or else the end of the run.

    The last run has no event unless pieces are handed over after it: the end of the program is an event of its own.

    Args:
        runs: the runs.
        stations: the stations of the runs, and perhaps the station after the last run.
        ends: time at which each run ends, since the start of the program [s].
    """
    marks = []
    # For each run: its end, its station and the station after it. The last run may have no station after it; its mark
    # is left out then.
    changes = zip(runs, ends.tolist(), pairwise(stations), strict=False)
    for index, (run, end, (before, after)) in enumerate(changes):
        hand_overs = []
        for name, piece in after.pieces.items():
            # Only the parent counts here: a piece that is grasped at another place is not handed over.
            if before.pieces[name].parent != piece.parent:
                hand_overs.append(f"{name} to {piece.parent}")
        is_last = index == len(runs) - 1
        # A hand-over replaces the end of the run at the same time: it is the more important event.
        if hand_overs:
            marks.append(Event(end, ", ".join(hand_overs)))
        elif not is_last:
            marks.append(Event(end, _end_in_words(run)))
    return marks


def _end_in_words(run: RecordedRun) -> str:
    """Sentence that a run of a program ends, such as ``move 3 (move_l of left) ends``.

    The name of the move is left out if the run has none.
    """
    did = run.did or message("results.a_move", "move")
    if not run.place:
        return message("results.run_ends", "{did} ends", did=did)
    return message("results.move_ends", "{place} ({did}) ends", place=run.place, did=did)


class _ProgramMotion:
    """Positions of the plant in a program, whose runs follow each other.

    Attributes:
        plant: the plant of the program: that of the last run, or if pieces are handed over, one in which these are
            free. Without hand-overs, the plants of all runs have the same joints in the same order.
    """

    def __init__(
        self, runs: Sequence[RecordedRun], config: StationConfig, handed_over: Sequence[str]
    ) -> None:
        """Join the motions of runs.

        Args:
            runs: the runs, in order.
            config: configuration of the program, in which handed-over pieces are free.
            handed_over: names of these pieces.
        """
        self._runs = runs
        self._begins = begins_of(*runs).round(_TIME_DECIMALS)
        self.plant = runs[-1].plant
        self._positions_of: list[Callable[[Vector], Vector]] = [run.positions_at for run in runs]
        if handed_over:
            self.plant = _plant_of_program(runs, config)
            self._positions_of = [
                partial(_positions_in_program, run, self.plant, handed_over) for run in runs
            ]

    def positions_at(self, times: Vector) -> Vector:
        """Positions of the program's plant (k, nq) at times (k,) [s] since the start of the program.

        At a time at which one run ends and the next one begins, they are those of the next one.
        """
        # Index of the run to which each time belongs: the last one that has begun. Times outside of the program belong
        # to the first or the last run.
        begun_counts = np.searchsorted(self._begins, times, side="right")
        run_indices = np.clip(begun_counts - 1, 0, len(self._runs) - 1)
        positions = np.empty((len(times), self.plant.plant.num_positions()))
        for index in set(run_indices.tolist()):
            run = self._runs[index]
            is_in_run = run_indices == index
            since_begin = times[is_in_run] - self._begins[index]
            # Rounded begins may bring a time a little beyond the end of its run, where no state is known.
            since_begin = np.clip(since_begin, 0.0, run.simulated_time)
            # All times of a run at once: evaluating the states one after another would be slow.
            positions[is_in_run] = self._positions_of[index](run.start_time + since_begin)
        return positions


def _plant_of_program(runs: Sequence[RecordedRun], config: StationConfig) -> StationPlant:
    """Build the plant of a program in which pieces are handed over. Its robots have the names of all tools they used.

    Args:
        runs: the runs.
        config: configuration of the program, in which handed-over pieces are free.
    """
    # The plant is only posed, so that it needs no contact model.
    station = PosedStation(config.model_copy(update={"contact": None})).station
    robots = {}
    for name, robot in station.robots.items():
        # Captions name all tools that the robot used, each once.
        used = [run.plant.robots[name].tcp for run in runs]
        # A robot without a tool has an empty name for it.
        tools = dict.fromkeys(tool for tool in used if tool)
        robots[name] = replace(robot, tcp=", ".join(tools))
    return replace(station, robots=robots)


def _contacts_of_program(
    runs: Sequence[RecordedRun], handed_over: Sequence[str]
) -> ContactsAt | None:
    """Function that yields Drake's contact results of a program at times (k,) [s].

    Returns None if the program has several runs or hands pieces over: contact results belong to the plant of one run.
    It is also None if the only run has no contact.
    """
    return runs[0].contacts_at if len(runs) == 1 and not handed_over else None


def _with_signals(whole: Run, kept: Sequence[slice], handed_over: Sequence[str]) -> Run:
    """Add the signals to a program: those that all of its runs have, and the poses of handed-over pieces.

    Args:
        whole: the program, with its times and its plant.
        kept: for each run, the range of its samples that belong to the program.
        handed_over: names of these pieces.

    Returns:
        a copy of the program with names, declarations and values of its signals.
    """
    pose_signals = [piece_pose_signal(piece) for piece in handed_over]
    pose_names = [name for signal in pose_signals for name in signal.names]
    # A piece that is free in one run has its pose as a signal there. The pose of the program's plant replaces
    # it.
    common = set(whole.runs[0].names).difference(pose_names)
    for run in whole.runs:
        common &= set(run.names)
    names = [name for name in whole.runs[0].names if name in common]

    # Columns have other indices in each run.
    rows = []
    for run, part in zip(whole.runs, kept, strict=True):
        indices = [run.names.index(name) for name in names]
        rows.append(run.values[part][:, indices])
    values = [np.vstack(rows)]
    if handed_over:
        positions = _by_joint(whole.plant.plant, whole.positions_at(whole.times))
        for piece in handed_over:
            # Drake's order of a free body's positions is qw qx qy qz x y z; that of signals is x y z qw qx qy qz.
            poses = np.roll(positions[free_joint(piece)], 3, axis=1)
            values.append(unit_poses(poses))

    signals = {}
    for run in whole.runs:
        for signal in run.signals:
            # Of equal declarations, the latest is kept, with the plots of the last run.
            if common.issuperset(signal.names):
                signals[signal.names] = signal
    return replace(
        whole,
        names=[*names, *pose_names],
        signals=(*signals.values(), *pose_signals),
        values=np.hstack(values),
    )


def _with_free_pieces(config: StationConfig, pieces: Sequence[str]) -> StationConfig:
    """Copy a configuration, with some pieces as free bodies that can be put anywhere.

    No robot of the copy has a tool, since the tool may be one of the pieces.

    Args:
        config: the configuration.
        pieces: names of the pieces.
    """
    resolved_pieces = resolve(config).pieces
    entries = dict(config.pieces)
    for name in pieces:
        # A free body needs a mass, but a point has none. Any mass will do, since no force moves the piece here.
        mass = resolved_pieces[name].model.mass or 1.0
        entries[name] = _free_piece(config.pieces[name], mass)
    without_tool = {"tcp": None, "tcp_offset": None}
    robots = {name: robot.model_copy(update=without_tool) for name, robot in config.robots.items()}
    return config.model_copy(update={"pieces": entries, "robots": robots})


def _free_piece(entry: PieceConfig, mass: float) -> PieceConfig:
    """Copy the section of a piece, as a free body of some mass [kg]."""
    # Any valid inertia will do, since no force moves the piece. The density is removed: it would contradict the mass.
    body = {"mass": mass, "density": None, "inertia": (1.0, 1.0, 1.0)}
    return entry.model_copy(update={"parent": "world", "frame": None, "free": True, **body})


def _positions_in_program(
    run: RecordedRun, plant: StationPlant, handed_over: Sequence[str], times: Vector
) -> Vector:
    """Positions of a program's plant at times of one of its runs, shape (k, nq).

    Args:
        run: the run, with a plant of its own.
        plant: the plant of the program.
        handed_over: names of the handed-over pieces.
        times: times of the run, shape (k,) [s].
    """
    positions = run.positions_at(times)
    # Pieces that hang on something in this run have no joint of their own.
    carried = [piece for piece in handed_over if piece not in run.plant.free_pieces]
    known = _by_joint(run.plant.plant, positions) | _free_positions(run, carried, positions)
    # Joints have the same names in both plants, but other indices.
    in_program = np.empty((len(times), plant.plant.num_positions()))
    for joint in joints_of(plant.plant):
        in_program[:, joint.positions] = known[joint.name]
    return in_program


def _by_joint(plant: MultibodyPlant, positions: Vector) -> _PositionsOfJoints:
    """Split positions of a plant, shape (k, nq), into those of its joints, by the name of the joint."""
    return {joint.name: positions[:, joint.positions] for joint in joints_of(plant)}


def _free_positions(
    run: RecordedRun, pieces: Sequence[str], positions: Vector
) -> _PositionsOfJoints:
    """Positions that pieces which hang on something would have as free bodies.

    Args:
        run: the run.
        pieces: names of the pieces.
        positions: positions of the run's plant, shape (k, nq).

    Returns:
        positions of the joint that each piece would have, by the name of this joint, shape (k, 7): qw qx qy qz x y z.
    """
    plant = run.plant.plant
    bodies = {piece: run.plant.piece_frame(piece, piece) for piece in pieces}
    poses = {piece: np.empty((len(positions), len(XYZ_QUATERNION_NAMES))) for piece in pieces}
    context = plant.CreateDefaultContext()  # one for all rows: making a context takes long
    for index, row in enumerate(positions):
        plant.SetPositions(context, row)
        for piece, body in bodies.items():
            pose = body.CalcPoseInWorld(context)
            poses[piece][index] = xyz_quaternion_from_transform(pose)
    # Drake's order of a free body's positions has the quaternion first.
    return {free_joint(piece): np.roll(rows, -3, axis=1) for piece, rows in poses.items()}


def _end_of_program(last: RecordedRun, count: int, begin: float) -> str:
    """Describe how a program of several runs ended.

    The text of a single run that did not run to its end is kept as it is, but for the time of a monitor.

    Args:
        last: its last run.
        count: count of its runs.
        begin: time of the program at which the last run began [s].
    """
    if last.ending == "completed":
        return message(
            "results.ran_to_its_end",
            "ran to its end at {time:.6g} s",
            time=begin + last.simulated_time,
        )
    if last.runs:  # a program itself, which was cut where something happened
        begin_of_last_part = begin + last.simulated_time - last.runs[-1].simulated_time
        return _end_of_program(last.runs[-1], count, begin_of_last_part)
    # The time in a monitor's message is that of its run: the user reads times of the program.
    if last.ending == "monitor":
        return at_time_of_program(last.message, begin - last.start_time)
    if count == 1:
        return last.message
    return message(
        "results.ending_of_last_run",
        "{ending} of the last of {count} runs, which began at {begin:.4g} s",
        ending=last.message,
        count=count,
        begin=begin,
    )


if not TYPE_CHECKING:
    __getattr__ = former_names_of(__name__, {"joined": "join_runs"})
