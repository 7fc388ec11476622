"""One run of many: a station with some keys changed, and the row of a table that becomes of it."""

from bisect import bisect
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import numpy as np
from pydantic import Field, model_validator

from simrob_drake.base.messages import message
from simrob_drake.base.sections import Positive, Strict
from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.extensions.tuning.doubts import drawn
from simrob_drake.extensions.tuning.journal import COMPLETED, Row, Trial
from simrob_drake.extensions.tuning.scene import Scene
from simrob_drake.results.record.run import DIVERGED, FAILED, RecordedRun
from simrob_drake.results.record.torques import torque_shares
from simrob_drake.results.record.walks import legged_robots, locomotion, mechanical_work

UNITS: dict[str, str] = read_yaml(Path(__file__).with_name("measures.yaml"))
"""The measures of :func:`measures` and their units.

With several robots each has its own, ``<robot>.<measure>``. Errors are of all axes of a robot, in radians, and metres
for axes that slide.
"""
SIGNED = ("ahead", "speed", "smallest_height")  # those that may be negative
_WALKS = ("distance", "ahead", "speed", "tilt", "smallest_height", "cost_of_transport")
_STILL = 1e-3  # a reference that moves less has nothing to overshoot [rad or m]


def measures(run: RecordedRun) -> dict[str, float | None]:
    r"""Return the figures of a run; a run that diverged has none, and None stands for what means nothing.

    ``tracking_error`` is the root of the mean of :math:`(q_{ref} - q)^2` over samples and axes, ``final_error`` the
    largest :math:`|q_{ref} - q|` at the end, ``overshoot`` by how much a joint goes beyond all that its reference
    does, as a part of that, ``peak_torque`` the largest :math:`|\tau| / \tau_{max}`, and ``work``
    :math:`\int \sum_i |\tau_i \dot q_i| \, dt`. Legged robots have those of
    :class:`~simrob_drake.results.record.walks.Locomotion`, too, and ``fall``, 1 if a fall ended the run, else 0.
    """
    found: dict[str, float | None] = {}
    if run.ending in (DIVERGED, FAILED):
        return found
    walkers = legged_robots(run)
    for name, robot in run.plant.robots.items():
        reference, position = run.axes("q_ref", name), run.axes("q", name)
        error, low, high = reference - position, reference.min(axis=0), reference.max(axis=0)
        moving = high - low > _STILL
        beyond = np.maximum(position - high, low - position)[:, moving] / (high - low)[moving]
        limit = robot.gains.torque_limit
        driven = np.flatnonzero(~robot.gains.passive)
        if len(driven) < len(robot.axes):  # no servo holds passive axes at their references
            error = error[:, driven]
        own = {
            "tracking_error": float(np.sqrt(np.mean(error**2))) if len(driven) else None,
            "final_error": float(np.abs(error[-1]).max()) if len(driven) else None,
            "overshoot": float(max(beyond.max(), 0.0)) if moving.any() else None,
            "peak_torque": float(torque_shares(run, robot).max())
            if np.isfinite(limit).all()
            else None,
            "work": mechanical_work(run, name),
        }
        if name in walkers:
            walk = locomotion(run, name)
            own |= {measure: getattr(walk, measure) for measure in _WALKS}
            own["fall"] = float(not walk.upright)
        found |= {f"{robot.prefix}{measure}": value for measure, value in own.items()}
    return found


def measured(rows: Iterable[Mapping[str, Any]]) -> dict[str, list[tuple[float, int]]]:
    """Return for each measure of a table its finite values, each with the number of its run."""
    found: dict[str, list[tuple[float, int]]] = {}
    for row in rows:
        for name, value in row.items():
            if name.rpartition(".")[2] in UNITS and value is not None and np.isfinite(value):
                found.setdefault(name, []).append((value, row["number"]))
    return found


class Margin(Strict):
    """How hard a push of the station may become: what is asked for the measure ``margin``."""

    push: str
    """A push under ``forces``, whose force is one."""
    sizes: list[Positive] = Field(min_length=1, max_length=1000)
    """So many times as hard, the smallest first; the largest that is withstood is found by bisection."""

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if any(later <= one for one, later in zip(self.sizes, self.sizes[1:], strict=False)):
            raise ValueError(message("tuning.sizes_must_grow", "sizes must grow"))
        return self


@dataclass(frozen=True)
class Case(Trial):
    """A run to be made."""

    station: str  # a name or a file
    # what is changed in it, in its robot's gait or in the program; see :mod:`simrob_drake.extensions.tuning.scene`
    overrides: Mapping[str, Any]
    # what the table tells of the case, by column
    shown: Mapping[str, Any] = field(default_factory=dict)
    seed: int = 0  # the seed of its noise
    drawn: bool = False  # whether it is of that seed's robot and floor, too: of its posture, masses and friction
    allow_code: bool = False  # whether the station may name Python code
    margin: Margin | None = (
        None  # what is asked beside the run, if anything; the run itself is then without that push
    )

    def scene(self) -> Scene:
        """Return what is run; raises SimrobError: what cannot be."""
        scene = Scene.of(self.station, self.overrides, allow_code=self.allow_code)
        if not self.drawn:
            return scene
        changes = {**drawn(scene.config, self.seed), **self.overrides}
        return Scene.of(self.station, changes, allow_code=self.allow_code)

    @property
    def columns(self) -> list[Row]:
        """What the table tells of it, and its seed."""
        return [{**self.shown, "seed": self.seed}]

    def measured(self) -> list[Row]:
        """Return how it ended, and its :func:`~simrob_drake.extensions.tuning.rollout.measures`."""
        scene = self.scene()
        result = (scene if self.margin is None else scene.pushed(self.margin.push, 0.0)).run()
        row = {"ended": result.stopped_by or result.ending, "duration": result.config.duration}
        row |= {
            "stop_time": result.stop_time,
            **measures(result),
            "beyond": " ".join(result.verdict.beyond),
        }
        if self.margin is not None and result.ending == COMPLETED:
            push, sizes = self.margin.push, self.margin.sizes
            stood = bisect(
                sizes, False, key=lambda size: scene.pushed(push, size).run().ending != COMPLETED
            )
            row["margin"] = sizes[stood - 1] if stood else 0.0
        return [{**row, "message": result.message}]
