"""Which pushes a robot that walks withstands, from all sides, at all moments of its steps; the folder of trials."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import cycle
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Annotated, Any, ClassVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from pydantic import Field

from simrob_drake.base.constants import STANDARD_GRAVITY
from simrob_drake.base.folders import replaced_at_once, written_at_once
from simrob_drake.base.frames import Vector
from simrob_drake.base.sections import Duration, Integer, Positive, validate_section
from simrob_drake.extensions.tuning.journal import COMPLETED, Row, TrialFolder, write_rows
from simrob_drake.extensions.tuning.scene import Scene, runner_of
from simrob_drake.extensions.tuning.walking import Walking, WalkTrial, bracket, gait_of, subject_of
from simrob_drake.parts.controllers.walk import Walk
from simrob_drake.results.colours import COLOURS
from simrob_drake.simulation.stepping import Outcome
from simrob_drake.stations.resolve import resolve

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

    def tried(self, *, allow_code: bool) -> "list[Callable[..., PushTrial]]":
        """Return what makes the trial of each moment."""
        period = self.period or _period(
            self.scene(self.overrides, self.start, allow_code=allow_code)
        )
        moments = [
            round(self.start + period * phase / self.phases, 9) for phase in range(self.phases)
        ]
        return [partial(PushTrial, moment=moment) for moment in moments]

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
                held = sum(row["ended"] == COMPLETED for row in some) / len(some)
                weakest = {"pushes": len(some), "withstood": held} if self.force else _weakest(some)
                found.append({"settings": name, "direction_deg": turn, **weakest})
        return found


def push_of(row: Row, key: str) -> float:
    """Return a figure of a push that is withstood, as a row has it; 0 of a trial that never came to its end."""
    return float(row.get(key) or 0.0)


def _weakest(rows: Sequence[Row]) -> Row:
    weakest = min(rows, key=lambda row: push_of(row, "force"))
    keys = ("force", "impulse", "impulse_per_mass")
    middle = {f"median_{key}": median(push_of(row, key) for row in rows) for key in keys}
    return {
        **{f"weakest_{key}": push_of(weakest, key) for key in keys},
        **middle,
        "moment": weakest["moment"],
    }


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
    """Pushes in all directions at one moment [s]."""

    spec: PushMap  # the map that they belong to
    moment: float  # when they begin

    @property
    def own_columns(self) -> list[Row]:
        """Their moment and directions."""
        return [{"moment": self.moment, "direction_deg": turn} for turn in self.spec.turns]

    def scene(self) -> Scene:
        """Return the walk, with a push whose force is still to be told."""
        seconds = self.moment + self.spec.duration + self.spec.after
        changes = {
            **self.changes,
            f"forces.{_PUSH}": {"kind": "push", **self._push([0.0, 0.0, 1.0])},
        }
        return self.spec.scene(changes, seconds, seed=self.seed, allow_code=self.allow_code)

    def measured(self) -> list[Row]:
        """Return for each direction the force, its impulse, that over the robot's mass, and how a run ended.

        Where the largest force was searched for, that is the run under the next larger one that was tried.
        """
        spec, scene, rows = self.spec, self.scene(), list[Row]()
        subject = subject_of(scene.config, spec.at)
        weight = subject.mass * STANDARD_GRAVITY
        first = spec.first or _FIRST * weight
        fork = runner_of(scene.config).branch(self.moment, reference=scene.reference)

        def outcome(turn: float, force: float) -> Outcome:
            return fork.outcome(
                {_PUSH: self._push((force * subject.along(np.deg2rad(turn))).tolist())}
            )

        for turn in spec.turns:
            if spec.force is None:
                force, end = _largest(
                    partial(outcome, turn), first, close=spec.close, most=_MOST * weight
                )
                first = force or first
            else:
                force, end = spec.force, outcome(turn, spec.force)
            impulse = force * spec.duration
            ending = {"ended": end.stopped_by or end.ending, "message": end.message}
            rows.append(
                {
                    "force": force,
                    "impulse": impulse,
                    "impulse_per_mass": impulse / subject.mass,
                    **ending,
                }
            )
        return rows

    def _push(self, force: list[float]) -> Row:
        return {
            "at": self.spec.at,
            "start": self.moment,
            "duration": self.spec.duration,
            "force": force,
        }


def _largest(
    outcome: Callable[[float], Outcome], first: float, *, close: float, most: float
) -> tuple[float, Outcome]:
    """Return the largest force that is withstood [N], and how the run ended under the next larger one."""
    ends: dict[float, Outcome] = {}

    def holds(force: float) -> bool:
        ends[force] = outcome(force)
        return ends[force].ending == COMPLETED

    low, high = bracket(holds, first, close=close, most=most)
    return low, ends[high if high in ends else low]


_DPI, _SIDE = 110, 4.2  # and inches of a frame
_FILLED, _WIDEST = (
    0.6,
    8,
)  # the part of a direction that its bars fill, and how many there are at least
_NAMED, _BETWEEN = (
    12,
    0.5,
)  # directions that all have their number; where the lengths stand between the first two
_IMPULSE, _SHARE = "impulse over mass [N·s/kg]", "part of the pushes withstood"


def save_push_picture(spec: PushMap, rows: Sequence[Row], file: Path) -> None:
    """Draw all directions around the robot, ahead upward, and for each of the settings a map over the moments.

    A bar in each direction is the weakest of all moments and draws, a stroke over it their median; nothing stands
    between directions, where nothing was tried. Maps tell the weakest of all draws. Of pushes of one force all tell
    which part of them is withstood. Raises OutputError: the disk does not take it.
    """
    names = list(spec.settings)
    values = {
        name: _values(spec, [row for row in rows if row["settings"] == name]) for name in names
    }
    highest = max(float(each.max()) for each in values.values()) or 1.0
    figure = Figure(figsize=(_SIDE * (1 + len(names)), _SIDE), layout="constrained")
    title = f"{Path(spec.station).stem}: pushes of {f'{spec.force:g} N for ' if spec.force else ''}{spec.duration:g} s"
    figure.suptitle(title, x=0.01, ha="left", fontweight="bold")
    around: Any = figure.add_subplot(1, 1 + len(names), 1, projection="polar")
    around.set_theta_zero_location("N")
    around.set_thetagrids(
        spec.turns if len(spec.turns) <= _NAMED else spec.turns[:: len(spec.turns) // 4]
    )
    around.set_rlabel_position(_BETWEEN * spec.turns[1] if len(spec.turns) > 1 else 90.0)
    around.set_axisbelow("line")  # circles and lengths over the bars
    around.yaxis.set_major_locator(MaxNLocator(4))
    around.tick_params(axis="y", labelsize=8)
    what = _SHARE if spec.force else _IMPULSE
    around.set_title(what, fontsize=9)
    for place, (name, colour) in enumerate(zip(names, cycle(COLOURS), strict=False)):
        _draw_around(around, spec, values[name], name, colour, (place, len(names)))
        axes = figure.add_subplot(1, 1 + len(names), 2 + place)
        _draw_map(axes, spec, values[name], rows, name, highest, what)
    around.set_ylim(0.0, highest)
    around.legend(fontsize=8, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.08))
    with replaced_at_once(file) as work:
        figure.savefig(work, dpi=_DPI, format="png")


def _values(spec: PushMap, rows: Sequence[Row]) -> Vector:
    """Return what is drawn of each push, shape (draws, moments, directions)."""
    found = [
        float(row["ended"] == COMPLETED) if spec.force else push_of(row, "impulse_per_mass")
        for row in rows
    ]
    return np.array(found).reshape(-1, spec.phases, spec.directions)


def _draw_around(
    axes: Axes, spec: PushMap, values: Vector, name: str, colour: str, place: tuple[int, int]
) -> None:
    """Draw the bars of settings that are the first of so many by their ``place``."""
    number, count = place
    width = _FILLED * 2 * np.pi / max(len(spec.turns), _WIDEST) / count
    # to the left is counted up
    angles = np.deg2rad(spec.turns) - (number - (count - 1) / 2) * width
    lengths = values.mean(axis=(0, 1)) if spec.force else values.min(axis=(0, 1))
    axes.bar(angles, lengths, width, color=colour, label=name if spec.force else f"{name}: weakest")
    if not spec.force:
        medians = np.median(values, axis=(0, 1))
        axes.hlines(
            medians, angles - width / 2, angles + width / 2, color=colour, label=f"{name}: median"
        )


def _draw_map(
    axes: Axes,
    spec: PushMap,
    values: Vector,
    rows: Sequence[Row],
    name: str,
    highest: float,
    what: str,
) -> None:
    cells = (values.mean if spec.force else values.min)(axis=0)
    image = axes.imshow(cells.T, aspect="auto", vmin=0.0, vmax=highest, cmap="viridis")
    moments = [row["moment"] for row in rows[: cells.size : spec.directions]]
    axes.set_xticks(
        range(spec.phases),
        [f"{moment:.4g}" for moment in moments],
        rotation=45,
        ha="right",
        fontsize=8,
    )
    axes.set_yticks(range(spec.directions), [f"{turn:.4g}" for turn in spec.turns], fontsize=8)
    axes.set_xlabel("moment of the push [s]")
    axes.set_ylabel("direction, from ahead to the left [deg]")
    axes.set_title(name, fontsize=9)
    axes.figure.colorbar(image, ax=axes, label=what)


class WalkingFolder(TrialFolder[WalkTrial]):
    """Trials of a robot that walks, in a folder."""

    def __init__(
        self, folder: Path | str, walking: Walking, *, force: bool = False, allow_code: bool = False
    ) -> None:
        """Begin trials in a new folder, or go on with the same ones; ``force`` replaces what is there.

        Raises SimrobError: trials that cannot be; OutputError: the folder holds something else, or cannot be written;
        InvalidConfig: the station has changed since they began.
        """
        self._walking, digest = walking, walking.check(allow_code=allow_code)
        trials = walking.trials(allow_code=allow_code)
        super().__init__(folder, f"{walking.name}.yaml", walking, trials, digest, force=force)

    def run(
        self, *, workers: int | None = None, scheduler: str | None = None, progress: bool = True
    ) -> list[Row]:
        """Make trials as :meth:`made`, write table, summary, picture; return the rows."""
        rows = self.made(workers=workers, scheduler=scheduler, progress=progress)
        walking, place = self._walking, self.folder / self._walking.name
        write_rows(place.with_suffix(".csv"), rows)
        content = {"asked": walking.model_dump(mode="json"), "summary": walking.summary(rows)}
        written_at_once(
            place.with_suffix(".json"), json.dumps(content, indent=1, ensure_ascii=False)
        )
        if isinstance(walking, PushMap):
            save_push_picture(walking, rows, place.with_suffix(".png"))
        return rows


def push_map(
    station: str,
    folder: Path | str | None = None,
    *,
    workers: int | None = None,
    progress: bool = True,
    **keys: Any,
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
        keys: the other keys of :class:`~simrob_drake.extensions.tuning.walking_folder.PushMap`.
    """
    what = validate_section(PushMap, {"station": station, **keys}, "push map")
    with TemporaryDirectory() as nowhere:
        return WalkingFolder(folder or Path(nowhere) / what.name, what).run(
            workers=workers, progress=progress
        )
