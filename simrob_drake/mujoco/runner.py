"""Runs of a station in MuJoCo: built once, rolled out often, each with a result as Drake's runs have it.

Steps are made in C from the first to the last, of many runs on several threads; what they tell is read afterwards.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import mujoco
import numpy as np
from mujoco.rollout import Rollout

from simrob_drake.arguments import positive
from simrob_drake.blocks.references import Reference
from simrob_drake.errors import InvalidParameter, one_of
from simrob_drake.frames import Vector
from simrob_drake.mujoco.built import BuiltStation, controls
from simrob_drake.mujoco.reading import Stepped
from simrob_drake.results.record.state import State
from simrob_drake.results.result import SimulationResult
from simrob_drake.simulation.arguments import ReferencesLike, by_robot, with_duration, with_pushes
from simrob_drake.stations.closed import check_reference, station_references
from simrob_drake.stations.config import MOST_SAMPLES, StationConfig
from simrob_drake.stations.mujoco.model import STEP
from simrob_drake.stations.station import StationLike, config_of


@dataclass(frozen=True)
class RunRequest:
    """One run that is asked for; what is None is as the station says.

    Attributes:
        reference: as of :func:`simrob_drake.simulate`.
        pushes: in place of the station's, at the same places: ``{"shove": {"start": 1, "force": [5, 0, 0]}}``.
        start: where it begins, such as the ``final_state`` of another result, also of one in Drake.
    """

    reference: ReferencesLike = None
    pushes: Mapping[str, Any] | None = None
    start: State | None = None


Wanted = RunRequest
"""Its former name."""


@dataclass(frozen=True)
class Prepared:
    """A run that is ready to be stepped.

    Attributes:
        config: the station as it is run.
        references: what its robots are asked, by name.
        start: MuJoCo's state where it begins.
        controls: of each step, shape (count, nu).
    """

    config: StationConfig
    references: dict[str, Reference]
    start: Vector
    controls: Vector


class MujocoRunner:
    """A station in MuJoCo, built once and run often.

    Attributes:
        config: the station.
        built: its model, and what that tells.
    """

    def __init__(
        self, station: StationLike, *, step: float = STEP, integrator: str | None = None, seen: bool = False
    ) -> None:
        """Build a station.

        Args:
            station: as :func:`simrob_drake.simulate` takes it.
            step: length of a step [s].
            integrator: MuJoCo's name of it, as of :func:`~simrob_drake.stations.mujoco.model.mujoco_model`.
            seen: with the pictures of all bodies.

        Raises:
            SimrobError: no such station, or one that MJCF cannot say; the message names the part.
        """
        self.config = config_of(station)
        self.built = BuiltStation.of(self.config, step=positive(step, "step", "s"), integrator=integrator, seen=seen)

    def __repr__(self) -> str:
        """Say in one line what it runs."""
        return f"<MujocoRunner of {self.config!r}>"

    def run(
        self,
        *,
        reference: ReferencesLike = None,
        duration: float | None = None,
        pushes: Mapping[str, Any] | None = None,
        start: State | None = None,
        strict: bool = False,
    ) -> SimulationResult:
        """Run the station once, as :meth:`simrob_drake.simulation.runner.Runner.run` does in Drake."""
        return self.runs([RunRequest(reference, pushes, start)], duration=duration)[0].check(strict)

    def runs(
        self, requests: Sequence[RunRequest], *, duration: float | None = None, threads: int = 0
    ) -> list[SimulationResult]:
        """Run the station several times.

        Args:
            requests: the runs.
            duration: of each, in place of the station's [s].
            threads: how many are stepped at the same time beside this one; with 0 they are stepped here in turn.

        Raises:
            SimrobError: a reference, push or start that does not fit the station.
        """
        config = with_duration(self.config, duration)
        prepared = [self.prepared(config, one) for one in requests]
        began = perf_counter()
        starts, rows = np.array([run.start for run in prepared]), np.array([run.controls for run in prepared])
        data = [mujoco.MjData(self.built.model) for _ in range(max(threads, 1))]
        with Rollout(nthread=threads) as loop:
            states, sensed = loop.rollout(self.built.model, data, starts, rows)
        seconds = (perf_counter() - began) / len(requests)
        results = []
        for run, after, sensors, one in zip(prepared, states, sensed, requests, strict=True):
            before = np.vstack([run.start, after[:-1]])  # sensors tell of the state before a step
            stepped = Stepped(self.built, run.config, run.references, before, sensors, seconds, one.start)
            results.append(stepped.result())
        return results

    def prepared(self, config: StationConfig, request: RunRequest) -> Prepared:
        """Return what a run of the station needs, its configuration with another duration perhaps."""
        own, known = with_pushes(config, request.pushes), self.config.forces
        for name, force in own.forces.items():
            if force.at != known[one_of("force", name, known)].at:
                raise InvalidParameter(f"pushes: {name}.at", force.at, "as in the station: the places are built in")
        start = State.at_start_of(config) if request.start is None else request.start
        by_name, station = by_robot(own, request.reference), self.built.station
        references = station_references(station, by_name, start.references if start else None)
        for robot in station.robots.values():
            check_reference(robot, references[robot.name], own.duration)
        count = int(np.ceil(own.duration / self.built.step - 1e-9)) + 1
        if count > MOST_SAMPLES:
            expected = f"at least {own.duration / MOST_SAMPLES:.2g} s for a duration of {own.duration:g} s"
            raise InvalidParameter("step", f"{self.built.step:g} s", expected)
        rows = controls(
            self.built.ports.plant,
            references,
            {name: own.forces.get(name) for name in known},
            with_speeds="reference_velocity" in own.inputs,
            step=self.built.step,
            count=count,
        )
        return Prepared(own, references, self._start(start), rows)

    def _start(self, start: State | None) -> Vector:
        station = self.built.ports.plant
        if start is not None:
            start.check()
            return self.built.state(*start.of_plant(station))
        context = station.plant.CreateDefaultContext()
        return self.built.state(station.plant.GetPositions(context), station.plant.GetVelocities(context))
