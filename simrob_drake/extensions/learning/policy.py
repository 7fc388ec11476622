r"""A loop whose law was learnt: a network says by what it observes how far each axis is to move.

At each sample the observation is a vector o of what the section names, and the action that the network gives for it,
within ±1, moves the axes from their reference,

.. math:: a_k = \mathrm{clip}(\pi(o_k), -1, 1), \qquad \Delta q_i = s_i \, a_{k,i} .
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator
from pydrake.math import RollPitchYaw, RotationMatrix
from pydrake.systems.framework import Context

from simrob_drake.base.errors import InvalidParameter, UnknownName, format_value
from simrob_drake.base.frames import Vector, rotation_of
from simrob_drake.base.messages import message
from simrob_drake.base.sections import Frequency, Number, Positive
from simrob_drake.blocks.sampled import BlockFails, Changes, Named, SampledBlock
from simrob_drake.extensions.learning.network import Network
from simrob_drake.parts.controllers.loop import LoopSection
from simrob_drake.parts.resolved import ResolvedRobot
from simrob_drake.parts.site import Site
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.robots.axis_map import PositiveAxisValues
from simrob_drake.stations.servos import passive_axis

TURNED = {
    "attitude": 3,
    "lean": 2,
    "heading_error": 1,
}  # what is observed of the orientation, and of what size it is
_TURN = 2  # the place in a goal of the rate at which the heading is to turn to the left [rad/s]
_READS = {"position": "position", "velocity": "velocity", **dict.fromkeys(TURNED, "orientation")}
"""Which input tells what is observed, where that is not called the same."""
_REMEMBERED = ("action", "clock", "goal")


class Policy(LoopSection):
    """A network that was learnt: it observes the robot, and moves its axes from their reference."""

    label: ClassVar[str] = message("learning.loop_policy", "policy")
    stages: ClassVar[tuple[str, ...]] = (
        message("learning.stage_observation", "Observation"),
        message("learning.stage_network", "Network"),
        message("learning.stage_scale", "Scale of each joint"),
    )

    kind: Literal["policy"]
    rate: Positive = 50.0
    """Samples a second [Hz]."""
    network: Path | None = None
    """The network, an ONNX file; relative paths start at the station's file. Without a network, as before training,
    the axes keep their references."""
    moves_deg: PositiveAxisValues
    """Displacement of an axis by an action of 1 [deg, or m if the axis slides]: a number for all axes, or one for each
    axis that the policy moves."""
    observes: list[str] = Field(min_length=1)
    """Inputs of the network, in this order. Of all axes: `position`, from the initial posture, and `velocity`. Of the
    IMU under `reads`: `attitude`, the angles Rx Ry Rz of the root link from the initial posture; `lean`, Rx and Ry
    alone; `heading_error`, Rz from the heading that the third number of `goal` [rad/s] commands; `angular_velocity`.
    Further: the last `action`; `clock`; `goal`; any output of the station, such as `external_force.hand`."""
    clock: list[Frequency] = Field(default_factory=list)
    """Frequencies whose sine and cosine over time the network reads [Hz]."""
    goal: list[Number] = Field(default_factory=list)
    """Numbers that describe the task, such as a target position."""

    @model_validator(mode="after")
    def _check_observed(self) -> "Policy":
        """Check that a clock and a goal are given where they are observed, and that a goal has a rate for a heading."""
        for name in ("clock", "goal"):
            if bool(getattr(self, name)) != (name in self.observes):
                raise ValueError(
                    message(
                        "learning.goes_with",
                        "{name} goes with '{name}' among what it observes",
                        name=name,
                    )
                )
        if "heading_error" in self.observes and len(self.goal) <= _TURN:
            raise ValueError(
                message(
                    "learning.heading_error_with_goal",
                    "heading_error goes with a goal of three figures or more, of which the third is a rate",
                )
            )
        return self

    @property
    def read_names(self) -> list[str]:
        """Names of the sensors and outputs that the loop reads, as the section writes them."""
        return [*super().read_names, *self._outputs]

    def axes(self, robot: ResolvedRobot) -> Sequence[str]:
        """Return the axes that it moves."""
        return [
            axis for axis, reach in zip(robot.axes, self.reach(robot), strict=True) if reach > 0
        ]

    def reach(self, robot: ResolvedRobot) -> Vector:
        """Compute how far an action of 1 moves each axis, shape (n,) [rad or m].

        It is 0 for axes that the policy leaves alone, and for passive axes, which no motor moves.

        Raises:
            Unsuitable: a mapping names a passive axis.
        """
        moves = dict(self.moves_deg) if isinstance(self.moves_deg, dict) else self.moves_deg
        passive = robot.gains.passive
        if isinstance(moves, dict):
            for axis in moves:
                if passive[robot.model.axis_index(axis, "moves_deg")]:
                    raise passive_axis(f"moves_deg.{axis}", axis)
        reach = robot.model.user_units * robot.model.axis_vector(moves, "moves_deg")
        return np.where(passive, 0.0, reach)

    def _block(self, key: str, robot: StationRobot, site: Site) -> "LearntPolicy":
        for output in self._outputs:
            if output not in site.outputs:
                raise UnknownName(
                    message("learning.observation_of", "what {key} observes", key=key),
                    output,
                    [*_READS, *_REMEMBERED, *site.outputs],
                )
        sizes = {name: site.outputs[name].size() for name in self._outputs}
        upright = robot.base.rotation()
        block = LearntPolicy(
            self, sizes=sizes, reach=self.reach(robot), home=robot.initial, upright=upright
        )
        if self.network is not None:
            network = Network(self.network, f"{key}.network")
            if (network.inputs, network.outputs) != (block.observed, block.acts):
                size = message(
                    "learning.network_of_sizes",
                    "a network that takes {inputs} figures and gives {outputs}",
                    inputs=network.inputs,
                    outputs=network.outputs,
                )
                fits = message(
                    "learning.network_that_fits",
                    "one that takes the {observed} that are observed and gives {acts}",
                    observed=block.observed,
                    acts=block.acts,
                )
                raise InvalidParameter(f"{key}.network", size, fits)
            block.law = network
        return block

    @property
    def _outputs(self) -> list[str]:
        return [
            name
            for name in self.observes
            if name not in (*_READS, "angular_velocity", *_REMEMBERED)
        ]


def observed_of_turn(name: str, turned: Vector, goal: Vector, time: Vector) -> Vector:
    """Return what is observed by this name of how robots are turned, Rx Ry Rz (..., 3) [rad], at times (..., 1) [s]."""
    if name != "heading_error":
        return turned[..., : TURNED[name]]
    ahead = turned[..., _TURN:] - goal[..., _TURN : _TURN + 1] * time
    return np.asarray((ahead + np.pi) % (2 * np.pi) - np.pi)


class LearntPolicy(SampledBlock):
    """Observe, and move axes by what a law says of that.

    Ports:
        in  what is observed: ``position``, ``velocity`` (n) [rad, rad/s]; ``orientation`` (4): of the root link, qw qx
            qy qz; ``angular_velocity`` (3) [rad/s]: of that, in its axes; others as they are called.
        out ``offset`` (n) [rad]: to be added to the reference; ``action`` (m): within ±1, of the axes that it moves;
            ``goal``: what is wanted, where something is.

    Attributes:
        law: gives an action (m,) for an observation; without one the action is as it was asked for.
        clock: frequencies of which sine and cosine are seen, shape (k,) [Hz].
        sizes: of all that it may observe, by name.
        observed, acts: the sizes of observation and action.
    """

    def __init__(
        self,
        section: Policy,
        *,
        sizes: Mapping[str, int] | None = None,
        reach: Vector,
        home: Vector,
        upright: RotationMatrix | None = None,
    ) -> None:
        """Make the block of a section; an action of 1 moves each axis by its ``reach``, shape (n,) [rad].

        Positions are seen from ``home`` (n,) [rad], the attitude from ``upright``; ``sizes`` are of other outputs, by
        name.
        """
        self.units = {"offset": "rad"}
        self.law: Callable[[Vector], Vector] | None = None
        moved = np.flatnonzero(reach)
        self.acts = len(moved)
        self._observes, self._home = section.observes, home
        self._matrix = np.eye(len(reach))[:, moved] * reach[moved]
        self._upright = (upright or RotationMatrix()).inverse()
        self.clock, goal = np.array(section.clock, dtype=float), np.array(section.goal)
        seen = {
            "position": len(reach),
            "velocity": len(reach),
            **TURNED,
            "angular_velocity": 3,
            **(sizes or {}),
        }
        self.sizes = {**seen, "action": self.acts, "clock": 2 * len(self.clock), "goal": len(goal)}
        self.observed = sum(self.sizes[name] for name in self._observes)
        reads = {
            _READS.get(name, name): 4 if name in TURNED else seen[name]
            for name in self._observes
            if name in seen
        }
        goals = {"goal": goal} if len(goal) else {}
        super().__init__(
            period=1 / section.rate,
            reads=reads,
            memory={
                "offset": np.zeros(len(reach)),
                "action": np.zeros(self.acts),
                **goals,
                "count": np.zeros(1),
            },
            gives=("offset", "action", *goals),
        )

    def observe(self, context: Context) -> Vector:
        """Return what would be observed in a context of the block, shape (observed,)."""
        return self._observation(*self.now(context))

    def ask(self, context: Context, **changes: Vector) -> None:
        """Set what the block remembers in its context: the ``action`` of its next sample, or the ``goal``."""
        for name, values in changes.items():
            self.set_output(context, name, values)

    def sample(self, memory: Named, read: Named) -> Changes:
        """Return how far the axes are to be moved now; raises BlockFails: the law gives no action."""
        action = (
            memory["action"]
            if self.law is None
            else self._action(self.law, self._observation(memory, read))
        )
        action = np.clip(action, -1.0, 1.0)
        return {"offset": self._matrix @ action, "action": action, "count": memory["count"] + 1}

    def _action(self, law: Callable[[Vector], Vector], observation: Vector) -> Vector:
        """Return the action (m,) of a law for an observation.

        Raises:
            BlockFails: the observation or the action is not finite, or the law fails.
        """
        if not np.isfinite(observation).all():
            first = int(np.flatnonzero(~np.isfinite(observation))[0])
            raise BlockFails(
                self.get_name(),
                message(
                    "learning.observes_no_number",
                    "observes {value} in place {index} of {count}",
                    value=observation[first],
                    index=first,
                    count=len(observation),
                ),
            )
        try:
            action = law(observation)
        except Exception as problem:  # ONNX Runtime has many classes of its own, without a base
            raise BlockFails(
                self.get_name(),
                message(
                    "learning.network_fails",
                    "has a network that fails: {problem}",
                    problem=format_value(str(problem)),
                ),
            ) from problem
        infinite = action[~np.isfinite(action)]
        if len(infinite):
            raise BlockFails(
                self.get_name(),
                message(
                    "learning.network_gives",
                    "has a network that gives {value} as an action",
                    value=infinite[0],
                ),
            )
        return action

    def _observation(self, memory: Named, read: Named) -> Vector:
        return np.concatenate([self._part(name, memory, read) for name in self._observes])

    def _part(self, name: str, memory: Named, read: Named) -> Vector:
        match name:
            case "position":
                return np.asarray(read["position"] - self._home)
            case "attitude" | "lean" | "heading_error":
                turned: Vector = RollPitchYaw(
                    self._upright @ rotation_of(read["orientation"])
                ).vector()
                goal = memory["goal"] if "goal" in self._observes else np.zeros(0)
                return observed_of_turn(name, turned, goal, memory["count"] * self.period)
            case "clock":
                angles = 2 * np.pi * self.clock * (memory["count"] * self.period)
                return np.concatenate([np.sin(angles), np.cos(angles)])
            case "action" | "goal":
                return memory[name]
        return read[name]
