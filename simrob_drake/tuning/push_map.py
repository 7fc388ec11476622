"""Which pushes a robot that walks withstands: from all sides, at all moments of its steps."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from statistics import median
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from simrob_drake.constants import STANDARD_GRAVITY
from simrob_drake.parts.controllers.walk import Walk
from simrob_drake.sections import Duration, Integer, Positive
from simrob_drake.simulation.stepping import Outcome
from simrob_drake.stations.resolve import resolve
from simrob_drake.tuning.bisection import bracket
from simrob_drake.tuning.runners import runner_of
from simrob_drake.tuning.scene import Scene
from simrob_drake.tuning.subject import subject_of
from simrob_drake.tuning.trial import COMPLETED, Row
from simrob_drake.tuning.walking import Walking, WalkTrial, gait_of

_PUSH = "pushed"  # what the station calls it
_PERIOD = 0.8  # of two steps, unless a gait or a loop tells it [s]
_FIRST, _MOST = 0.2, 100.0  # of a robot's weight: what is tried first, and at most


class PushMap(Walking):
    """Pushes in some directions at moments of a period: the largest that are withstood, or those of one force."""

    name: ClassVar[str] = "pushes"

    directions: Annotated[Integer, Field(ge=1, le=72)] = 4
    """How many: the first is forward, the others follow evenly to the left."""
    phases: Annotated[Integer, Field(ge=1, le=1000)] = 8
    """At how many moments, evenly over the period."""
    period: Duration | None = None
    """Of two steps [s]; those of the gait or of the loop `walk` unless given, or 0.8 s."""
    start: Duration = 3.0
    """The first moment [s]; by then the robot shall walk evenly."""
    duration: Duration = 0.1
    """How long a push lasts [s]."""
    after: Duration = 2.0
    """A push is withstood if nothing ends the run for so long after it [s]."""
    first: Positive | None = None
    """What a search tries first [N]; a fifth of the robot's weight unless given."""
    force: Positive | None = None
    """The force of all pushes [N]; nothing is searched for then."""

    @property
    def longest(self) -> float:
        """How long the run is at whose last moment nothing pushes [s]."""
        return self.start + (self.period or _PERIOD) + self.duration + self.after

    @property
    def turns(self) -> list[float]:
        """The directions: angles from ahead to the left [deg]."""
        return [360.0 * place / self.directions for place in range(self.directions)]

    def trials(self, *, allow_code: bool = False) -> "list[PushTrial]":
        """Return all trials: with each of the settings, of each draw, at each moment."""
        period = self.period or _period(self.scene(self.overrides, self.start, allow_code=allow_code))
        moments = [round(self.start + period * phase / self.phases, 9) for phase in range(self.phases)]
        found = [
            PushTrial(0, name, changes, seed, allow_code, self, moment)
            for name, changes in self.settings.items()
            for seed in self.draws
            for moment in moments
        ]
        return [replace(trial, number=number) for number, trial in enumerate(found, start=1)]

    def summary(self, rows: list[Row]) -> list[Row]:
        """Return for each direction, and for all together, what holds at all moments and of all draws.

        That is the weakest and the median of the largest forces that are withstood, with the weakest one's impulse and
        moment; of pushes of one force the part of them that is withstood.
        """
        found = []
        for name in self.settings:
            own = [row for row in rows if row["settings"] == name]
            for turn in (*self.turns, None):
                some = [row for row in own if turn in (None, row["direction_deg"])]
                weakest = _share(some) if self.force else _weakest(some)
                found.append({"settings": name, "direction_deg": turn, **weakest})
        return found


def push_of(row: Row, key: str) -> float:
    """Return a figure of a push that is withstood, as a row has it; 0 of a trial that never came to its end."""
    return float(row.get(key) or 0.0)


def _share(rows: Sequence[Row]) -> Row:
    return {"pushes": len(rows), "withstood": sum(row["ended"] == COMPLETED for row in rows) / len(rows)}


def _weakest(rows: Sequence[Row]) -> Row:
    weakest = min(rows, key=lambda row: push_of(row, "force"))
    keys = ("force", "impulse", "impulse_per_mass")
    middle = {f"median_{key}": median(push_of(row, key) for row in rows) for key in keys}
    return {**{f"weakest_{key}": push_of(weakest, key) for key in keys}, **middle, "moment": weakest["moment"]}


def _period(scene: Scene) -> float:
    """Return how long two steps take, or each leg's turn in a crawl [s]."""
    gait = gait_of(scene)
    for key, many in (("step_time", 2), ("leg_time", 4)):
        if hasattr(gait, key):
            return many * float(scene.gait_keys.get(key, getattr(gait, key)))
    for name, section in scene.config.controllers.items():
        if isinstance(section, Walk):
            robot = resolve(scene.config).robot(section.robot, f"controllers.{name}")
            return 2 * section.walking(robot).step_time
    return _PERIOD


@dataclass(frozen=True)
class PushTrial(WalkTrial):
    """Pushes in all directions at one moment [s].

    Attributes:
        spec: the map that they belong to.
        moment: when they begin.
    """

    spec: PushMap
    moment: float

    @property
    def own_columns(self) -> list[Row]:
        """Their moment and directions."""
        return [{"moment": self.moment, "direction_deg": turn} for turn in self.spec.turns]

    def scene(self) -> Scene:
        """Return the walk, with a push whose force is still to be told."""
        seconds = self.moment + self.spec.duration + self.spec.after
        changes = {**self.changes, f"forces.{_PUSH}": {"kind": "push", **self._push([0.0, 0.0, 1.0])}}
        return self.spec.scene(changes, seconds, seed=self.seed, allow_code=self.allow_code)

    def measured(self) -> list[Row]:
        """Return for each direction the force, its impulse, that over the robot's mass, and how a run ended.

        Where the largest force was searched for, that is the run under the next larger one that was tried.
        """
        spec, scene, rows = self.spec, self.scene(), list[Row]()
        subject = subject_of(scene.config, spec.at)
        weight = subject.mass * STANDARD_GRAVITY
        first = spec.first or _FIRST * weight
        fork = runner_of(scene.config).fork(self.moment, reference=scene.reference)

        def outcome(turn: float, force: float) -> Outcome:
            return fork.outcome({_PUSH: self._push((force * subject.along(np.deg2rad(turn))).tolist())})

        for turn in spec.turns:
            if spec.force is None:
                force, end = _largest(partial(outcome, turn), first, close=spec.close, most=_MOST * weight)
                first = force or first
            else:
                force, end = spec.force, outcome(turn, spec.force)
            impulse = force * spec.duration
            ending = {"ended": end.stopped_by or end.ending, "message": end.message}
            rows.append({"force": force, "impulse": impulse, "impulse_per_mass": impulse / subject.mass, **ending})
        return rows

    def _push(self, force: list[float]) -> Row:
        return {"at": self.spec.at, "start": self.moment, "duration": self.spec.duration, "force": force}


def _largest(outcome: Callable[[float], Outcome], first: float, *, close: float, most: float) -> tuple[float, Outcome]:
    """Return the largest force that is withstood [N], and how the run ended under the next larger one."""
    ends: dict[float, Outcome] = {}

    def holds(force: float) -> bool:
        ends[force] = outcome(force)
        return ends[force].ending == COMPLETED

    low, high = bracket(holds, first, close=close, most=most)
    return low, ends[high if high in ends else low]
