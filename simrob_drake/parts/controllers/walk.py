"""A loop that walks: from commands, and what the robot does, to the reference of its legs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from simrob_drake.blocks.sampled import Changes, Named, SampledBlock
from simrob_drake.errors import InvalidParameter, one_of
from simrob_drake.frames import Vector
from simrob_drake.parts.controllers.limbs import axes_to
from simrob_drake.parts.controllers.loop import LoopSection
from simrob_drake.parts.site import ResolvedRobot, Site, StationRobot, Surroundings
from simrob_drake.quantities import NotNegative
from simrob_drake.walking.body import Body
from simrob_drake.walking.engine import Engine
from simrob_drake.walking.figures import WalkingFigures, load_walking
from simrob_drake.walking.steps import Command
from simrob_drake.walking.stride import NUMBERS, Stride, eased
from simrob_drake.yaml_files import Number, Strict

_SAME = 1e-3  # of a posture [rad]
_READY = 1.0  # time to take the first posture from 45 deg away [s]


class Commanded(Strict):
    """What the robot shall do from a time on."""

    time: NotNegative = 0.0
    """[s]."""
    ahead: Number = 0.0
    """[m/s]."""
    sideways: Number = 0.0
    """To the left [m/s]."""
    turn_deg: Number = 0.0
    """To the left [deg/s]."""


class Walk(LoopSection):
    """Walk by commands, which may change at any time, and answer what disturbs the robot."""

    kind: Literal["walk"]
    gait: dict[str, Any] = Field(default_factory=dict)
    """Figures in place of those of the robot's `walking.yaml`."""
    commands: tuple[Commanded, ...] = ()
    """What to do when, in the order of the times; before the first one it stands."""

    @model_validator(mode="after")
    def _in_order(self) -> Walk:
        times = [command.time for command in self.commands]
        if times != sorted(times):
            raise ValueError(f"the times of commands must rise, and are {times}")
        return self

    def figures(self, robot: ResolvedRobot) -> WalkingFigures:
        """Return the figures of the walk."""
        return load_walking(robot.model, self.gait)

    def axes(self, robot: ResolvedRobot) -> Sequence[str]:
        """Return all axes: legs walk, the others keep the posture of the walk."""
        return robot.axes

    def check(self, key: str, station: Surroundings) -> None:
        """Check that the robot stands on its own feet and has figures to walk by.

        Raises:
            SimrobError: it does not, or what every loop checks.
        """
        super().check(key, station)
        robot = station.robot(self.robot, key)
        if not robot.floats or robot.feet is None:
            raise InvalidParameter(key, f"walk of {robot.name}", "of a robot that stands on feet of its own")
        figures = self.figures(robot)
        feet = [foot for group in figures.groups for foot in group]
        for foot in feet:
            one_of(f"foot of {robot.name} for {key}.gait.groups", foot, robot.model.tools)
        told = [foot for foot in feet if foot in self.reads]
        if told and (told != feet or figures.feedback is None or figures.feedback.touch is None):
            expected = f"with a force sensor for each of {', '.join(feet)}, and gait.feedback.touch, or with none"
            raise InvalidParameter(f"{key}.reads", f"forces on {', '.join(told)}", expected)

    def block(self, key: str, robot: StationRobot, site: Site) -> SampledBlock:
        """Return the loop."""
        figures, feet = self.figures(robot), robot.feet
        assert feet is not None  # check() has asked
        names = [foot for group in figures.groups for foot in group]
        links = {robot.plant.GetFrameByName(link, robot.instance).body().index(): link for link in feet.links}
        frames = [robot.plant.GetFrameByName(links[robot.tools[foot].body().index()], robot.instance) for foot in names]
        body = Body(
            plant=robot.plant,
            instance=robot.instance,
            root=robot.root,
            axes=robot.axis_map,
            limits=robot.model.axis_limits,
            knees=[number for number, axis in enumerate(robot.axes) if axis.endswith("knee")],
            feet=frames,
            contact=feet,
            legs=[axes_to(robot, frame) for frame in frames],
            facing=math.radians(figures.facing_deg),
        )
        groups = [[names.index(foot) for foot in group] for group in figures.groups]
        rows = [(each.time, each.ahead, each.sideways, math.radians(each.turn_deg)) for each in self.commands]
        return WalkingLoop(
            engine=Engine(body, figures, groups, 1 / self.rate),
            period=1 / self.rate,
            feet=[foot for foot in names if foot in self.reads],
            posture=np.deg2rad(robot.model.axis_vector(figures.posture_deg, f"{key}.gait.posture_deg")),
            commands=np.array(rows).reshape(-1, 4),
        )


class WalkingLoop(SampledBlock):
    """Ask a robot's axes for the next posture of a walk.

    Ports:
        in  by the name of each foot whose force is read: that (3) [N];
            ``position`` (n) [rad], ``velocity`` (n) [rad/s]; ``base_pose`` (7): x y z [m] and a quaternion;
            ``base_velocity`` (6): linear and angular, in the world [m/s, rad/s].
        out ``target`` (n) [rad]; ``active`` (1): 1; ``offset_velocity`` (n) [rad/s]: how fast the target moves;
            ``capture`` (2): divergent component from the foot that stands, ahead and to the left [m];
            ``foot`` (1): 0 where the right one stands, 1 where the left one does.
    """

    units: ClassVar[Mapping[str, str]] = {"target": "rad", "offset_velocity": "rad/s", "capture": "m"}

    def __init__(
        self, *, engine: Engine, period: float, feet: Sequence[str], posture: Vector, commands: Vector
    ) -> None:
        """Make the block.

        Args:
            engine: that makes the walk.
            period: between samples [s].
            feet: names of those whose forces are read, all in the engine's order or none.
            posture: of the axes in no leg, and near which the legs are found, shape (n,) [rad].
            commands: times [s], speeds ahead and to the left [m/s], turns [rad/s], shape (m, 4).
        """
        self.engine, self.start, self._commands, self._feet = engine, posture, commands, feet
        zero = np.zeros(len(posture))
        super().__init__(
            period=period,
            reads={
                **{"position": len(posture), "velocity": len(posture), "base_pose": 7, "base_velocity": 6},
                **dict.fromkeys(feet, 3),
            },
            memory={
                "target": zero,
                "active": 0.0,
                "offset_velocity": zero,
                "capture": np.zeros(2),
                "foot": 1.0,
                "stride": np.zeros(NUMBERS),
                "posture": zero,
                "begun": zero,
                "count": 0.0,
                "ready": 0.0,
            },
            gives=("target", "active", "offset_velocity", "capture", "foot"),
        )

    def sample(self, memory: Named, read: Named) -> Changes:
        """Return the next posture."""
        count = memory["count"][0]
        if not count:
            return self._begun(read)
        if memory["ready"][0] < 1.0:
            return self._readied(memory)
        stride, posture = Stride.of(memory["stride"]), memory["posture"]
        engine = self.engine
        seen = engine.measured(stride, engine.body.seen(*(read[name] for name in _READ)), self._forces(stride, read))
        after, target = engine.sample(stride, posture, self._command(count * self.period), seen)
        return {
            "target": target,
            "offset_velocity": (target - posture) / self.period,
            "posture": target,
            "stride": after.numbers(),
            "foot": after.standing,
            "capture": np.array([seen.xi.real, seen.xi.imag]),
            "count": count + 1,
        }

    def _forces(self, stride: Stride, read: Named) -> list[float] | None:
        """Return the forces on the feet that come down, for reading them takes time; None where none are told."""
        if not self._feet:
            return None
        down = self.engine.coming_down(stride)
        return [math.hypot(*read[foot].tolist()) if place in down else 0.0 for place, foot in enumerate(self._feet)]

    def _begun(self, read: Named) -> Changes:
        """Return where the way into the first posture begins."""
        engine, begun = self.engine, Stride()
        seen = engine.measured(begun, engine.body.seen(*(read[name] for name in _READ)))
        stride, posture = engine.standing(self.start, seen.slope)
        far = np.abs(posture - read["position"]).max()
        return {
            "target": read["position"] if far > _SAME else posture,
            "active": 1.0,
            "begun": read["position"],
            "posture": posture,
            "stride": stride.numbers(),
            "ready": 0.0 if far > _SAME else 1.0,
            "count": 1.0,
        }

    def _readied(self, memory: Named) -> Changes:
        """Return the next point of that way: the longer, the slower."""
        begun, end = memory["begun"], memory["posture"]
        time = _READY * math.sqrt(np.abs(end - begun).max() / (math.pi / 4))
        ready = min(memory["ready"][0] + self.period / max(time, self.period), 1.0)
        target = begun + eased(ready) * (end - begun)
        return {
            "target": target,
            "offset_velocity": (target - memory["target"]) / self.period,
            "ready": ready,
            "count": memory["count"][0] + 1,
        }

    def _command(self, time: float) -> Command:
        row = int(np.searchsorted(self._commands[:, 0], time + 1e-9, side="right")) - 1
        if row < 0:
            return Command()
        _, ahead, left, turn = self._commands[row].tolist()
        return Command(complex(ahead, left), turn)


_READ = ("position", "velocity", "base_pose", "base_velocity")
