"""A station with a policy's place that is stepped one control period at a time: built once, begun often."""

from collections.abc import Mapping, Sequence

import numpy as np
from pydrake.systems.framework import Context

from simrob_drake.base.arguments import drake_asserts
from simrob_drake.base.frames import Vector, transform_from_xyz_quaternion
from simrob_drake.base.messages import message
from simrob_drake.blocks.monitor import NOT_YET
from simrob_drake.extensions.learning.policy import LearntPolicy, Policy
from simrob_drake.extensions.learning.rewards import Origin, RewardSample
from simrob_drake.parts.controllers import readers_of
from simrob_drake.parts.controllers.loop import sensors_read
from simrob_drake.parts.forces import ForceConfig
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.results.record.walks import headings
from simrob_drake.simulation.stepping import Stepper
from simrob_drake.stations.closed import closed_station, station_references
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.resolve import resolve

_FEW = 1e-9  # by how much times that mean the same may differ [s]


def policies_of(config: StationConfig) -> dict[str, Policy]:
    """Return those controllers of a station that are policies, by name."""
    return {
        name: section for name, section in config.controllers.items() if isinstance(section, Policy)
    }


class Episode:
    """Steps a station, whose policy is asked from outside, from one sample of that policy to the next.

    A run of the same station with the same policy as a part of it is the same: both take their steps between the same
    times, and the policy sees the same.

    Attributes:
        section: of the station's file that the policy has.
        policy: the block that observes and acts.
        robot: that the policy moves.
        period: between its samples [s].
        seeds: those that the sections of the k sensors with noise give them.
        ended: why a monitor ended the episode, or that the simulation diverged; empty until then.
    """

    def __init__(self, config: StationConfig) -> None:
        """Build the station; raises SimrobError: one that cannot be."""
        station = resolve(config)
        self._station, self._forces = station, dict(config.forces)
        name, self.section = next(iter(policies_of(config).items()))
        sensors = sensors_read(readers_of(config.controllers), station.sensors)
        self._built = closed_station(station, sensors=sensors, monitors=False)
        self._ports = self._built.ports
        self.policy: LearntPolicy = self._built.diagram.GetSubsystemByName(f"controller.{name}")
        self.robot: StationRobot = self._ports.robot(self.section.robot)
        self.period = 1 / self.section.rate
        self._references = station_references(station)
        self._noisy = [
            block for block in self._built.diagram.GetSystems() if hasattr(block, "seed")
        ]
        self.seeds = [int(block.seed) for block in self._noisy]
        self.ended = ""

    @property
    def time(self) -> float:
        """Since the beginning [s]."""
        return float(self._root.get_time())

    @property
    def positions(self) -> Vector:
        """Of the plant, shape (nq,)."""
        return self._motion[: self._ports.plant.plant.num_positions()]

    @drake_asserts()
    def begin(
        self,
        *,
        seeds: Sequence[int] | None = None,
        start: Vector | None = None,
        goal: Vector | None = None,
        forces: Mapping[str, ForceConfig] | None = None,
    ) -> Vector:
        """Begin anew and return what the policy observes.

        ``seeds`` are of the k sensors that have noise, their own unless given; ``start`` is where the axes begin, shape
        (n,) [rad], in their initial posture unless given; ``goal`` that of the policy; ``forces`` take the place of
        some of the station's, by name.
        """
        forces = {**self._forces, **(forces or {})}
        self._built.play(self._references, forces)
        self._edges = sorted(
            {edge for force in forces.values() for edge in force.edges if edge > 0}
        )
        for block, seed in zip(self._noisy, self.seeds if seeds is None else seeds, strict=True):
            block.seed = seed
        config, built = self._station.config, self._built
        stepper = Stepper(config, lambda _: built, [], blocks={})
        self._simulator, pace = stepper.simulator, stepper.pace()
        self._root = self._simulator.get_mutable_context()
        if start is not None:
            self._ports.plant.set_positions(
                self._root, self.robot.axis_map.spread_positions(start, self.positions)
            )
        if goal is not None:
            self.policy.ask(self._own(), goal=goal)
        if pace is not None:
            pace(self._root)
            self._simulator.set_monitor(pace)
        self._simulator.Initialize()
        self._step, self.ended = 0, ""
        self._onsets = dict.fromkeys(self._ports.outputs.monitors, NOT_YET)
        base = self._value("base_pose")
        self._origin = Origin(
            base, float(headings(self._ports.plant, self.robot, base[np.newaxis])[0])
        )
        self._last = self._action = np.zeros(self.policy.acts)
        self._seen = self.policy.observe(self._own())
        return self._seen

    def advance(self, action: Vector | None) -> Vector:
        """Ask for an action (m,), or let the policy's network act, and return what is observed at the next sample."""
        if action is not None:
            self._last, self._action = self._action, np.clip(action, -1.0, 1.0)
            self.policy.ask(self._own(), action=self._action)
        self._step += 1
        end = self._step * self.period
        stops = [edge for edge in self._edges if self.time + _FEW < edge < end - _FEW]
        try:
            for stop in (*stops, end):
                self._simulator.AdvanceTo(stop)
            seen = self.policy.observe(self._own())
        except (RuntimeError, SystemExit) as problem:
            self.ended = message(
                "learning.diverged", "diverged: {problem}", problem=" ".join(str(problem).split())
            )
            return self._seen
        if not np.isfinite(seen).all():
            self.ended = message(
                "learning.diverged_to_infinity", "diverged: a state ran away to infinity"
            )
            return self._seen
        self._seen = seen
        self._look()
        return seen

    def moment(self, *, goal: Vector, **targets: float) -> RewardSample:
        """Return what is true now; ``targets`` stand in the sample as they are."""
        base = self._value("base_pose")
        moving = self._value("base_velocity") if self.robot.floats else np.zeros(6)
        limits = self.robot.gains.judged_limit  # perhaps none
        tool, tool_speed, push = self._tool(base, moving)
        return self._origin.sample(
            base,
            moving,
            effort=self._value("torque") / limits,
            action=self._action,
            last_action=self._last,
            tool=tool,
            tool_speed=tool_speed,
            goal=goal,
            time=self.time,
            push=push,
            **targets,
            ended=bool(self.ended),
        )

    def _tool(self, base: Vector, moving: Vector) -> tuple[Vector, Vector, Vector]:
        """Return place and speed of the tool, or of the root link, and the forces on it, in the world's axes."""
        frame = self.robot.tools.get(self.robot.tcp)
        if frame is None or self.robot.floats:
            place, speed, turn = (
                base[:3],
                moving[:3],
                transform_from_xyz_quaternion(base).rotation().matrix(),
            )
        else:
            context = self._ports.plant.plant.CreateDefaultContext()
            self._ports.plant.plant.SetPositionsAndVelocities(context, self._motion)
            pose = frame.CalcPoseInWorld(context)
            place, turn = pose.translation(), pose.rotation().matrix()
            speed = frame.CalcSpatialVelocityInWorld(context).translational()
        acting = [self._output(f"applied_force.{name}") for name in self._forces]
        return place, speed, turn @ np.sum([np.zeros(3), *acting], axis=0)

    def _look(self) -> None:
        """Ask the monitors, which look at the end of each control period."""
        for name, trigger in self._ports.outputs.monitors.items():
            values = [self._output(output) for output in trigger.condition.watched]
            onset = self._onsets[name] = trigger.next_onset(self._onsets[name], self.time, values)
            if trigger.ends_run(onset, self.time):
                self.ended = trigger.condition.why(*values)

    def _value(self, output: str) -> Vector:
        """Return an output of the robot, at once where the plant's state tells it."""
        name = f"{self.robot.prefix}{output}"
        known = self._ports.outputs.of_state.get(name)
        return (
            self._output(name)
            if known is None
            else np.asarray(known.of(self._motion[np.newaxis])[0])
        )

    def _output(self, name: str) -> Vector:
        port = self._ports.outputs[name]
        return np.array(port.Eval(port.get_system().GetMyContextFromRoot(self._root)))

    @property
    def _motion(self) -> Vector:
        """Positions and velocities of the plant, shape (nq + nv,)."""
        state = self._ports.state
        return np.array(state.Eval(state.get_system().GetMyContextFromRoot(self._root)))

    def _own(self) -> Context:
        return self.policy.GetMyMutableContextFromRoot(self._root)
