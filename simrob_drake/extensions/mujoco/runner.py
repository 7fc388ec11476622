"""Runs of a station in MuJoCo: built once, rolled out often, each with a result as Drake's runs have it.

Steps are made in C from the first to the last, of many runs on several threads; what they tell is read afterwards.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

import mujoco
import numpy as np
from mujoco.rollout import Rollout

from simrob_drake.base.arguments import positive
from simrob_drake.base.errors import InvalidParameter, one_of
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import compound, message
from simrob_drake.blocks.monitor import NOT_YET
from simrob_drake.blocks.references import Reference, reference_values
from simrob_drake.extensions.mujoco.built import BuiltStation, controls, force_values
from simrob_drake.extensions.mujoco.model import STEP
from simrob_drake.results.record.history import RUNAWAY
from simrob_drake.results.record.run import DIVERGED
from simrob_drake.results.record.state import JointState, State, joints_of
from simrob_drake.results.result import SimulationResult
from simrob_drake.simulation import simulate
from simrob_drake.simulation.run import (
    ReferencesLike,
    by_robot,
    sample_times,
    with_duration,
    with_pushes,
)
from simrob_drake.simulation.stepping import Outcome
from simrob_drake.stations.closed import check_reference, station_references
from simrob_drake.stations.config import MOST_SAMPLES, StationConfig
from simrob_drake.stations.station import StationLike, config_of

_ROUNDING = 1e-9  # s, and as a part
_STABLE = 2.0  # an explicit damper on a mass is stable while kd h / M stays below this
Onsets = dict[str, float]


@dataclass(frozen=True)
class Stopped:
    """How a monitor ends a run: who, when [s], why, and since when conditions had held one look before."""

    name: str
    time: float
    message: str
    onsets: Onsets


@dataclass(frozen=True)
class Stepped:
    """A run that was stepped."""

    built: BuiltStation  # the station
    config: StationConfig  # as it was run
    references: Mapping[str, Reference]  # what the robots were asked, by name
    states: Vector  # MuJoCo's states before each step, shape (m, size)
    sensed: Vector  # what the sensors told of them, shape (m, k)
    seconds: float  # of wall-clock time
    start: State | None  # where it began; None at the initial posture

    def result(self) -> SimulationResult:
        """Return the result: sampled, and cut where a monitor ends the run or where it ran away."""
        began, built = perf_counter(), self.built
        sane = np.asarray((np.abs(self.states) < RUNAWAY).all(axis=1))  # what is no number is not
        count = len(sane) if sane.all() else int(np.argmin(sane))
        steps = np.asarray(built.step * np.arange(count), dtype=float)
        times = sample_times(min(float(steps[-1]), self.config.duration), self.config.sample_rate)
        stop = self._stop(steps, times)
        if stop is not None:
            times = np.append(times[times < stop.time - _ROUNDING], stop.time)
        outputs = self._outputs(steps, times)
        outcome = self._outcome(stop, float(times[-1]), astray=count < len(sane))
        columns = [
            outputs[signal.output]
            if signal.entries is None
            else outputs[signal.output][:, signal.entries]
            for signal in built.signals
        ]
        final_state = self._state(steps, float(times[-1]))
        return SimulationResult(
            config=self.config,
            plant=built.ports.plant,
            ending=outcome.ending,
            stopped_by=outcome.stopped_by,
            message=outcome.message,
            names=[name for signal in built.signals for name in signal.names],
            signals=tuple(built.signals),
            notes={},
            times=times,
            values=np.hstack([np.zeros((len(times), 0)), *columns]),
            step_times=steps[steps <= times[-1] + _ROUNDING],
            positions_at=lambda at: self._motion(steps, at)[0],
            stepping_time=self.seconds,
            signal_time=perf_counter() - began,
            solver_warnings=self._warnings(self.sensed[:count]),
            final_state=final_state,
            start=self.start,
            context=lambda: final_state.context_of(built.diagram, built.ports),
        )

    def _outputs(self, steps: Vector, times: Vector) -> dict[str, Vector]:
        """Return the outputs that are known, by name, at times (m,)."""
        built = self.built
        sensed = _between(steps, self.sensed, times)
        outputs = {name: built.output(name, sensed) for name in built.outputs}
        for robot in built.ports.plant.robots.values():
            outputs[f"{robot.prefix}reference"] = reference_values(
                self.references[robot.name], times
            )
        for name in built.station.config.forces:
            outputs[f"applied_force.{name}"] = force_values(
                self.config.forces.get(name), times, times + built.step
            )
        return outputs

    def _motion(self, steps: Vector, times: Vector) -> tuple[Vector, Vector]:
        model = self.built.model
        states = _between(steps, self.states[:, 1 : 1 + model.nq + model.nv], times)
        motion = self.built.coordinates.to_drake(states)
        return motion[:, : model.nq], motion[:, model.nq :]

    def _stop(self, steps: Vector, times: Vector) -> Stopped | None:
        onsets = dict.fromkeys(self.built.ports.outputs.monitors, NOT_YET)
        found = self._looked(steps, times, dict(onsets), onsets)
        if found is None:
            return None
        between = steps[
            (steps > found.time - 1 / self.config.sample_rate) & (steps < found.time + _ROUNDING)
        ]
        return self._looked(steps, between, found.onsets, dict(found.onsets)) or found

    def _looked(
        self, steps: Vector, times: Vector, before: Onsets, onsets: Onsets
    ) -> Stopped | None:
        """Ask the monitors at times (m,), in their order; ``onsets`` changes, ``before`` is that of one time before."""
        monitors = self.built.ports.outputs.monitors
        if not monitors:
            return None
        outputs = self._outputs(steps, times)
        for row, time in enumerate(times.tolist()):
            before.update(onsets)
            for name, trigger in monitors.items():
                values = [outputs[output][row] for output in trigger.condition.watched]
                onsets[name] = trigger.next_onset(onsets[name], time, values)
                if trigger.ends_run(onsets[name], time):
                    return Stopped(
                        name,
                        time,
                        message(
                            "mujoco.reason_at_time",
                            "{why}, at {time:.4g} s",
                            why=trigger.condition.why(*values),
                            time=time,
                        ),
                        dict(before),
                    )
        return None

    def _outcome(self, stop: Stopped | None, end: float, *, astray: bool) -> Outcome:
        if stop is not None:
            return Outcome("monitor", stop.name, stop.message)
        if astray:
            text = message(
                "mujoco.diverged",
                "diverged at {end:.4g} s: a state ran away to infinity; shorter steps may help",
                end=end,
            )
            return Outcome("diverged", DIVERGED, text)
        return Outcome(
            "completed",
            None,
            message(
                "mujoco.ran_to_its_end",
                "ran to its end at {duration:g} s",
                duration=self.config.duration,
            ),
        )

    def _warnings(self, sensed: Vector) -> list[str]:
        """Tell of outputs that are not known, and of stiff servos at their limits, which MuJoCo treats explicitly."""
        built, found = self.built, []
        for robot in built.ports.plant.robots.values():
            torque = np.abs(built.output(f"{robot.prefix}torque", sensed)).max(axis=0)
            light = built.model.dof_invweight0[
                built.coordinates.velocities[robot.axis_map.velocity_places]
            ]
            at_limit = torque >= robot.gains.torque_limit * (1 - _ROUNDING)
            jumps = at_limit & (robot.gains.kd * light * built.step > _STABLE)
            found += [
                f"{robot.prefix}{axis}"
                for axis, jumped in zip(robot.axes, jumps, strict=True)
                if jumped
            ]
        reached = message(
            "mujoco.reached_torque_limit",
            "reached the limit of torque, where MuJoCo takes no account of the damping within a "
            "step; take shorter ones",
        )
        silent = message(
            "mujoco.left_out_in_rollouts",
            "are left out by quick roll-outs; a run with solver.kind mujoco has them",
        )
        left: list[str] = (
            [compound("{left_out} {silent}", left_out=", ".join(built.left_out), silent=silent)]
            if built.left_out
            else []
        )
        return (
            [compound("{found} {reached}", found=", ".join(found), reached=reached), *left]
            if found
            else left
        )

    def _state(self, steps: Vector, time: float) -> State:
        """Return where the station was at a time [s], for another run to begin there, in Drake too."""
        plant, robots = self.built.ports.plant.plant, self.built.ports.plant.robots
        q, v = (rows[0] for rows in self._motion(steps, np.array([time])))
        return State(
            positions={name: robot.axis_map.positions(q) for name, robot in robots.items()},
            velocities={name: robot.axis_map.velocities(v) for name, robot in robots.items()},
            references={
                name: reference_values(self.references[name], np.array([time]))[0]
                for name in robots
            },
            joints={
                joint.name: JointState(q[joint.positions], v[joint.velocities])
                for joint in joints_of(plant)
            },
        )


def _between(steps: Vector, rows: Vector, times: Vector) -> Vector:
    """Return rows (m, k) of steps (m,) at times (n,), on straight lines between two of them, shape (n, k)."""
    after = np.clip(np.searchsorted(steps, times - _ROUNDING), 1, max(len(steps) - 1, 1))
    if len(steps) == 1:
        return np.repeat(rows[:1], len(times), axis=0)
    part = np.clip((times - steps[after - 1]) / (steps[after] - steps[after - 1]), 0.0, 1.0)[
        :, np.newaxis
    ]
    return np.asarray(rows[after - 1] + part * (rows[after] - rows[after - 1]))


@dataclass(frozen=True)
class RunRequest:
    """One run that is asked for; what is None is as the station says."""

    reference: ReferencesLike = None  # as of :func:`simrob_drake.simulate`
    # in place of the station's, at the same places: ``{"shove": {"start": 1, "force": [5, 0, 0]}}``
    pushes: Mapping[str, Any] | None = None
    start: State | None = (
        None  # where it begins, such as the ``final_state`` of another result, also of one in Drake
    )


Wanted = RunRequest  # its former name


@dataclass(frozen=True)
class Prepared:
    """A run that is ready to be stepped."""

    config: StationConfig  # the station as it is run
    references: dict[str, Reference]  # what its robots are asked, by name
    start: Vector  # MuJoCo's state where it begins
    controls: Vector  # of each step, shape (count, nu)


class MujocoRunner:
    """A station in MuJoCo, built once and run often.

    Attributes:
        config: the station.
        built: its model, and what that tells.
    """

    def __init__(
        self,
        station: StationLike,
        *,
        step: float = STEP,
        integrator: str | None = None,
        seen: bool = False,
    ) -> None:
        """Build a station as :func:`simrob_drake.simulate` takes it, for steps [s] and an integrator of MuJoCo.

        ``seen`` adds the pictures of all bodies. Raises SimrobError: no such station, or a part that MJCF cannot say.
        """
        self.config = config_of(station)
        self.built = BuiltStation.of(
            self.config, step=positive(step, "step", "s"), integrator=integrator, seen=seen
        )

    def __repr__(self) -> str:
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
        """Run the station several times, for a duration in place of its own [s].

        So many ``threads`` step beside this one; with 0 they are stepped here in turn. Raises SimrobError: what does
        not fit.
        """
        config = with_duration(self.config, duration)
        prepared = [self.prepared(config, one) for one in requests]
        began = perf_counter()
        starts, rows = (
            np.array([run.start for run in prepared]),
            np.array([run.controls for run in prepared]),
        )
        data = [mujoco.MjData(self.built.model) for _ in range(max(threads, 1))]
        with Rollout(nthread=threads) as loop:
            states, sensed = loop.rollout(self.built.model, data, starts, rows)
        seconds = (perf_counter() - began) / len(requests)
        results = []
        for run, after, sensors, one in zip(prepared, states, sensed, requests, strict=True):
            before = np.vstack([run.start, after[:-1]])  # sensors tell of the state before a step
            stepped = Stepped(
                self.built, run.config, run.references, before, sensors, seconds, one.start
            )
            results.append(stepped.result())
        return results

    def prepared(self, config: StationConfig, request: RunRequest) -> Prepared:
        """Return what a run of the station needs, its configuration with another duration perhaps."""
        own, known = with_pushes(config, request.pushes), self.config.forces
        for name, force in own.forces.items():
            if force.at != known[one_of(message("mujoco.force", "force"), name, known)].at:
                raise InvalidParameter(
                    message("mujoco.place_of_push", "pushes: {name}.at", name=name),
                    force.at,
                    message("mujoco.as_in_station", "as in the station: the places are built in"),
                )
        start = State.at_start_of(config) if request.start is None else request.start
        by_name, station = by_robot(own, request.reference), self.built.station
        references = station_references(station, by_name, start.references if start else None)
        for robot in station.robots.values():
            check_reference(robot, references[robot.name], own.duration)
        count = int(np.ceil(own.duration / self.built.step - 1e-9)) + 1
        if count > MOST_SAMPLES:
            expected = message(
                "mujoco.shortest_step",
                "at least {shortest:.2g} s for a duration of {duration:g} s",
                shortest=own.duration / MOST_SAMPLES,
                duration=own.duration,
            )
            raise InvalidParameter("step", compound("{step:g} s", step=self.built.step), expected)
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
        return self.built.state(
            station.plant.GetPositions(context), station.plant.GetVelocities(context)
        )


def inverse_run(config: StationConfig) -> SimulationResult:
    """Return a kinematic station's run with MuJoCo's torques and poses, as far as known; raises SimrobError: no run."""
    run = simulate(config, progress=False)
    # others count damping over a step
    built = BuiltStation.of(config, integrator="RK4", moved_by_torque=False)
    built.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    references, plant = station_references(built.station), built.ports.plant.plant
    q, v, a = np.zeros((3, len(run.times), plant.num_velocities()))
    q[:] = plant.GetPositions(plant.CreateDefaultContext())
    for name, robot in built.ports.plant.robots.items():
        orders = (reference_values(references[name], run.times, order) for order in range(3))
        position, velocity, acceleration = orders
        q = robot.axis_map.spread_positions(position, q)
        v = robot.axis_map.spread_velocities(velocity, v)
        a = robot.axis_map.spread_velocities(acceleration, a)
    data, forces, sensed = (
        mujoco.MjData(built.model),
        np.empty_like(v),
        np.empty((len(q), built.model.nsensordata)),
    )
    for row in range(len(q)):
        built.coordinates.put(data, np.append(q[row], v[row]))
        data.qacc[:] = built.coordinates.to_mujoco(np.append(q[row], a[row]))[
            plant.num_positions() :
        ]
        mujoco.mj_inverse(built.model, data)
        mujoco.mj_sensorPos(built.model, data)
        forces[row], sensed[row] = data.qfrc_inverse[built.coordinates.velocities], data.sensordata
    outputs = {name: built.output(name, sensed) for name in built.outputs}
    for robot in built.ports.plant.robots.values():
        sliding = robot.model.friction * np.clip(
            robot.axis_map.velocities(v) / robot.model.drives.friction_speed, -1, 1
        )
        outputs[f"{robot.prefix}torque"] = robot.axis_map.efforts(forces) + sliding
    signals = [
        signal
        for signal in built.ports.outputs.signals
        if signal.compute is None and signal.output in outputs
    ]
    columns = [
        outputs[s.output] if s.entries is None else outputs[s.output][:, s.entries] for s in signals
    ]
    names = [name for signal in signals for name in signal.names]
    return replace(run, names=names, signals=tuple(signals), values=np.hstack(columns))
