"""Many robots at once in MuJoCo: an environment of Gymnasium whose steps are of all of them, in C and in NumPy.

Each robot is stepped by itself. What the policy observes is what encoders and IMU tell that its station's policy reads,
at the same moments as in :mod:`simrob_drake.learning.environment`; rewards are of what is true.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from mujoco.rollout import Rollout

from simrob_drake.arguments import positive, whole
from simrob_drake.blocks.monitor import NOT_YET
from simrob_drake.errors import InvalidParameter
from simrob_drake.frames import Vector, xyz_quaternion_from_transform
from simrob_drake.learning.episode import policies_of
from simrob_drake.learning.rewards import RewardSample, rewards, turned_from
from simrob_drake.learning.sensing import Places, PolicySensors
from simrob_drake.learning.task import load_task
from simrob_drake.mujoco.built import BuiltStation
from simrob_drake.mujoco.controls import controls, force_values
from simrob_drake.parts.forces.push import Push
from simrob_drake.results.record.walks import headings
from simrob_drake.stations.closed import station_references
from simrob_drake.stations.mujoco.model import STEP

_KNOWN = ("position", "velocity", "attitude", "angular_velocity", "action", "clock", "goal")
_ASTRAY = 1e6  # of any coordinate
_MOST = 100_000  # robots, or threads
_STEADY = 100.0
"""The largest kd h / I of a servo: of 32 that stand, roid1 loses none at 97, one at 193, 14 at 386."""


class StationVectorEnvironment(gymnasium.vector.VectorEnv[Any, Any, Any]):
    """A task in its station, for k robots at once; a step is a control period of the policy.

    A robot whose episode has ended begins anew in the next step, whatever is asked of it then.
    """

    _ticks: Places
    _over: npt.NDArray[np.bool_]
    _action: Vector
    metadata: dict[str, Any] = {"autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012  # as Gymnasium declares it

    def __init__(
        self,
        num_envs: int = 1,
        task: str | Path = "walk",
        *,
        station: str | None = None,
        overrides: Mapping[str, Any] | None = None,
        step: float = STEP,
        threads: int = 0,
    ) -> None:
        """Build the station.

        Args:
            num_envs: k, how many robots.
            task: a name of :func:`~simrob_drake.learning.task.task_names`, or a YAML file.
            station: in place of the task's, such as ``zjudancer_dynamic``.
            overrides: what is changed in it, as of :func:`~simrob_drake.load_station`.
            step: length of MuJoCo's steps [s]; at 5 ms light joints at their torque limits swing to and fro.
            threads: how many step beside this one.

        Raises:
            SimrobError: a task or a station that cannot be, or that MuJoCo or this environment cannot tell.
        """
        num_envs, threads = whole(num_envs, "num_envs", 1, _MOST), whole(threads, "threads", 0, _MOST)
        self.task, path = load_task(task)
        self.config = self.task.config(station, overrides or {}, path)
        self.num_envs = num_envs
        ((name, self.section),) = policies_of(self.config).items()
        moved = self.config.model_copy(update={"controllers": {}, "sensors": {}})
        self._built = BuiltStation.of(moved, step=positive(step, "step", "s"))
        self._ports, self._plant = self._built.ports, self._built.ports.plant
        self.robot = self._ports.robot(self.section.robot)
        self.period = 1 / self.section.rate
        self._steps = self._whole(self.period, "a control period")
        self._sensors = PolicySensors(num_envs, self.section, self.config, self.robot, self._value)
        for kind, rate in self._sensors.rates.items():
            self._whole(1 / rate, f"a sample of {kind}")
        self._check(f"controllers.{name}")
        self._reach = self.section.reach(self.robot)
        self._moved = np.flatnonzero(self._reach)
        self._rows = self._reference_rows()
        counts = [len(robot.axes) for robot in self._plant.robots.values()]
        own = list(self._plant.robots).index(self.robot.name)
        self._servos, self._columns = sum(counts), sum(counts[:own]) + self._moved
        self._clock = np.array(self.section.clock)
        self._goals = np.tile(np.array(self.section.goal), (num_envs, 1))
        self._rollout = Rollout(nthread=threads)
        self._data = [mujoco.MjData(self._built.model) for _ in range(max(threads, 1))]
        self._draws = [np.random.default_rng() for _ in range(num_envs)]
        self._make_room()
        sizes = {"position": len(self._reach), "velocity": len(self._reach), "attitude": 3, "angular_velocity": 3}
        sizes |= {"action": len(self._moved), "clock": 2 * len(self._clock), "goal": self._goals.shape[1]}
        observed = sum(sizes[name] for name in self.section.observes)
        self.single_observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (observed,), np.float32)
        self.single_action_space = gymnasium.spaces.Box(-1.0, 1.0, (len(self._moved),), np.float32)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Vector, dict[str, Any]]:
        """Begin all episodes; all that is random follows from the seeds: of a number, that of the first robot."""
        if not isinstance(seed, Sequence):
            seed = [None if seed is None else seed + place for place in range(self.num_envs)]
        self._draws = [np.random.default_rng(one) for one in seed]
        self._sensors.seed(None if seed[0] is None else [seed[0], self.num_envs])
        self._over[:] = False
        self._begin(np.arange(self.num_envs))
        return self._observation(), {}

    def step(self, actions: Vector) -> tuple[Vector, Vector, Vector, Vector, dict[str, Any]]:
        """Advance all robots one control period; ``info`` holds places, times and why monitors ended episodes."""
        again = np.flatnonzero(self._over)
        self._begin(again)
        last, self._action = self._action, np.clip(np.asarray(actions, dtype=float), -1.0, 1.0)
        self._action[again] = 0.0
        before = self._state.copy()
        states, sensed = self._stepped()
        self._state[:], self._ticks = states[:, -1], self._ticks + 1
        self._state[again], self._ticks[again] = before[again], 0
        self._motion = self._motion_of(self._state)
        whole = np.concatenate([before[:, np.newaxis], states], axis=1)
        self._sensors.sample(
            np.flatnonzero(~self._over),
            lambda some, after: self._motion_of(whole[some, round(after / self._built.step)]),
            (self._time - self.period, self.period),
        )
        ended = self._look(sensed[:, -1])
        ended[again] = ""
        now = self._now(last, sensed[:, -1], ended != "")
        parts = rewards(self.task.rewards, now, self.period)
        total = np.sum([np.zeros(self.num_envs), *parts.values()], axis=0)
        total[again] = 0.0
        terminated, late = ended != "", self._time > self.config.duration - self.period / 2
        truncated = late & ~terminated
        self._over = terminated | truncated
        info = {"place": now.place, "time": self._time, "ended": ended, "rewards": parts}
        return self._observation(), total, terminated, truncated, info

    def close_extras(self, **_: Any) -> None:
        """Let the threads end."""
        self._rollout.close()

    @property
    def _time(self) -> Vector:
        return np.asarray(self._ticks * self.period)

    def _whole(self, time: float, what: str) -> int:
        """Return how many steps a time [s] has."""
        count = round(time / self._built.step)
        if count < 1 or abs(count * self._built.step - time) > 1e-9:
            raise InvalidParameter("step", f"{self._built.step:g} s", f"a part of {what}, {time:g} s")
        return count

    def _check(self, key: str) -> None:
        """Check that all is known here that is observed, that is rewarded, and that random is."""
        for name in self.section.observes:
            if name not in _KNOWN:
                raise InvalidParameter(f"{key}.observes", name, f"of {', '.join(_KNOWN)}: MuJoCo tells no more here")
        if len(self.config.controllers) > 1:
            raise InvalidParameter("controllers", ", ".join(self.config.controllers), f"{key} alone")
        if "yielding" in self.task.rewards:
            raise InvalidParameter("rewards", "yielding", "another term: speeds of tools are not told here")
        self._check_servos()

    def _check_servos(self) -> None:
        """Check that steps are short enough for servos at their limits, which MuJoCo takes explicitly."""
        model, found = self._built.model, list[tuple[float, str, float]]()
        for robot in self._plant.robots.values():
            for axis, kd in zip(robot.axes, robot.gains.kd.tolist(), strict=True):
                joint = int(model.actuator(f"{robot.prefix}{axis}").trnid[0])
                found.append((kd * float(model.dof_invweight0[model.jnt_dofadr[joint]]), f"{robot.prefix}{axis}", kd))
        rate, axis, kd = max(found)
        if rate * self._built.step > _STEADY:
            longest = f"at most {_STEADY / rate:.2g} s, or servo.kd smaller, or one robot in Drake (gymnasium.make)"
            why = f"at its torque limit {axis} chatters with a kd of {kd:g}"
            raise InvalidParameter("step", f"{self._built.step:g} s", f"{longest}: {why}")

    def _reference_rows(self) -> Vector:
        """Return what is asked of all actuators at each step without the policy, shape (count, nu)."""
        count = self._steps * (round(self.config.duration / self.period) + 1)
        return controls(
            self._plant,
            station_references(self._built.station),
            dict(self.config.forces),
            with_speeds="reference_velocity" in self.config.inputs,
            step=self._built.step,
            count=count,
        )

    def _make_room(self) -> None:
        """Make room for all that changes, and keep what each episode begins with."""
        plant, k = self._plant.plant, self.num_envs
        context = plant.CreateDefaultContext()
        self._home = plant.GetPositions(context), plant.GetVelocities(context)
        self._state = np.tile(self._built.state(*self._home), (k, 1))
        self._ticks, self._over = np.zeros(k, np.intp), np.zeros(k, np.bool_)
        self._action = np.zeros((k, len(self._moved)))
        self._forces = np.tile(self._rows[:, self._servos :], (k, 1, 1))
        self._onsets = {name: np.full(k, NOT_YET) for name in self._ports.monitors}
        self._upright = self.robot.base.rotation().ToQuaternion().wxyz()
        self._first = self._value("base_pose", np.hstack(self._home)[np.newaxis])[0]
        self._motion = self._motion_of(self._state)
        facing = float(headings(self._ports.plant, self.robot, self._first[np.newaxis])[0])
        self._ahead = np.array([[np.cos(facing), np.sin(facing), 0], [-np.sin(facing), np.cos(facing), 0], [0, 0, 1]])

    def _begin(self, places: Places) -> None:
        """Begin the episodes of some robots anew."""
        task, robot = self.task, self.robot
        for place in places:
            draw, (q, v) = self._draws[place], (each.copy() for each in self._home)
            if task.noise_deg > 0:
                away = task.noise_deg * robot.model.user_units * draw.standard_normal(len(robot.axes))
                lower, upper = robot.model.axis_limits
                q[robot.axis_map.position_places] = robot.axis_map.signs * np.clip(robot.initial + away, lower, upper)
            if task.goals is not None:
                self._goals[place] = draw.uniform(task.goals.low, task.goals.high)
            self._push(place, draw)
            self._state[place] = self._built.state(q, v)
        self._ticks[places], self._action[places] = 0, 0.0
        for onsets in self._onsets.values():
            onsets[places] = NOT_YET
        self._sensors.begin(places, self._motion_of(self._state[places]))
        self._motion = self._motion_of(self._state)

    def _push(self, place: int, draw: np.random.Generator) -> None:
        """Give a robot the push of its episode."""
        pushes = self.task.pushes
        if pushes is None:
            return
        section = self.config.forces[pushes.name]
        assert isinstance(section, Push)  # the task has looked
        direction = draw.standard_normal(3) * [1, 1, 0 if pushes.level else 1]
        force = draw.uniform(*pushes.force) * direction / np.linalg.norm(direction)
        start = self.period * round(draw.uniform(*pushes.start) / self.period)
        push = section.model_copy(update={"start": start, "force": tuple(force.tolist())})
        ends = np.asarray(self._built.step * np.arange(1, len(self._rows) + 1), dtype=float)
        column = 3 * list(self.config.forces).index(pushes.name)
        self._forces[place, :, column : column + 3] = force_values(push, ends - self._built.step, ends)

    def _stepped(self) -> tuple[Vector, Vector]:
        """Return the states (k, steps, size) after each step of a control period, and what sensors tell before it."""
        steps = self._ticks[:, np.newaxis] * self._steps + np.arange(self._steps)
        asked = self._rows[steps]
        asked[:, :, self._columns] += (self._action * self._reach[self._moved])[:, np.newaxis]
        asked[:, :, self._servos :] = self._forces[np.arange(self.num_envs)[:, np.newaxis], steps]
        states, sensed = self._rollout.rollout(self._built.model, self._data, self._state, asked)
        return np.asarray(states), np.asarray(sensed)

    def _motion_of(self, states: Vector) -> Vector:
        """Return positions and velocities (m, nq + nv) of the plant, of MuJoCo's states (m, size)."""
        nq, nv = self._built.model.nq, self._built.model.nv
        return np.hstack(self._built.coordinates.to_drake(states[:, 1 : 1 + nq], states[:, 1 + nq : 1 + nq + nv]))

    def _value(self, output: str, motion: Vector) -> Vector:
        """Return an output of the robot, shape (m, size), by motions (m, nq + nv); a fixed root stays."""
        known = self._ports.of_state.get(f"{self.robot.prefix}{output}")
        if known is not None:
            return np.asarray(known.of(motion))
        fixed = xyz_quaternion_from_transform(self.robot.base) if output == "base_pose" else np.zeros(6)
        return np.tile(fixed, (len(motion), 1))

    def _observation(self) -> Vector:
        return np.hstack([self._part(name) for name in self.section.observes]).astype(np.float32)

    def _part(self, name: str) -> Vector:
        sensors, reads, part = self._sensors, self.section.reads, self._action
        if name in ("position", "velocity"):
            measured = {"position": sensors.position, "velocity": sensors.velocity}
            part = measured[name] if name in reads else self._value(name, self._motion)
            part = part - self.robot.initial if name == "position" else part
        elif name == "attitude":
            part = turned_from(self._upright, sensors.orientation)
        elif name == "angular_velocity":
            part = sensors.angular_velocity
        elif name == "clock":
            angles = 2 * np.pi * self._time[:, np.newaxis] * self._clock
            part = np.hstack([np.sin(angles), np.cos(angles)])
        elif name == "goal":
            part = self._goals
        return part

    def _look(self, sensed: Vector) -> npt.NDArray[np.object_]:
        """Return why the monitors end each episode, shape (k,), empty where they do not."""
        ended = np.full(self.num_envs, "", dtype=object)
        astray = ~(np.abs(self._motion) < _ASTRAY).all(axis=1)
        for name, trigger in self._ports.monitors.items():
            values = [self._watched(output, sensed) for output in trigger.condition.watched]
            for place, row in enumerate(zip(*values, strict=True)):
                time, onsets = float(self._time[place]), self._onsets[name]
                onsets[place] = trigger.since(onsets[place], time, row)
                if not ended[place] and trigger.ends(onsets[place], time):
                    ended[place] = trigger.condition.why(*row)
        ended[astray] = "diverged: a state ran away to infinity"
        return ended

    def _watched(self, output: str, sensed: Vector) -> Vector:
        known = self._ports.of_state.get(output)
        return self._built.output(output, sensed) if known is None else np.asarray(known.of(self._motion))

    def _now(self, last: Vector, sensed: Vector, ended: npt.NDArray[np.bool_]) -> RewardSample:
        """Return what is true of all robots."""
        base, moving = (self._value(name, self._motion) for name in ("base_pose", "base_velocity"))
        arm = self.robot.tcp and not self.robot.floats
        return RewardSample(
            place=(base[:, :3] - self._first[:3]) @ self._ahead.T,
            speed=moving[:, :3] @ self._ahead.T,
            turned=turned_from(self._first[3:], base[:, 3:]),
            spin=moving[:, 3:],
            effort=self._built.output(f"{self.robot.prefix}torque", sensed) / self.robot.gains.torque_limit,
            action=self._action,
            last_action=last,
            tool=self._built.output(f"{self.robot.prefix}tcp_pose", sensed)[:, :3] if arm else base[:, :3],
            goal=self._goals,
            desired_speed=np.inf if self.task.speed is None else self.task.speed,
            ended=ended,
        )
