"""Many robots at once in MuJoCo: an environment of Gymnasium whose steps are of all of them, in C and in NumPy.

Each robot is stepped by itself. What the policy observes is what encoders and IMU tell that its station's policy reads,
at the same moments as in :mod:`simrob_drake.extensions.learning.environment`; rewards are of what is true.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from scipy.stats.qmc import LatinHypercube

from simrob_drake.base.arguments import positive, whole
from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.extension import needed_extension
from simrob_drake.base.extras import importing_extra
from simrob_drake.base.frames import Vector, xyz_quaternion_from_transform
from simrob_drake.base.messages import compound, message
from simrob_drake.blocks.monitor import NOT_YET
from simrob_drake.extensions.learning.episode import policies_of
from simrob_drake.extensions.learning.policy import TURNED, observed_of_turn
from simrob_drake.extensions.learning.rewards import Origin, RewardSample, rewards, turned_from
from simrob_drake.extensions.learning.sensing import Places, PolicySensors, spaces
from simrob_drake.extensions.learning.task import Curriculum, beginning, load_task
from simrob_drake.results.animation.pictures import Still
from simrob_drake.results.record.history import RUNAWAY
from simrob_drake.results.record.walks import headings
from simrob_drake.stations.closed import station_references
from simrob_drake.stations.config import StationConfig

with importing_extra("learning", "rl"):
    import gymnasium
    from gymnasium.vector import AutoresetMode
    from gymnasium.vector.utils import batch_space
with importing_extra(message("learning.many_robots", "an environment of many robots"), "mujoco"):
    import mujoco
    from mujoco.rollout import Rollout
with needed_extension("mujoco", message("learning.many_robots", "an environment of many robots")):
    from simrob_drake.extensions.mujoco.built import BuiltStation, controls, force_values
    from simrob_drake.extensions.mujoco.model import STEP

_HELD = ("contact", "floor", "gravity", "joint_stops", "pieces", "servo", "robot", "robots")
"""Sections of a station that a model of MuJoCo holds."""
_KNOWN = ("position", "velocity", *TURNED, "angular_velocity", "action", "clock", "goal")
_MOST = 100_000  # robots, or threads
_STEADY = 100.0  # the largest kd h / I of a servo: of 32 that stand, roid1 loses none at 97, one at 193, 14 at 386


class StationVectorEnvironment(gymnasium.vector.VectorEnv[Any, Any, Any]):
    """A task in its station, for k robots at once; a step is a control period of the policy.

    A robot whose episode has ended begins anew at once; ``info["final_obs"]`` holds what it observed at the end.
    """

    _ticks: Places
    _still: Still | None = None
    _action: Vector
    _means: Vector
    metadata: dict[str, Any] = {"autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012  # as Gymnasium declares it

    def __init__(
        self,
        num_envs: int = 1,
        task: str | Path = "walk",
        *,
        station: str | None = None,
        overrides: Mapping[str, Any] | None = None,
        step: float = STEP,
        threads: int = 0,
        variants: int = 16,
        grown: bool = False,
        render_mode: Literal["rgb_array"] | None = None,
    ) -> None:
        """Build the station.

        Args:
            num_envs: k, how many robots.
            task: a name of :func:`~simrob_drake.extensions.learning.task.task_names`, or a YAML file.
            station: in place of the task's, such as ``zjudancer_dynamic``.
            overrides: what is changed in it, as of :func:`~simrob_drake.load_station`.
            step: length of MuJoCo's steps [s]; at 5 ms light joints at their torque limits swing to and fro.
            threads: how many step beside this one.
            variants: how many stations are drawn where the task has random keys; each episode is in one of them.
            grown: begin with the last values of what grows in the task.
            render_mode: ``rgb_array`` lets :meth:`render` give pictures.

        Raises:
            SimrobError: a task or a station that cannot be, or that MuJoCo or this environment cannot tell.
        """
        num_envs, threads = (
            whole(num_envs, "num_envs", 1, _MOST),
            whole(threads, "threads", 0, _MOST),
        )
        self.task, path = load_task(task)
        self.config = self.task.config(station, overrides or {}, path)
        self.num_envs, self.render_mode = num_envs, render_mode
        self._curriculum = Curriculum(grown=grown)
        ((name, self.section),) = policies_of(self.config).items()
        self._built = _built(self.config, positive(step, "step", "s"))
        self._ports, self._plant = self._built.ports, self._built.ports.plant
        self.robot = self._ports.robot(self.section.robot)
        context = self._plant.plant.CreateDefaultContext()
        self._home = (
            self._plant.plant.GetPositions(context),
            self._plant.plant.GetVelocities(context),
        )
        self.period = 1 / self.section.rate
        self._steps = self._whole(
            self.period, message("learning.control_period", "a control period")
        )
        self._sensors = PolicySensors(num_envs, self.section, self.config, self.robot, self._value)
        for kind, rate in self._sensors.rates.items():
            self._whole(1 / rate, message("learning.sample_of", "a sample of {kind}", kind=kind))
        self._check(f"controllers.{name}")
        self._models = self._drawn_models(
            whole(variants, "variants", 1, _MOST),
            lambda drawn: self.task.config(station, {**(overrides or {}), **drawn}, path),
        )
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
        sizes = {
            "position": len(self._reach),
            "velocity": len(self._reach),
            "angular_velocity": 3,
            **TURNED,
        }
        sizes |= {
            "action": len(self._moved),
            "clock": 2 * len(self._clock),
            "goal": self._goals.shape[1],
        }
        self._bounds, self.single_action_space = spaces(self.section, self.robot, sizes)
        self.single_observation_space = self._bounds
        self.metadata = {**self.metadata, "render_fps": self.section.rate}
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Vector, dict[str, Any]]:
        """Begin all episodes; all that is random follows from the seeds: of a number, that of the first robot."""
        if not isinstance(seed, Sequence):
            seed = [None if seed is None else seed + place for place in range(self.num_envs)]
        self._draws = [np.random.default_rng(one) for one in seed]
        self._sensors.seed(None if seed[0] is None else [seed[0], self.num_envs])
        self._begin(np.arange(self.num_envs))
        return self._observation(), {}

    def step(self, actions: Vector) -> tuple[Vector, Vector, Vector, Vector, dict[str, Any]]:
        """Advance all robots one control period; ``info`` holds places, times and why monitors ended episodes."""
        last, self._action = self._action, np.clip(np.asarray(actions, dtype=float), -1.0, 1.0)
        before = self._state.copy()
        states, sensed = self._stepped()
        self._state[:], self._ticks = states[:, -1], self._ticks + 1
        self._motion = self._motion_of(self._state)
        whole = np.concatenate([before[:, np.newaxis], states], axis=1)
        self._sensors.sample(
            lambda some, after: self._motion_of(whole[some, round(after / self._built.step)]),
            (self._time - self.period, self.period),
        )
        ended = self._look(sensed[:, -1])
        now = self._now(last, sensed[:, -1], ended != "")
        now, self._means = now.averaged(self._means, self.period, self.task.averaged)
        parts = rewards(self._curriculum.of(self.task).rewards, now, self.period)
        total = np.sum([np.zeros(self.num_envs), *parts.values()], axis=0)
        self._returns += total
        terminated, late = ended != "", self._time > self.config.duration - self.period / 2
        truncated = late & ~terminated
        seen = self._observation()
        info = {"place": now.place, "time": self._time, "ended": ended, "rewards": parts}
        over = np.flatnonzero(terminated | truncated)
        self._curriculum.count(self.num_envs, self._returns[over].tolist())
        if len(over):
            info["final_obs"] = seen
            self._begin(over)
            seen = self._observation()
        return seen, total, terminated, truncated, info

    def render(self) -> tuple[npt.NDArray[np.uint8], ...] | None:
        """Return a picture of each robot now, shape (360, 480, 3), drawn without a display; None without a mode."""
        if self.render_mode is None:
            return None
        self._still = self._still or Still(self.config)
        return tuple(self._still.image(motion[: self._built.model.nq]) for motion in self._motion)

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
            raise InvalidParameter(
                "step",
                compound("{step:g} s", step=self._built.step),
                message(
                    "learning.part_of_period", "a part of {what}, {time:g} s", what=what, time=time
                ),
            )
        return count

    def _check(self, key: str) -> None:
        """Check that all is known here that is observed, that is rewarded, and that random is."""
        for name in self.section.observes:
            if name not in _KNOWN:
                raise InvalidParameter(
                    f"{key}.observes",
                    name,
                    message(
                        "learning.known_in_mujoco",
                        "of {known}: MuJoCo tells no more here",
                        known=", ".join(_KNOWN),
                    ),
                )
        if len(self.config.controllers) > 1:
            raise InvalidParameter(
                "controllers",
                ", ".join(self.config.controllers),
                message("learning.key_alone", "{key} alone", key=key),
            )
        if "yielding" in self.task.rewards:
            raise InvalidParameter(
                "rewards",
                "yielding",
                message("learning.other_term", "another term: speeds of tools are not told here"),
            )
        self._check_servos(self._built)

    def _check_servos(self, built: BuiltStation) -> None:
        """Check that steps are short enough for servos at their limits, which MuJoCo takes explicitly."""
        model, found = built.model, list[tuple[float, str, float]]()
        for robot in built.ports.plant.robots.values():
            for axis, kd in zip(
                robot.axes, (robot.gains.kd - robot.gains.damping).tolist(), strict=True
            ):
                joint = int(model.actuator(f"{robot.prefix}{axis}").trnid[0])
                found.append(
                    (
                        kd * float(model.dof_invweight0[model.jnt_dofadr[joint]]),
                        f"{robot.prefix}{axis}",
                        kd,
                    )
                )
        rate, axis, kd = max(found)
        if rate * self._built.step > _STEADY:
            longest = message(
                "learning.steady_steps",
                "at most {step:.2g} s, or servo.kd smaller, or one robot in Drake (gymnasium.make)",
                step=_STEADY / rate,
            )
            why = message(
                "learning.chatters_at_limit",
                "at its torque limit {axis} chatters with a kd of {kd:g}",
                axis=axis,
                kd=kd,
            )
            raise InvalidParameter(
                "step",
                compound("{step:g} s", step=self._built.step),
                compound("{longest}: {why}", longest=longest, why=why),
            )

    def _drawn_models(
        self, many: int, config_of: Callable[[dict[str, Any]], StationConfig]
    ) -> list[mujoco.MjModel]:
        """Return the models in which episodes are: the station's own, or those that are drawn, always the same.

        Raises:
            InvalidParameter: a random key that a model does not hold, or that makes other joints of it.
        """
        keys = list(self.task.random)
        for key in keys:
            if key.split(".")[0] not in _HELD:
                raise InvalidParameter(
                    "random",
                    key,
                    message(
                        "learning.shared_by_all",
                        "of {held}: all robots of a vector share the rest",
                        held=", ".join(_HELD),
                    ),
                )
        if not keys:
            return [self._built.model]
        parts = LatinHypercube(len(keys), rng=0).random(many)
        models = []
        for row in parts:
            built = _built(config_of(drawn := self.task.drawn(row)), self._built.step)
            plant = built.ports.plant.plant
            places = plant.GetPositions(plant.CreateDefaultContext())
            if not np.array_equal(places, self._home[0]) or built.columns != self._built.columns:
                raise InvalidParameter(
                    "random",
                    ", ".join(drawn),
                    message(
                        "learning.keys_that_leave_joints",
                        "keys that leave joints and where they begin as they are",
                    ),
                )
            self._check_servos(built)
            models.append(built.model)
        return models

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
        k = self.num_envs
        self._state = np.tile(self._built.state(*self._home), (k, 1))
        self._ticks, self._returns, self._means = (
            np.zeros(k, np.intp),
            np.zeros(k),
            np.zeros((k, 2)),
        )
        self._own = [self._built.model] * k
        self._ends = np.asarray(self._built.step * np.arange(1, len(self._rows) + 1), dtype=float)
        self._action = np.zeros((k, len(self._moved)))
        self._forces = np.tile(self._rows[:, self._servos :], (k, 1, 1))
        self._onsets = {name: np.full(k, NOT_YET) for name in self._ports.outputs.monitors}
        self._upright = self.robot.base.rotation().ToQuaternion().wxyz()
        first = self._value("base_pose", np.hstack(self._home)[np.newaxis])
        self._motion = self._motion_of(self._state)
        self._origin = Origin(first[0], float(headings(self._ports.plant, self.robot, first)[0]))

    def _begin(self, places: Places) -> None:
        """Begin the episodes of some robots anew."""
        task, robot, model = self._curriculum.of(self.task), self.robot, self._built.model
        for place in places:
            draw, (q, v) = self._draws[place], (each.copy() for each in self._home)
            begun = beginning(
                task, draw, robot=robot, forces=self.config.forces, period=self.period
            )
            q[robot.axis_map.position_places] = robot.axis_map.signs * begun.start
            if begun.goal is not None:
                self._goals[place] = begun.goal
            for name, push in begun.pushes.items():
                column = 3 * list(self.config.forces).index(name)
                self._forces[place, :, column : column + 3] = force_values(
                    push, self._ends - self._built.step, self._ends
                )
            if len(self._models) > 1:
                self._own[place] = self._models[draw.integers(len(self._models))]
            self._state[place, 1 : 1 + model.nq + model.nv] = self._built.coordinates.to_mujoco(
                np.append(q, v)
            )
        self._state[places, 0] = self._ticks[places] = 0
        self._action[places] = self._returns[places] = self._means[places] = 0.0
        for onsets in self._onsets.values():
            onsets[places] = NOT_YET
        self._sensors.begin(places, self._motion_of(self._state[places]))
        self._motion = self._motion_of(self._state)

    def _stepped(self) -> tuple[Vector, Vector]:
        """Return the states (k, steps, size) after each step of a control period, and what sensors tell before it."""
        steps = self._ticks[:, np.newaxis] * self._steps + np.arange(self._steps)
        asked = self._rows[steps]
        asked[:, :, self._columns] += (self._action * self._reach[self._moved])[:, np.newaxis]
        asked[:, :, self._servos :] = self._forces[np.arange(self.num_envs)[:, np.newaxis], steps]
        states, sensed = self._rollout.rollout(
            self._own if len(self._models) > 1 else self._models, self._data, self._state, asked
        )
        return np.asarray(states), np.asarray(sensed)

    def _motion_of(self, states: Vector) -> Vector:
        """Return positions and velocities (m, nq + nv) of the plant, of MuJoCo's states (m, size)."""
        model = self._built.model
        return self._built.coordinates.to_drake(states[:, 1 : 1 + model.nq + model.nv])

    def _value(self, output: str, motion: Vector) -> Vector:
        """Return an output of the robot, shape (m, size), by motions (m, nq + nv); a fixed root stays."""
        known = self._ports.outputs.of_state.get(f"{self.robot.prefix}{output}")
        if known is not None:
            return np.asarray(known.of(motion))
        fixed = (
            xyz_quaternion_from_transform(self.robot.base) if output == "base_pose" else np.zeros(6)
        )
        return np.tile(fixed, (len(motion), 1))

    def _observation(self) -> Vector:
        seen = np.hstack([self._part(name) for name in self.section.observes])
        return np.clip(seen, self._bounds.low, self._bounds.high).astype(np.float32)

    def _part(self, name: str) -> Vector:
        sensors, reads, part = self._sensors, self.section.reads, self._action
        if name in ("position", "velocity"):
            measured = {"position": sensors.position, "velocity": sensors.velocity}
            part = measured[name] if name in reads else self._value(name, self._motion)
            part = part - self.robot.initial if name == "position" else part
        elif name in TURNED:
            turned, time = (
                turned_from(self._upright, sensors.orientation),
                self._time[:, np.newaxis],
            )
            part = observed_of_turn(name, turned, self._goals, time)
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
        astray = ~(np.abs(self._motion) < RUNAWAY).all(axis=1)
        times = self._time.tolist()
        for name, trigger in self._ports.outputs.monitors.items():
            values, onsets = (
                [self._watched(output, sensed) for output in trigger.condition.watched],
                self._onsets[name],
            )
            for place, (time, onset, *row) in enumerate(
                zip(times, onsets.tolist(), *values, strict=True)
            ):
                onsets[place] = since = trigger.next_onset(onset, time, row)
                if since != NOT_YET and not ended[place] and trigger.ends_run(since, time):
                    ended[place] = trigger.condition.why(*row)
        ended[astray] = message(
            "learning.diverged_to_infinity", "diverged: a state ran away to infinity"
        )
        return ended

    def _watched(self, output: str, sensed: Vector) -> Vector:
        known = self._ports.outputs.of_state.get(output)
        return (
            self._built.output(output, sensed)
            if known is None
            else np.asarray(known.of(self._motion))
        )

    def _now(self, last: Vector, sensed: Vector, ended: npt.NDArray[np.bool_]) -> RewardSample:
        """Return what is true of all robots."""
        base, moving = (self._value(name, self._motion) for name in ("base_pose", "base_velocity"))
        arm = self.robot.tcp and not self.robot.floats
        return self._origin.sample(
            base,
            moving,
            effort=self._built.output(f"{self.robot.prefix}torque", sensed)
            / self.robot.gains.judged_limit,
            action=self._action,
            last_action=last,
            tool=self._built.output(f"{self.robot.prefix}tcp_pose", sensed)[:, :3]
            if arm
            else base[:, :3],
            goal=self._goals,
            time=self._time,
            **self._curriculum.of(self.task).targets,
            ended=ended,
        )


def _built(config: StationConfig, step: float) -> BuiltStation:
    """Return a station in MuJoCo, without what is computed here."""
    return BuiltStation.of(config.model_copy(update={"controllers": {}, "sensors": {}}), step=step)
