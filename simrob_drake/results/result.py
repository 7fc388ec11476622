"""What a simulation returns: a run at a glance, the folder it can be saved to; and runs that follow each other as one.

A piece that changes hands hangs in every run on something else. In the whole it stands free, in a plant of its own, at
the poses that the plants of the runs give it: so pictures and signals of a program are those of any run with a free
piece. Nothing is simulated again.
"""

from base64 import b64encode
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np

from simrob_drake.base.arguments import as_path, truth
from simrob_drake.base.errors import InvalidParameter, VerdictError, shortened
from simrob_drake.base.folders import check_ending
from simrob_drake.base.remarks import Remark
from simrob_drake.results.files import default_folder, save_result
from simrob_drake.results.html import html_of_remarks, html_table
from simrob_drake.results.plots.formats import PlotFormat
from simrob_drake.results.record.run import DIVERGED, FAILED, ContactsAt, RecordedRun
from simrob_drake.results.record.summary import summary_of
from simrob_drake.results.verdict.judge import verdict_of
from simrob_drake.results.verdict.moves import judge_move
from simrob_drake.results.verdict.severity import severity_of_end
from simrob_drake.results.verdict.verdict import Verdict, join_verdicts, with_move_names

if TYPE_CHECKING:
    from simrob_drake.results.footage import Footage

from functools import partial
from typing import TypeVar

from pydrake.multibody.plant import MultibodyPlant

from simrob_drake.base.frames import XYZ_QUATERNION_NAMES, Vector, xyz_quaternion_from_transform
from simrob_drake.base.messages import compound, message
from simrob_drake.parts.station_plant import StationPlant
from simrob_drake.results.record.run import MoveSpan, at_time_of_program, begins_of
from simrob_drake.results.record.state import State, free_joint, joints_of
from simrob_drake.results.record.touch import Event
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.import_findings import estimated_inertias
from simrob_drake.stations.piece_config import PieceConfig
from simrob_drake.stations.posed import PosedStation
from simrob_drake.stations.poses import piece_pose_signal, unit_poses
from simrob_drake.stations.resolve import resolve

_WIDTH = 100  # characters of a line
FILM_ENDINGS = (".html", ".png", ".mp4")  # of files with the motion of a run


def table_of(result: RecordedRun) -> list[list[str]]:
    """Rows of the table of ends: the headings, then position and torques of each joint at the end of a run.

    A station without robots has the position and the speed of each free piece instead.
    """
    if not result.plant.robots:
        speed = message("results.heading_speed", "speed [m/s]")
        table = [[message("results.heading_piece", "piece"), "x [m]", "y [m]", "z [m]", speed]]
        for piece in result.config.free_pieces:
            place, velocity = result.piece_pose(piece)[-1, :3], result.piece_velocity(piece)[-1, :3]
            ends = [compound("{value:.4f}", value=value) for value in (*place, np.linalg.norm(velocity))]
            table.append([piece, *ends])
        return table
    kinematic = not result.config.engine.moves_by_forces
    unit_heading = message("results.heading_unit", "unit")
    table = [
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
        for index, (axis, limit) in enumerate(zip(robot.axes, robot.gains.torque_limit, strict=True)):
            reference, position, torque = (result[f"{robot.prefix}{s}.{axis}"] for s in ("q_ref", "q", "tau"))
            ends = [
                compound("{value:z.3f}", value=values[-1] / robot.model.user_units[index])
                for values in (reference, position)
            ]
            unit, effort = robot.model.unit_names[index], robot.model.effort_units[index]
            peak = torque[np.argmax(np.abs(torque))]
            has_no_limit = kinematic or robot.gains.passive[index]
            shown_limit = "–" if has_no_limit else compound("{limit:g}", limit=limit)
            last_torque = compound("{value:z.3f}", value=torque[-1])
            efforts = (last_torque, compound("{value:z.3f}", value=peak), shown_limit, effort)
            table.append([f"{robot.prefix}{axis}", *ends, unit, *efforts])
    return table


@dataclass(frozen=True)
class SimulationResult(RecordedRun):
    """The result of a run: signals, verdict, plots and recording. There is one however the run ended.

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
        verdict: what was asked of the run against what it did; ``warnings`` and ``remarks`` are parts of it.
        config: configuration of the station in this run.
        plant: the station's plant: ``plant.plant`` is the MultibodyPlant.
        final_state: state of the station at the end, from which another run can begin.
        context: function that returns a new context of the diagram at the end of the run. In a diagram of your own it
            contains the logs of your log sinks.
        start_time: time of the first sample [s].
        stop_time: time of the last sample [s].
        step_times: ends of the accepted steps of the solver [s].
        positions_at: function that computes the plant's positions (k, nq) at times (k,) [s] of the run.
        contacts_at: function that yields Drake's contact results at times (k,) [s]; None if the station has no contact.
        images: what the cameras recorded, by their names.

    All further attributes are listed at :class:`simrob_drake.results.record.run.RecordedRun`.
    """

    def _pickled_content(self) -> dict[str, Any]:
        """Fields of the pickled result, by name.

        The verdicts about its moves are always among them. The verdict about the run is, if it was evaluated before, or
        could not be evaluated after reading.
        """
        moves = tuple(replace(move, verdict=judge_move(self, move)) for move in self.moves)
        content = super()._pickled_content() | {"moves": moves}
        # The contacts that a verdict needs cannot be evaluated again if there is a recorded motion only.
        if "verdict" in self.__dict__ or content["motion"] is not None:
            content["verdict"] = self.verdict
        return content

    def _rebuilt_fields(self) -> dict[str, Any]:
        """Fields of a pickled result that are computed from its plant, by name."""
        if not self.runs:
            return super()._rebuilt_fields()
        motion = _ProgramMotion(self.runs, self.config, self.wandering)
        return {
            "plant": motion.plant,
            "positions_at": motion.positions_at,
            "contacts_at": _program_contacts(self.runs, self.wandering),
            "context": self.runs[-1].context,
        }

    @cached_property
    def verdict(self) -> Verdict:
        """What was asked of the run against what became of it; see ``verdict:`` in a station's file."""
        if self.runs:
            whole = join_verdicts(
                [part.verdict for part in self.runs],
                [part.stop_time for part in self.runs],
                [part.place for part in self.runs],
            )
            whole = replace(
                with_move_names(whole, self.move_spans),
                ended=self.end_in_words,
                severity_of_end=severity_of_end(self),
                doubts=tuple(self.solver_warnings),
            )
        else:
            whole = verdict_of(self)
        estimates = [estimated_inertias(robot.model) for robot in self.plant.robots.values()]
        whole = replace(whole, notes=tuple(estimate for estimate in estimates if estimate is not None))
        return replace(whole, moves=(*(judge_move(self, move) for move in self.moves), *whole.moves))

    @cached_property
    def images(self) -> "dict[str, Footage]":
        """What the cameras of the station saw, by their names; rendered as it is asked for."""
        from simrob_drake.results.footage import footage_of  # which takes its time to load

        return footage_of(self)

    @property
    def warnings(self) -> list[str]:
        """Why the result may be wrong, or other than was asked, though the run went to its end, in words."""
        return [*self.solver_warnings, *self.verdict.warnings]

    @property
    def remarks(self) -> list[Remark]:
        """Remarks about the run with severity and remedy: the sentence of its verdict, then one for each warning."""
        return self.verdict.remarks

    def __repr__(self) -> str:
        """Three lines: how the run ended, how much of it there is, and what missed its bound."""
        samples = f"{len(self.times)} samples of {len(self.names)} columns to {self.stop_time:.4g} s"
        judgement = shortened("; ".join(self.warnings) or self.verdict.judgement, _WIDTH)
        return f"{self.config.name}: {self.message}\n{samples}, {self.speed_in_words}\n{judgement}"

    def _repr_html_(self) -> str:
        """What a notebook shows: how the run ended, its verdict, a film strip, and where all joints ended."""
        from simrob_drake.results.animation.pictures import film_strip  # which takes its time to load

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
        """Write the result to a folder, ``runs/<station>-<time>`` unless given, and return it.

        See :func:`simrob_drake.results.files.save_result`.
        """
        target = default_folder(self.config.name) if folder is None else as_path(folder, "folder")
        kinds = {"force": force, "recording": recording, "video": video}
        kept = {name: truth(value, name) for name, value in kinds.items()}
        return save_result(self, self.verdict, target, frames=frames, plots=plots, **kept)

    def film(self, file: Path | str, *, frames: int | Literal["events"] = 7) -> Path:
        """Write the motion as a film, and return its file.

        Args:
            file: ``.html`` for a page that plays, ``.png`` for a strip of frames, ``.mp4`` for a video.
            frames: of a strip: how many, or one for each of its ``events``.

        Raises:
            InvalidParameter: another kind of file, or fewer than two frames.
            OutputError: the file cannot be written.
        """
        from simrob_drake.results.animation.pictures import save_film_strip, save_video  # which take long to load
        from simrob_drake.results.animation.recording import save_recording

        target = as_path(file, "file")
        match check_ending(target, FILM_ENDINGS, "file"):
            case ".png":
                return save_film_strip(self, target, frames=frames)
            case ".mp4":
                return save_video(self, target)
            case _:
                return save_recording(self, target)

    def check(self, strict: bool = True) -> Self:
        """Return the run; with ``strict`` only if it did what was asked.

        Raises:
            VerdictError: it has warnings, diverged, or a block failed in it; the error holds it as ``result``.
        """
        if truth(strict, "strict"):
            wrong = [self.message] if self.ending in (DIVERGED, FAILED) else self.warnings
            if wrong:
                raise VerdictError(
                    compound("{station}: {problems}", station=self.config.name, problems="; ".join(wrong)), self
                )
        return self

    def summary(self) -> dict[str, Any]:
        """Return what ``summary.json`` holds."""
        return summary_of(self, self.verdict)


Run = TypeVar("Run", bound=RecordedRun)
_Positions = dict[str, Vector]  # by joint, shape (k, nq) each


def joined(
    runs: Sequence[Run],
    *,
    begun: tuple[StationConfig, State | None] | None = None,
    left: StationConfig | None = None,
    program: str = "",
    move_spans: Sequence[MoveSpan] = (),
) -> Run:
    """Return runs that follow each other, each begun where the one before ended, as one result.

    Its signals are those that all runs have, and ``piece.<piece>`` for each piece that changes hands; where one run
    ends and the next begins stands what the next one says. Its recording shows contact forces if it is a single run.
    ``begun`` are station and state before it all, those of the first run unless given; ``left`` the station as the last
    one left it; ``move_spans`` tell when each move of the program began and ended.

    Raises InvalidParameter: no run, or runs of stations with other robots or pieces.
    """
    if not runs:
        raise InvalidParameter("runs", "empty", message("results.what_was_run_last", "some: what was run last"))
    station, start = (runs[0].config, runs[0].start) if begun is None else begun
    last, stations = runs[-1], [*(run.config for run in runs), *([left] if left else [])]
    for key in ("robots", "pieces"):
        if any(set(getattr(station, key)) != set(getattr(stations[0], key)) for station in stations):
            raise InvalidParameter(
                "runs",
                message("results.stations_with_other", "of stations with other {key}", key=key),
                message("results.one_station", "of one station"),
            )
    begins = begins_of(*runs).round(12)  # so that sums of decimals are decimals
    wandering = [name for name in stations[0].pieces if len({_hung(station, name) for station in stations}) > 1]
    config = last.config.model_copy(update={"duration": float(begins[-1])})
    if wandering:
        config = _unbound(config, wandering)
    motion = _ProgramMotion(runs, config, wandering)
    # The first run begins at zero, and each of the others where the one before it ends.
    shifts = [float(begin) - run.start_time for run, begin in zip(runs, begins, strict=False)]
    kept = [slice(None, -1)] * (len(runs) - 1) + [slice(None)]
    marks, ends = list[Event](), begins[1:].tolist()
    for run, end, before, after in zip(runs, ends, stations[:-1], stations[1:], strict=False):
        changes = [name for name, piece in after.pieces.items() if before.pieces[name].parent != piece.parent]
        attached = ", ".join(f"{name} to {after.pieces[name].parent}" for name in changes)
        if attached or len(marks) < len(runs) - 1:
            marks.append((end, attached or _end_in_words(run)))
    whole = replace(
        last,
        config=config,
        plant=motion.plant,
        message=_message(last, len(runs), float(begins[-2])),
        times=np.concatenate([run.times[own] + shift for run, own, shift in zip(runs, kept, shifts, strict=True)]),
        step_times=np.concatenate(
            [[0.0], *(run.step_times[1:] + shift for run, shift in zip(runs, shifts, strict=True))]
        ),
        positions_at=motion.positions_at,
        stepping_time=sum(run.stepping_time for run in runs),
        signal_time=sum(run.signal_time for run in runs),
        notes={name: note for run in runs for name, note in run.notes.items()},
        start=start,
        references={},
        solver_warnings=list(dict.fromkeys(warning for run in runs for warning in run.solver_warnings)),
        contacts_at=_program_contacts(runs, wandering),
        wandering=tuple(wandering),
        did="",
        place="",
        moves=(),
        runs=tuple(runs),
        begun=station,
        marks=tuple(marks),
        move_spans=tuple(move_spans),
        program=program,
        trace=None,
        is_continued=False,
        continues=False,
    )
    return _with_signals(whole, kept, wandering)


def _end_in_words(run: RecordedRun) -> str:
    """Say that a run of a program ended, with the number of its move and the name that the user gave it."""
    did = run.did or message("results.a_move", "move")
    if not run.place:
        return message("results.run_ends", "{did} ends", did=did)
    return message("results.move_ends", "{place} ({did}) ends", place=run.place, did=did)


class _ProgramMotion:
    """Positions of the plant in a program, whose runs follow each other.

    Attributes:
        plant: the plant of the runs; with pieces that change hands, one in which these stand free.
    """

    def __init__(self, runs: Sequence[RecordedRun], config: StationConfig, wandering: Sequence[str]) -> None:
        """Join the motions of runs.

        Args:
            runs: the runs, in order.
            config: configuration of the program, in which the pieces that change hands stand free.
            wandering: names of these pieces.
        """
        self._runs = runs
        self._begins = begins_of(*runs).round(12)  # so that sums of decimals are decimals
        self.plant = runs[-1].plant
        self._positions_of: list[Callable[[Vector], Vector]] = [run.positions_at for run in runs]
        if wandering:
            free = PosedStation(config.model_copy(update={"contact": None})).station
            robots = {}
            for name, robot in free.robots.items():
                tools = dict.fromkeys(run.plant.robots[name].tcp for run in runs)
                robots[name] = replace(robot, tcp=", ".join(tools))
            self.plant = replace(free, robots=robots)
            self._positions_of = [partial(_positions_at, run, self.plant, wandering) for run in runs]

    def positions_at(self, times: Vector) -> Vector:
        """Positions of the plant (k, nq) at times (k,) [s] since the start of the program."""
        number = np.clip(np.searchsorted(self._begins, times, side="right") - 1, 0, len(self._runs) - 1)
        rows = np.empty((len(times), self.plant.plant.num_positions()))
        for index in set(number.tolist()):
            run = self._runs[index]
            own = number == index
            since_begin = np.clip(times[own] - self._begins[index], 0.0, run.simulated_time)
            rows[own] = self._positions_of[index](run.start_time + since_begin)
        return rows


def _program_contacts(runs: Sequence[RecordedRun], wandering: Sequence[str]) -> ContactsAt | None:
    """Function that yields contact results of a program; None if it has several runs, or a plant of its own."""
    return runs[0].contacts_at if len(runs) == 1 and not wandering else None


def _with_signals(whole: Run, kept: Sequence[slice], wandering: Sequence[str]) -> Run:
    """Return a program with the signals that all of its runs have, and the poses of pieces that change hands."""
    poses = [piece_pose_signal(piece) for piece in wandering]
    known = [name for signal in poses for name in signal.names]
    names = [n for n in whole.runs[0].names if n not in known and all(n in run.names for run in whole.runs)]
    rows = [run.values[own][:, [run.names.index(n) for n in names]] for run, own in zip(whole.runs, kept, strict=True)]
    values = [np.vstack(rows)]
    if wandering:
        of_joints = _by_joint(whole.plant.plant, whole.positions_at(whole.times))
        values += [unit_poses(np.roll(of_joints[free_joint(piece)], 3, axis=1)) for piece in wandering]
    signals = {signal.names: signal for run in whole.runs for signal in run.signals if set(signal.names) <= set(names)}
    return replace(whole, names=[*names, *known], signals=(*signals.values(), *poses), values=np.hstack(values))


def _hung(station: StationConfig, piece: str) -> tuple[Any, ...]:
    entry = station.pieces[piece]
    return entry.parent, entry.frame, entry.pose, entry.free


def _unbound(config: StationConfig, pieces: Sequence[str]) -> StationConfig:
    """Return a station in which pieces stand free, to be put anywhere; no robot uses one as its tool."""
    known = resolve(config).pieces

    def free(name: str, entry: PieceConfig) -> PieceConfig:
        mass = known[name].model.mass or 1.0  # of a point: a free piece needs more, though nothing moves this one
        body = {"mass": mass, "density": None, "inertia": (1.0, 1.0, 1.0)}
        return entry.model_copy(update={"parent": "world", "frame": None, "free": True, **body})

    loose = {name: free(name, entry) if name in pieces else entry for name, entry in config.pieces.items()}
    robots = {name: entry.model_copy(update={"tcp": None, "tcp_offset": None}) for name, entry in config.robots.items()}
    return config.model_copy(update={"pieces": loose, "robots": robots})


def _positions_at(run: RecordedRun, plant: StationPlant, wandering: Sequence[str], times: Vector) -> Vector:
    """Return positions of a program's plant at times of one of its runs, shape (k, nq)."""
    positions = run.positions_at(times)
    carried = [piece for piece in wandering if piece not in run.plant.free_pieces]
    known = _by_joint(run.plant.plant, positions) | _carried(run, carried, positions)
    rows = np.empty((len(times), plant.plant.num_positions()))
    for name, places, _ in joints_of(plant.plant):
        rows[:, places] = known[name]
    return rows


def _by_joint(plant: MultibodyPlant, rows: Vector) -> _Positions:
    return {name: rows[:, places] for name, places, _ in joints_of(plant)}


def _carried(run: RecordedRun, pieces: Sequence[str], rows: Vector) -> _Positions:
    """Return where pieces that hang on something are with positions of the run's plant, as those of free ones."""
    plant, found = run.plant.plant, {piece: np.empty((len(rows), len(XYZ_QUATERNION_NAMES))) for piece in pieces}
    bodies = {piece: run.plant.piece_frame(piece, piece) for piece in pieces}
    context = plant.CreateDefaultContext()
    for row, positions in enumerate(rows):
        plant.SetPositions(context, positions)
        for piece, body in bodies.items():
            found[piece][row] = xyz_quaternion_from_transform(body.CalcPoseInWorld(context))
    return {free_joint(piece): np.roll(poses, -3, axis=1) for piece, poses in found.items()}


def _message(last: RecordedRun, count: int, begin: float) -> str:
    """Describe how a program of several runs ended.

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
    if last.runs:  # it was cut where something happened
        return _message(last.runs[-1], count, begin + last.simulated_time - last.runs[-1].simulated_time)
    if last.ending == "monitor":
        return at_time_of_program(last.message, begin - last.start_time)
    return (
        message(
            "results.ending_of_last_run",
            "{ending} of the last of {count} runs, which began at {begin:.4g} s",
            ending=last.message,
            count=count,
            begin=begin,
        )
        if count > 1
        else last.message
    )
