"""Trials of a robot on its feet: as its station says, or a gait of its own, has it walk; and so with other settings.

Each is made with each draw of the robot and its floor: of posture, noise, masses and friction.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from math import inf, sqrt
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import DiagramBuilder

from simrob_drake.base.errors import InvalidConfig, InvalidParameter, SimrobError, Unsuitable
from simrob_drake.base.frames import Vector, xyz_quaternion_from_transform
from simrob_drake.base.messages import message
from simrob_drake.base.sampling import MOST_SEEDS
from simrob_drake.base.sections import Number, Strict
from simrob_drake.extensions.tuning.doubts import Change, drawn
from simrob_drake.extensions.tuning.journal import COMPLETED, Row, Trial
from simrob_drake.extensions.tuning.scene import DRAKE, ENGINE, GAIT, PROGRAM, Scene
from simrob_drake.parts.forces import place_of
from simrob_drake.parts.monitors.sections import Fall
from simrob_drake.parts.resolved import name_or_only
from simrob_drake.parts.targets import frame_names
from simrob_drake.programs.gaits.registry import gaits_of
from simrob_drake.results.record.walks import headings
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.plant import add_plant
from simrob_drake.stations.resolve import resolve

UNCHANGED = "as given"  # what the settings are called that nothing beside changes
_REST = 2.0  # before a gait ends its robot slows down and stands: trials end before that [s]
_FEW = 12  # steps


class Walking(Strict, ABC):
    """What trials of a robot that walks have in common."""

    name: ClassVar[str]  # what their files are called
    station: str
    """A name, or a file."""
    overrides: dict[str, Any] = Field(default_factory=dict)
    """What is changed in it, or in the gait that its robot goes (``gait.name`` ...)."""
    variant: dict[str, Any] = Field(default_factory=dict)
    """What is changed, too, in a second set of trials beside the first; there is none unless this is given."""
    seeds: Annotated[int, Field(ge=0, le=MOST_SEEDS)] = 0
    """How many draws of the robot and its floor; 0 takes both as they were thought."""
    close: Annotated[Number, Field(ge=1e-3, le=0.5)] = 0.1
    """Where a bisection ends: what no longer holds is larger than what does by this part of it."""
    at: str | None = None
    """What is pushed: a tool or a link, at its origin; the robot's root, at its centre of mass, unless given."""

    @property
    @abstractmethod
    def longest(self) -> float:
        """How long the longest run is without what is tried [s]."""

    @property
    def settings(self) -> dict[str, Change]:
        """The changes of each set of trials, by its name."""
        name = ", ".join(f"{key}={value}" for key, value in self.variant.items())
        return {UNCHANGED: self.overrides} | (
            {name: {**self.overrides, **self.variant}} if self.variant else {}
        )

    @property
    def draws(self) -> list[int | None]:
        """The seeds of the draws; None takes all as it was thought."""
        return list(range(self.seeds)) or [None]

    @abstractmethod
    def tried(self, *, allow_code: bool) -> "Sequence[Callable[..., WalkTrial]]":
        """Return what makes each of the trials of one draw; raises SimrobError: none such."""

    def trials(self, *, allow_code: bool = False) -> "list[WalkTrial]":
        """Return all trials: with each of the settings, of each draw; ``allow_code``: the station may name Python code.

        Raises SimrobError: none such.
        """
        every = product(self.settings.items(), self.draws, self.tried(allow_code=allow_code))
        return [
            make(number, name, changes, seed, allow_code, self)
            for number, ((name, changes), seed, make) in enumerate(every, start=1)
        ]

    def check(self, *, allow_code: bool = False) -> str:
        """Check what is known before trials; return a digest; raises SimrobError: no station or feet, or a fall."""
        if "duration" in self.overrides | self.variant:
            raise Unsuitable(
                "--set duration",
                message("tuning.trial_says_duration", "the trial says how long a run is"),
            )
        walks = [
            self.scene(changes, self.longest, allow_code=allow_code)
            for changes in self.settings.values()
        ]
        subject_of(walks[0].config, self.at)
        run = walks[0].run()
        if run.ending != COMPLETED:
            raise SimrobError(
                message(
                    "tuning.falls_by_itself",
                    "{station}: nothing can be found of a robot that falls by itself: {run}",
                    station=self.station,
                    run=run.message,
                )
            )
        return walks[0].digest

    @abstractmethod
    def summary(self, rows: list[Row]) -> list[Row]:
        """Return what the rows of all trials come to."""

    def scene(
        self, changes: Change, seconds: float, *, seed: int | None = None, allow_code: bool = False
    ) -> Scene:
        """Return a walk of some time [s]; a gait goes as many steps as it takes, unless it is told how many.

        The changes are of a set of trials, and of one of them. Raises SimrobError: a station or a gait that cannot be.
        """
        called = {key: f"--set {key}" for key in self.overrides} | {
            key: f"--variant {key}" for key in self.variant
        }

        def scene(changed: Change) -> Scene:
            return Scene.of(self.station, changed, called=called, allow_code=allow_code)

        overrides = {**changes, "duration": seconds}
        found, steps = scene(overrides), _FEW
        if found.program is not None or found.engine != DRAKE:
            key = ENGINE if found.program is None else PROGRAM
            raise InvalidConfig(
                self.station,
                key,
                message(
                    "tuning.station_or_gait",
                    "is to be left out: a station alone is tried, or its {gait}",
                    gait=GAIT,
                ),
            )
        counted = gait_of(found) is not None and "steps" not in found.gait_keys
        while counted and found.motion is not None and found.motion.duration < seconds + _REST:
            steps *= 2
            overrides[f"{GAIT}.steps"] = steps
            found = scene(overrides)
        return found if seed is None else scene({**drawn(found.config, seed), **overrides})


def gait_of(scene: Scene) -> Any:
    """Return the figures of the gait of steps that a robot goes, as ``gaits.yaml`` has them; None if it goes none."""
    if scene.motion is None:
        return None
    known = gaits_of(scene.motion.model, steps=True)
    name = scene.gait_keys.get("name", next(iter(known), None))
    return known.get(name)


@dataclass(frozen=True)
class WalkTrial(Trial):
    """A trial of a robot that walks."""

    settings: str  # the name of those it is made with
    changes: Change  # what these are
    seed: int | None  # of its draw, if any
    allow_code: bool  # whether the station may name Python code

    @property
    def columns(self) -> list[Row]:
        """Its settings, its seed, and what tells its rows from each other."""
        return [{"settings": self.settings, "seed": self.seed, **own} for own in self.own_columns]

    @property
    @abstractmethod
    def own_columns(self) -> list[Row]:
        """What tells its rows from each other, and from those of trials with the same settings and seed."""


@dataclass(frozen=True)
class Subject:
    """A robot on its feet."""

    name: str  # in the station
    root: str  # the link that it is held by in other stations
    mass: float  # with what it carries [kg]
    heading: float  # where it looks at the start, counterclockwise from the world's x [rad]
    ahead: Vector  # its forward direction, level, along the axes of what is pushed, shape (3,)
    left: Vector  # likewise to its left

    def along(self, turn: float) -> Vector:
        """Return the way at an angle from ahead to the left [rad], along the axes of what is pushed, shape (3,)."""
        return np.asarray(np.cos(turn) * self.ahead + np.sin(turn) * self.left)


def subject_of(config: StationConfig, at: str | None = None) -> Subject:
    """Return the robot that is pushed ``at`` a place as ``forces`` name them; the root of the only robot unless given.

    Raises UnknownName: there is no such place; InvalidParameter: no robot on feet of its own whose fall a monitor ends.
    """
    resolved = resolve(config)
    frames = [
        frame
        for frame in frame_names(resolved)
        if config.only_robot or frame.partition(".")[0] in config.robots
    ]
    place = name_or_only(
        at,
        [*config.robots, *(frames if at else [])],
        kind=message("tuning.robot_tool_or_link", "robot, tool or link"),
        key="--at",
    )
    name = config.only_robot or place.partition(".")[0]
    robot = resolved.robots[name]
    if not config.engine.moves_by_forces or not robot.floats:
        expected = message(
            "tuning.station_on_feet",
            "a dynamic station with a robot on feet of its own, and {name} is held",
            name=name,
        )
        raise InvalidParameter("station", config.name, expected)
    if not any(
        isinstance(one, Fall) and one.faller(config.only_robot) == name
        for one in config.monitors.values()
    ):
        expected = message(
            "tuning.station_that_tells",
            "a station that tells when {name} has fallen: monitors: {{fall: {{height: METRES, tilt_deg: 60}}}}",
            name=name,
        )
        raise InvalidParameter("station", config.name, expected)
    station = add_plant(DiagramBuilder(), resolved)
    plant, context, body = station.plant, station.plant.CreateDefaultContext(), station.robots[name]
    base = body.root.CalcPoseInWorld(context)
    heading = float(headings(station, body, xyz_quaternion_from_transform(base)[np.newaxis])[0])
    turned = RigidTransform(RotationMatrix.MakeZRotation(heading), np.zeros(3))
    seen = (
        place_of(station, place)[0].CalcPoseInWorld(context).rotation().inverse()
        @ turned.rotation()
    )
    ahead, left, _ = seen.matrix().T.copy()  # Drake 1.51 lets go of what it shows a column of
    return Subject(
        name=name,
        root=robot.model.root,
        mass=float(plant.CalcTotalMass(context, [body.instance])),
        heading=heading,
        ahead=ahead,
        left=left,
    )


_LEAST = 1e-3  # of the first number: what is smaller is nothing


def bracket(
    holds: Callable[[float], bool], first: float, *, close: float, most: float = inf
) -> tuple[float, float]:
    """Return the largest number that holds, and one not much larger that does not, ``close`` to it as its part.

    That nothing holds again beyond what does not is taken for granted. From the first number on it grows by twos until
    one does not hold, up to ``most``. Returns 0 and the smallest that was tried, where none holds; ``most`` and
    infinity where all do.
    """
    low, high, tried = 0.0, inf, min(first, most)
    while True:
        low, high = (tried, high) if holds(tried) else (low, tried)
        if low >= most or high - low <= close * high < inf or high < _LEAST * first:
            return low, high
        tried = min(2 * low, most) if high == inf else sqrt(low * high) if low else high / 2
