"""What a robot on legs is tried at, and the report: what was found and assumed, what it can do, and what to tune."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from simrob_drake.base.errors import SimrobError
from simrob_drake.base.interpolation import stack_poses
from simrob_drake.base.messages import Message, compound, message, translate
from simrob_drake.extensions.legged.soles import EDGED
from simrob_drake.programs.gaits.walker import Walker, facing_rotation
from simrob_drake.programs.legged_robot import LeggedRobot
from simrob_drake.programs.moves.climb import ClimbMove
from simrob_drake.programs.moves.kick import KickMove
from simrob_drake.programs.moves.move import Move
from simrob_drake.programs.moves.wait import WaitMove
from simrob_drake.programs.program import Program
from simrob_drake.results.animation.pictures import save_film_strip
from simrob_drake.results.record.walks import locomotion
from simrob_drake.results.result import SimulationResult
from simrob_drake.simulation.runner import simulate
from simrob_drake.stations.load import load_station

_SECONDS = 10.0
_STARTS, _RESTS = 0.5, 2.0  # s
_CREEP = 1e-3  # m/s: asked for of a robot that steps on the spot
_FLAT = 1e-4  # m: the lift of a foot that only gives its weight away
_LEANS = 10.0  # deg
_PART = 0.5  # of the way asked for that a walk is to come at least
TRIALS = "stands", "shifts its weight", "steps", "walks"
KICKS, CLIMBS = "kicks", "climbs"
_TRIAL_NAMES = {
    "stands": message("legged.trial_stands", "stands"),
    "shifts its weight": message("legged.trial_shifts", "shifts its weight"),
    "steps": message("legged.trial_steps", "steps"),
    "walks": message("legged.trial_walks", "walks"),
    KICKS: message("legged.trial_kicks", "kicks"),
    CLIMBS: message("legged.trial_climbs", "climbs"),
}
"""Names of the trials as users read them."""


def trial_name(trial: str) -> str:
    """Name of a trial as users read it, a message."""
    return _TRIAL_NAMES[trial]


class FastestAxis(NamedTuple):
    """The axis that turned fastest in a run, in proportion to what its motor does without load."""

    name: str
    share: float
    """Its largest speed over the largest speed of its motor [1]."""


@dataclass(frozen=True)
class Attempt:
    """What became of one of the trials."""

    trial: str  # which
    done: bool  # whether the robot can do it
    outcome: str  # what happened, in words
    ahead: float = 0.0  # how far it came [m]
    result: SimulationResult | None = None  # the run; None if it could not begin
    fastest: FastestAxis | None = (
        None  # the axis that came nearest to the speed of its motor, or beyond it
    )

    @property
    def lasted(self) -> float:
        """How long the run was [s]."""
        return 0.0 if self.result is None else self.result.stop_time


def reason_of(problem: Exception) -> str:
    """Text of an error for the report, in one line. An error that is not ours also has the name of its class."""
    if isinstance(problem, SimrobError):
        # The message of our errors is one line, and can be rendered in each language.
        return problem.message
    text = " ".join(str(problem).split())
    name = type(problem).__name__
    return message("legged.unexpected", "unexpected error: {name}: {text}", name=name, text=text)


def attempt(station: Path, trial: str, speed: float = 0.0) -> Attempt:
    """Return what becomes of one of :data:`TRIALS` of a station.

    Its only loop, in all but the first trial, is ``walk``, at a speed [m/s].
    """
    asked = {TRIALS[0]: 0.0, TRIALS[3]: speed}.get(trial, _CREEP)
    overrides: dict[str, Any] = {"duration": _STARTS + _SECONDS}
    if asked:
        overrides["controllers.walk.commands"] = [{"time": _STARTS, "ahead": asked}]
    if trial == TRIALS[1]:
        overrides["controllers.walk.gait.lift"] = _FLAT
    try:
        result = simulate(load_station(station, overrides), progress=False)
    except Exception as problem:  # one trial that fails, in whatever way, does not end the others
        return Attempt(trial, False, reason_of(problem))
    if result.ending == "diverged":
        return Attempt(trial, False, _divergence_text(result), result=result)
    found = locomotion(result)
    fastest = fastest_axis(result)
    lean = np.rad2deg(found.tilt)
    far = message(
        "legged.far",
        "{ahead:.2f} m ahead and {aside:.2f} m aside",
        ahead=found.ahead,
        aside=abs(found.drift),
    )
    if result.ending != "completed":
        outcome = message(
            "legged.fell_after", "falls at {time:.1f} s ({far})", time=result.stop_time, far=far
        )
        return Attempt(trial, False, outcome, found.ahead, result)
    if trial == TRIALS[3] and found.ahead < _PART * speed * _SECONDS:
        outcome = message(
            "legged.too_short_walk",
            "does not fall, but moves only {far}, of {asked:.2f} m ahead",
            far=far,
            asked=speed * _SECONDS,
        )
        return Attempt(trial, False, outcome, found.ahead, result)
    outcome = message(
        "legged.trial_passed",
        "{seconds:g} s, {far}, leans by {lean:.0f} deg at most; its most loaded joint requires {torque:.0%} of its "
        "torque, {axis} {share:.0%} of its speed",
        seconds=_SECONDS,
        far=far,
        lean=lean,
        torque=found.peak_torque["ratio"],
        axis=fastest.name,
        share=fastest.share,
    )
    return Attempt(
        trial, trial != TRIALS[0] or bool(lean < _LEANS), outcome, found.ahead, result, fastest
    )


def _divergence_text(result: SimulationResult) -> str:
    """Outcome of a trial whose simulation diverged."""
    return message("legged.diverged", "diverged at {time:.1f} s", time=result.stop_time)


def fastest_axis(result: SimulationResult) -> FastestAxis:
    """Find the axis of a run's only robot that came nearest to the speed of its motor, or went farthest beyond it."""
    (robot,) = result.plant.robots.values()
    shares = (np.abs(result.axes("v", robot.name)) / robot.speed_limits).max(axis=0)
    index = int(np.argmax(shares))
    return FastestAxis(robot.axes[index], float(shares[index]))


_RISE = {2: 0.05, 4: 0.1}  # of the step, by the number of legs, in heights of the centre of mass
_TREAD, _BEFORE, _BEHIND = (
    0.5,
    0.05,
    0.15,
)  # of the step, and of the ground before and behind feet, likewise
_LONGER = 1.2  # times a sole, that the step is long at least


def attempt_kick(station: Path) -> Attempt:
    """Return what becomes of a robot that stands in a station, and kicks through the air."""
    return _attempt_move(
        KICKS, station, KickMove(), {}, message("legged.kicked", "stands on both feet again")
    )


def attempt_climb(station: Path, height: float, facing_deg: float) -> Attempt:
    """Return what becomes of a robot that stands in a station, and climbs a step and comes down again.

    Its centre of mass is at a height [m], and it looks in a direction from the world's x [deg].
    """
    front, sole, legs = _feet(station, facing_deg)
    rise, tread = round(_RISE[legs] * height, 4), round(max(_TREAD * height, _LONGER * sole), 4)
    start = round(front + _BEFORE * height, 4)
    way = round(start + tread + front + _BEHIND * height, 4)
    step = {
        "kind": "stairs",
        "height": rise,
        "size": tread,
        "length": tread,
        "start": start,
        "heading_deg": facing_deg,
    }
    ground: dict[str, Any] = {
        "floor": {
            "size": max(8.0, 8 * way),
            "terrain": {**step, "width": max(1.6, 2 * tread, 2 * front)},
        }
    }
    if legs == 2:
        ground |= {"robot.feet": EDGED, "contact": {"model": "hydroelastic_with_fallback"}}
    return _attempt_move(
        CLIMBS,
        station,
        ClimbMove(distance=way),
        ground,
        message("legged.climbed", "climbs a step of {rise:.0f} mm", rise=1e3 * rise),
    )


def _feet(station: Path, facing_deg: float) -> tuple[float, float, int]:
    """Return how far its feet reach ahead of a robot's root, how long the longest is [m], and their number."""
    robot = LeggedRobot(load_station(station))
    root = stack_poses(np.zeros((1, 3)), facing_rotation(facing_deg)[np.newaxis])
    feet = Walker.of(robot.model).feet(robot.worn_feet)
    ahead = [
        foot.poses(robot.position[np.newaxis], root)[0, 0, 3] + max(foot.half[0], foot.over)
        for foot in feet
    ]
    return float(max(ahead)), 2 * float(max(foot.half[0] for foot in feet)), len(feet)


def _attempt_move(
    trial: str, station: Path, move: Move, overrides: Mapping[str, Any], did: str
) -> Attempt:
    """Return what becomes of a robot in a changed station that does a move, and then stands."""
    try:
        robot = LeggedRobot(load_station(station, overrides))
        result = robot.run(Program(moves=(move, WaitMove(duration=_RESTS))))
    except Exception as problem:  # as above
        return Attempt(trial, False, reason_of(problem))
    if result.ending != "completed":
        outcome = message("legged.fell", "falls at {time:.1f} s", time=result.stop_time)
        return Attempt(trial, False, outcome, result=result)
    lean = np.rad2deg(locomotion(result).tilt)
    fastest = fastest_axis(result)
    outcome = message(
        "legged.move_passed",
        "{did}, and leans by {lean:.0f} deg at most; {axis} turns at {share:.0%} of its speed",
        did=did,
        lean=lean,
        axis=fastest.name,
        share=fastest.share,
    )
    return Attempt(trial, True, outcome, result=result, fastest=fastest)


_SLOWER_WALK = message(
    "legged.slower_walk",
    "give the walk a longer step_time (reacting in gaits.yaml, or --set controllers.walk.gait.step_time=...), or the "
    "robot faster motors",
)
_SLOWER_ACTS = {
    KICKS: message(
        "legged.slower_kick",
        "give the kick a smaller speed in gaits.yaml, or the robot faster motors",
    ),
    CLIMBS: message(
        "legged.slower_climb",
        "give the climb a longer step_time in gaits.yaml, or the robot faster motors",
    ),
}
"""What to change where a motor is too slow, by the trial; for all others it is `_SLOWER_WALK`."""
REPORT, PICTURE = "legged.md", "legged.png"
_TUNE = {
    "stands": message("legged.tune_stand", "`servo.kp`, `servo.kd` and `home_deg` in robot.yaml"),
    "shifts its weight": message("legged.tune_shift", "`zmp_inward` and `step_time` in gaits.yaml"),
    "steps": message("legged.tune_steps", "`lift`, `widen` and `double_support` in gaits.yaml"),
    KICKS: message("legged.tune_kick", "`speed` and `zmp_inward` of the kick in gaits.yaml"),
    CLIMBS: message(
        "legged.tune_climb", "`bearing.height`, `lift` and `overhang` of the climb in gaits.yaml"
    ),
    "walks": message(
        "legged.tune_walk", "`step_time`, `bearing.height` and `zmp_inward` in gaits.yaml"
    ),
}
"""What to change first where a trial fails."""


@dataclass
class Made:
    """What was made of a robot."""

    folder: Path  # where it stands
    name: str = ""  # of the robot
    found: list[str] = field(default_factory=list)  # what was seen in its tree, in words
    assumed: list[str] = field(default_factory=list)  # what was made up, in words
    attempts: list[Attempt] = field(default_factory=list)  # what became of the trials
    problem: str = ""  # why something could not be done, in words; empty if all was

    @property
    def too_fast(self) -> list[str]:
        """A sentence for each trial in which a joint turned faster than its motor can, with what to change."""
        lines = list[str]()
        for one in self.attempts:
            if one.fastest is None or one.fastest.share <= 1:
                continue
            lines.append(
                message(
                    "legged.too_fast",
                    "{trial}: {axis} turns at {share:.0%} of the speed of its motor; {remedy}",
                    trial=trial_name(one.trial),
                    axis=one.fastest.name,
                    share=one.fastest.share,
                    remedy=_SLOWER_ACTS.get(one.trial, _SLOWER_WALK),
                )
            )
        return lines

    def rename_folder(self, old: Path, new: Path) -> None:
        """Write another folder in place of an old one in all texts: that in which the robot was made is temporary."""
        places = str(old), str(new)
        self.found = [_with_other_folder(line, *places) for line in self.found]
        self.assumed = [_with_other_folder(line, *places) for line in self.assumed]
        self.attempts = [
            replace(one, outcome=_with_other_folder(one.outcome, *places)) for one in self.attempts
        ]
        self.problem = _with_other_folder(self.problem, *places)

    def can(self, trial: str) -> bool:
        """Whether the robot passed a trial."""
        return any(one.done for one in self.attempts if one.trial == trial)


def _with_other_folder(text: str, old: str, new: str) -> str:
    """Replace a folder in a text. In a message it is replaced in the fields, so that the message keeps its id."""
    if not isinstance(text, Message):
        return text.replace(old, new)
    fields = dict(text.fields)
    for name, value in fields.items():
        if isinstance(value, (str, Path)):
            field_text = value if isinstance(value, str) else str(value)
            fields[name] = _with_other_folder(field_text, old, new)
    return Message(text.id, text.template, fields, text.longest, text.is_sentence)


def save_report(made: Made, folder: Path) -> None:
    """Write the report into a folder, and a picture of the last trial of standing and walking that there is."""
    runs = [one.result for one in made.attempts if one.result is not None and one.trial in TRIALS]
    if runs:
        try:
            save_film_strip(runs[-1], folder / PICTURE)
        except RuntimeError as problem:  # of a renderer, about a mesh
            made.found.append(
                message("legged.no_picture", "no picture: {problem}", problem=str(problem))
            )
    lines = _lines(made, (folder / PICTURE).is_file())
    # The report is in the language of the output, as what the command prints.
    text = "\n".join(translate(line) for line in lines)
    (folder / REPORT).write_text(text + "\n", encoding="utf-8")


def _lines(made: Made, has_picture: bool) -> Iterator[str]:
    """Yield the lines of the report, as messages.

    Args:
        made: what was made, and what became of the trials.
        has_picture: whether a picture stands beside the report.
    """
    nothing = message("legged.nothing", "nothing")
    yield f"# {made.name}"
    for heading, items in (
        (message("legged.heading_found", "## Found"), made.found),
        (message("legged.heading_assumed", "## Assumed"), made.assumed),
    ):
        yield ""
        yield heading
        yield ""
        for item in items or [nothing]:
            yield compound("- {item}", item=item)
    yield ""
    yield message("legged.heading_tried", "## Tried")
    yield ""
    yield message("legged.columns", "| trial | passed | what happened |")
    yield "|---|---|---|"
    yes, no = message("legged.yes", "yes"), message("legged.no", "no")
    for one in made.attempts:
        yield compound(
            "| {trial} | {passed} | {outcome} |",
            trial=trial_name(one.trial),
            passed=yes if one.done else no,
            outcome=one.outcome,
        )
    yield ""
    yield message("legged.heading_next", "## Next")
    yield ""
    nothing_failed = message("legged.nothing_failed", "nothing failed")
    yield compound("- {problem}", problem=made.problem or nothing_failed)
    for line in made.too_fast:
        yield compound("- {line}", line=line)
    if made.attempts:
        failed = next((one.trial for one in made.attempts if not one.done), "walks")
        yield message("legged.tune_first", "- tune first: {keys}", keys=_TUNE[failed])
    if has_picture:
        yield ""
        yield message(
            "legged.picture_line", "![the last trial of standing and walking]({file})", file=PICTURE
        )
