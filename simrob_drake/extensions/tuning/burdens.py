"""How much a robot that walks bears: load, slippery or soft ground, slopes and steps, each as much as can be."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from math import ceil, inf
from statistics import median
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from simrob_drake.base.errors import Unsuitable
from simrob_drake.base.messages import message
from simrob_drake.base.sections import Duration, Fraction
from simrob_drake.extensions.tuning.doubts import Change
from simrob_drake.extensions.tuning.journal import COMPLETED, Row
from simrob_drake.extensions.tuning.scene import Scene
from simrob_drake.extensions.tuning.walking import Subject, Walking, WalkTrial, bracket, subject_of
from simrob_drake.results.record.walks import locomotion

Kind = Literal["load", "friction", "stiffness", "slope", "step"]
_HELD_UP = message("tuning.held_up", "held up")
_STANDS = 0.05  # a robot that goes no further than that stands on its place [m]
_TILE, _BEFORE = 0.1, 0.4  # side of the tiles of a field of steps, and level ground before it [m]
_HARDEST = 1e3  # times as hard as at first


@dataclass(frozen=True)
class _Way:
    """A walk without a burden: its scene, who goes, how far ahead [m], and the seed of its draw."""

    scene: Scene
    subject: Subject
    ahead: float
    seed: int | None


@dataclass(frozen=True)
class _Burden:
    """What makes a walk harder."""

    unit: str  # of its figure
    changes: Callable[[_Way, float], Change]  # of the station, for a figure
    first: float  # the figure that is tried first
    last: float  # the hardest that there is; figures fall from first to last where that is less

    def figure(self, hard: float) -> float:
        """Return the figure that is so many times as hard as the first."""
        return self.first * hard if self.last > self.first else self.first / hard


def _loaded(way: _Way, mass: float) -> Change:
    return {
        "pieces.burden": {
            "model": "parcel",
            "mass": mass,
            "parent": way.subject.name,
            "frame": way.subject.root,
        }
    }


def _slippery(way: _Way, friction: float) -> Change:
    return {"contact.friction": {"static": friction, "dynamic": 0.9 * friction}}


def _soft(way: _Way, stiffness: float) -> Change:
    contact = way.scene.config.contact
    if contact is None or contact.model != "point":
        raise Unsuitable(
            "--vary stiffness",
            message("tuning.stiffness_of_point", "only contact.model point has a stiffness"),
        )
    return {"contact.stiffness": stiffness}


def _sloping(turn: float) -> Callable[[_Way, float], Change]:
    """Return what inclines the floor, upward to a side of the robot's way: 0 ahead, 90 to its left [deg]."""

    def sloping(way: _Way, slope: float) -> Change:
        return {
            "floor.incline_deg": slope,
            "floor.heading_deg": float(np.rad2deg(way.subject.heading)) + turn,
        }

    return sloping


def _uneven(way: _Way, height: float) -> Change:
    length = max(ceil((way.ahead - _BEFORE) / _TILE) + 2, 5) * _TILE
    heading, seed = float(np.rad2deg(way.subject.heading)), way.seed or 0
    field = {
        "kind": "steps",
        "height": 1e-3 * height,
        "size": _TILE,
        "start": _BEFORE,
        "length": length,
    }
    return {"floor.terrain": {**field, "width": 1.0, "heading_deg": heading, "seed": seed}}


_BURDENS: Mapping[Kind, Mapping[str, _Burden]] = {
    "load": {"load on the trunk": _Burden("kg", _loaded, 0.25, inf)},
    "friction": {"coefficient of friction": _Burden("–", _slippery, 0.5, 0.0)},
    "stiffness": {"stiffness of the ground": _Burden("N/m", _soft, 5e4, 0.0)},
    "slope": {
        "slope up": _Burden("deg", _sloping(0.0), 4.0, 45.0),
        "slope down": _Burden("deg", _sloping(180.0), 4.0, 45.0),
        "slope across, up to the left": _Burden("deg", _sloping(90.0), 4.0, 45.0),
    },
    "step": {"random steps, up and down": _Burden("mm", _uneven, 5.0, inf)},
}


class Burdens(Walking):
    """Burdens under which a robot still goes its way: of each the largest, or the least where less is harder."""

    name: ClassVar[str] = "limits"

    vary: Annotated[list[Kind], Field(min_length=1)]
    """Which: load, friction, stiffness, slope, step."""
    seconds: Duration = 10.0
    """How long each walk is [s]."""
    least: Fraction = 0.5
    """How far ahead it must bring the robot, as a part of the way without any burden."""

    @property
    def longest(self) -> float:
        """How long each walk is [s]."""
        return self.seconds

    def tried(self, *, allow_code: bool) -> "list[Callable[..., BurdenTrial]]":
        """Return what makes the trial of each burden."""
        kinds = dict.fromkeys(self.vary)
        return [
            partial(BurdenTrial, kind=kind, what=what) for kind in kinds for what in _BURDENS[kind]
        ]

    def summary(self, rows: list[Row]) -> list[Row]:
        """Return of each burden the weakest figure of all draws, and their median; None where one bears none."""
        found = []
        for name, what in dict.fromkeys((row["settings"], row["burden"]) for row in rows):
            some = [row for row in rows if (row["settings"], row["burden"]) == (name, what)]
            burden = next(known[what] for known in _BURDENS.values() if what in known)
            less, nothing = (max, inf) if burden.last < burden.first else (min, 0.0)
            borne = [nothing if row.get("figure") is None else row["figure"] for row in some]
            found_of = {"weakest": less(borne), "median": median(borne)}
            found_of = {
                key: figure if 0 < figure < inf else None for key, figure in found_of.items()
            }
            found.append({"settings": name, "burden": what, **found_of, "unit": burden.unit})
        return found


@dataclass(frozen=True)
class BurdenTrial(WalkTrial):
    """The search for the largest burden of a kind."""

    spec: Burdens  # all that it belongs to
    kind: Kind  # of the burden
    what: str  # which of that kind

    @property
    def own_columns(self) -> list[Row]:
        """Its burden, and the unit of its figures."""
        return [{"burden": self.what, "unit": _BURDENS[self.kind][self.what].unit}]

    def measured(self) -> list[Row]:
        """Return the largest figure that is borne, the next one that was tried, and how the walk with that ended."""
        burden, scene = _BURDENS[self.kind][self.what], self._scene({})
        subject, free = subject_of(scene.config, self.spec.at), scene.run()
        if free.ending != COMPLETED:
            return [{"ended": free.stopped_by or free.ending, "message": free.message}]
        way = _Way(scene, subject, locomotion(free, subject.name).ahead, self.seed)
        ends: dict[float, tuple[str, str]] = {}

        def holds(hard: float) -> bool:
            run = self._scene(burden.changes(way, burden.figure(hard))).run()
            ends[hard] = run.stopped_by or run.ending, run.message
            ahead = locomotion(run, subject.name).ahead if run.ending == COMPLETED else 0.0
            if (
                run.ending == COMPLETED
                and way.ahead > _STANDS
                and ahead < self.spec.least * way.ahead
            ):
                ends[hard] = (
                    _HELD_UP,
                    message(
                        "tuning.came_short",
                        "it came {ahead:.2f} m far in place of {free:.2f} m",
                        ahead=ahead,
                        free=way.ahead,
                    ),
                )
            return ends[hard][0] == COMPLETED

        most = burden.last / burden.first if burden.first < burden.last < inf else _HARDEST
        low, high = bracket(holds, 1.0, close=self.spec.close, most=most)
        ended, text = ends[high if high in ends else low]
        fails = burden.figure(high) if high in ends else None
        figure = burden.figure(low) if low else None
        return [{"figure": figure, "fails_at": fails, "ended": ended, "message": text}]

    def _scene(self, changes: Change) -> Scene:
        spec = self.spec
        return spec.scene(
            {**self.changes, **changes}, spec.seconds, seed=self.seed, allow_code=self.allow_code
        )
