"""A loop that walks: from commands, and what the robot does, to the reference of its legs."""

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator
from pydrake.systems.framework import Context

from simrob_drake.base.errors import InvalidParameter, one_of
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import compound, message
from simrob_drake.base.sections import Boolean
from simrob_drake.blocks.sampled import TIME, Changes, Named, RunEnds, SampledBlock
from simrob_drake.parts.controllers.loop import LoopSection
from simrob_drake.parts.controllers.section import CommandPart, TimedCommand
from simrob_drake.parts.controllers.support import axes_to
from simrob_drake.parts.resolved import ResolvedRobot, Surroundings
from simrob_drake.parts.site import Site
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.robots.gaits_file import gaits_file
from simrob_drake.walking.body import Body
from simrob_drake.walking.commands import (
    Commanded,
    Commander,
    Follower,
    Waypoints,
    clip_command,
    command_of,
    find_excess,
)
from simrob_drake.walking.engine import WalkingEngine
from simrob_drake.walking.height_map import HeightMap
from simrob_drake.walking.parameters import WalkingParameters, load_walking
from simrob_drake.walking.steps import Command
from simrob_drake.walking.stride import NUMBERS, Stride, smoothstep

_SAME = 1e-3  # of a posture [rad]
_NEAR = 0.5  # from where the robot stands to where its path starts, at most [m]
_EDGE = 0.02  # to be left around a sole that is set down on a known ground [m]
_READY = 1.0  # time to take the first posture from 45 deg away [s]


class Walk(LoopSection):
    """Walk by commands, which may change at any time, and answer what disturbs the robot."""

    label: ClassVar[str] = message("parts.loop_walk", "walk")
    stages: ClassVar[tuple[str, ...]] = (
        message("parts.stage_estimator", "Estimator\ncapture point"),
        message("parts.stage_planner", "Planner\nnext steps"),
        message("parts.stage_legs", "Legs\ninverse kinematics"),
    )
    command_parts: ClassVar[tuple[CommandPart, ...]] = (
        CommandPart("ahead", "m/s", "ahead ↑ ↓ [m/s]", keys=("ArrowDown", "ArrowUp")),
        CommandPart("left", "m/s", "left Q E [m/s]", keys=("KeyE", "KeyQ")),
        CommandPart("turn", "rad/s", "turn ← → [°/s]", keys=("ArrowRight", "ArrowLeft"), slider_unit=math.radians(1)),
    )
    command_key: ClassVar[str] = "commands"
    remarks: ClassVar[Mapping[str, str]] = {
        "clipped": message(
            "parts.asked_for_too_much", "is asked for more than its legs can follow, and does what they can"
        ),
        "blind": message("parts.reads_no_number", "reads what is not a number, and goes on as planned"),
    }
    camera_follows: ClassVar[bool] = True

    kind: Literal["walk"]
    gait: dict[str, Any] = Field(default_factory=dict)
    """Parameters in place of those under `reacting` in the robot's `gaits.yaml`."""
    commands: tuple[Commanded, ...] = ()
    """What to do when, in the order of the times; before the first one it follows its path, or stands. An input
    `command` (3) that `reads` names comes before them, where it is a number: ahead, to the left [m/s], turn [rad/s].
    While `waits` (1) is not 0, if `reads` names it, such as `get_up.active`, it rests; then it begins anew."""
    path: Waypoints | None = None
    """Where to go, by the pose of the root that it reads."""
    height_map: Boolean = False
    """Know how high the ground of the station is, seen from above, around where the pose that is read has the robot:
    feet lift to it, and land where it is even, within 60 mm of where they would."""
    strict: Boolean = False
    """Refuse commands that the legs cannot follow, as `max_speed` of the gait says; they are clipped otherwise."""

    @model_validator(mode="after")
    def _in_order(self) -> "Walk":
        times = [command.time for command in self.commands]
        if times != sorted(times):
            raise ValueError(
                message("parts.times_of_commands", "the times of commands must rise, and are {times}", times=times)
            )
        return self

    def walking(self, robot: ResolvedRobot) -> WalkingParameters:
        """Return the parameters of the walk."""
        return load_walking(robot.model, self.gait)

    def check(self, key: str, station: Surroundings) -> None:
        """Check that the robot stands on feet of its own and can walk.

        Raises SimrobError: it does not, it cannot, or what every loop checks.
        """
        super().check(key, station)
        robot = self.on_feet(key, station)
        parameters = self.walking(robot)
        feet = [foot for group in parameters.groups for foot in group]
        for foot in feet:
            one_of(
                message("parts.foot_for_groups", "foot of {robot} for {key}.gait.groups", robot=robot.name, key=key),
                foot,
                robot.model.tools,
            )
        read = [foot for foot in feet if foot in self.reads]
        if read and (read != feet or parameters.feedback is None or parameters.feedback.touch_force is None):
            expected = message(
                "parts.force_sensors_of_feet",
                "with a force sensor for each of {feet}, and gait.feedback.touch_force, or with none",
                feet=", ".join(feet),
            )
            raise InvalidParameter(
                f"{key}.reads", message("parts.forces_on", "forces on {read}", read=", ".join(read)), expected
            )
        if self.height_map and parameters.feedback is None:
            raise InvalidParameter(
                f"{key}.height_map",
                True,
                message("parts.false_without_feedback", "false without gait.feedback, which tells where feet are"),
            )
        self.warnings(key, robot)
        if self.path is not None:
            begins, stands = complex(*self.path.points[0]), complex(*robot.base.translation()[:2])
            if abs(begins - stands) > _NEAR:
                where = message("parts.at_place", "at ({x:g}, {y:g}) m", x=begins.real, y=begins.imag)
                near = message(
                    "parts.near_robot",
                    "within {near:g} m of where {robot} stands, ({x:g}, {y:g}) m",
                    near=_NEAR,
                    robot=robot.name,
                    x=stands.real,
                    y=stands.imag,
                )
                raise InvalidParameter(
                    f"{key}.path.points",
                    message("parts.path_from", "a path that starts {where}", where=where),
                    message("parts.path_near", "one that starts {near}", near=near),
                )

    def warnings(self, key: str, robot: ResolvedRobot) -> list[str]:
        """Return, in words, which known commands are clipped; raises InvalidParameter: one, in a strict section."""
        max_speed = self.walking(robot).max_speed
        commands = {f"commands[{n}]": row.command for n, row in enumerate(self.commands)}
        if self.path is not None:
            commands["path"] = Command(complex(self.path.speed))
        found = list[str]()
        for place, command in commands.items():
            for part, value, limit, unit in find_excess(command, max_speed):
                name = f"{key}.{place}.{'speed' if place == 'path' else part}"
                if self.strict:
                    expected = message(
                        "parts.speed_of_legs",
                        "at most {limit:g} {unit}, which the legs of {robot} can follow",
                        limit=abs(limit),
                        unit=unit,
                        robot=robot.name,
                    )
                    raise InvalidParameter(name, compound("{value:g} {unit}", value=value, unit=unit), expected)
                found.append(
                    message(
                        "parts.command_clipped",
                        "{name}, {value:g} {unit}, is clipped to {limit:g} {unit}",
                        name=name,
                        value=value,
                        unit=unit,
                        limit=limit,
                    )
                )
        return found

    def command_limits(self, robot: ResolvedRobot) -> list[tuple[float, float]]:
        """Lower and upper limits of the speeds ahead and to the left [m/s] and of the turn [deg/s].

        They are the largest ones that the legs of the robot can follow.
        """
        limits = self.walking(robot).max_speed
        return [
            (-limits.backward, limits.ahead),
            (-limits.sideways, limits.sideways),
            (-limits.turn_deg, limits.turn_deg),
        ]

    def command_at(self, time: float) -> tuple[float, ...]:
        """The command of the section at a time [s]: speeds ahead and to the left [m/s], and turn [rad/s].

        They are zero before the first command.
        """
        begun = [entry for entry in self.commands if entry.time <= time]
        return _command_values(begun[-1] if begun else Commanded())

    def rounded_command(self, command: TimedCommand) -> TimedCommand:
        """Round the turn of a command to what the section's file can hold in degrees."""
        return command._replace(values=_command_values(_entry_of_command(command)))

    def with_commands(self, commands: Sequence[TimedCommand]) -> "Walk":
        """Copy the section with these commands.

        Its own commands before the first of them are kept, later ones are dropped.

        Args:
            commands: commands in the order of their times, at least one.
        """
        before = [entry for entry in self.commands if entry.time < commands[0].time]
        return self.model_copy(update={"commands": (*before, *map(_entry_of_command, commands))})

    def _block(self, key: str, robot: StationRobot, site: Site) -> SampledBlock:
        parameters, feet = self.walking(robot), robot.feet
        assert feet is not None  # check() has asked
        names = [foot for group in parameters.groups for foot in group]
        links = {robot.plant.GetFrameByName(link, robot.instance).body().index(): link for link in feet.links}
        frames = [robot.plant.GetFrameByName(links[robot.tools[foot].body().index()], robot.instance) for foot in names]
        facing = math.radians(gaits_file(robot.model).facing_deg)
        posture = robot.model.axis_vector(parameters.bearing.posture_deg, f"{key}.gait.bearing.posture_deg")
        body = Body(
            plant=robot.plant,
            instance=robot.instance,
            root=robot.root,
            axes=robot.axis_map,
            limits=robot.model.axis_limits,
            posture=np.deg2rad(posture),
            stance=np.deg2rad(robot.model.axis_vector(parameters.stance_deg, f"{key}.gait.stance_deg")),
            feet=frames,
            contact=feet,
            legs=[axes_to(robot, frame) for frame in frames],
            facing=facing,
        )
        groups = [[names.index(foot) for foot in group] for group in parameters.groups]
        height_map = HeightMap(site.plant.ground.beneath, body.sole_reach + _EDGE) if self.height_map else None
        path = None if self.path is None else Follower(self.path, parameters.max_speed, facing)
        return WalkingLoop(
            self,
            WalkingEngine(body, parameters, groups, 1 / self.rate, height_map),
            names,
            np.deg2rad(posture),
            Commander(self.commands, path),
        )


# Decimals of a turn in degrees per second: a file holds no more, and its run must get equal numbers to the last bit.
_TURN_DECIMALS = 9


def _entry_of_command(command: TimedCommand) -> Commanded:
    """Convert a command to an entry of the section's ``commands``, with the turn in degrees."""
    ahead, left, turn = command.values
    turn_deg = round(math.degrees(turn), _TURN_DECIMALS)
    return Commanded(time=command.time, ahead=ahead, sideways=left, turn_deg=turn_deg)


def _command_values(entry: Commanded) -> tuple[float, ...]:
    """Convert an entry of ``commands`` to the numbers of a command: ahead and left [m/s], turn [rad/s]."""
    return entry.ahead, entry.sideways, math.radians(entry.turn_deg)


class WalkingLoop(SampledBlock):
    """Ask a robot's axes for the next posture of a walk.

    Ports:
        in  by the name of each foot whose force is read: that (3), the last part upward [N];
            ``position`` (n) [rad], ``velocity`` (n) [rad/s]; ``base_pose`` (7): x y z [m] and a quaternion;
            ``base_velocity`` (6): linear and angular, in the world [m/s, rad/s]; perhaps ``command`` (3), as below, or
            not a number; perhaps ``waits`` (1): not 0 while something else moves the robot.
        out ``target`` (n) [rad]; ``active`` (1): 1; ``offset_velocity`` (n) [rad/s]: how fast the target moves;
            ``capture`` (2): divergent component from the foot that stands, ahead and to the left [m];
            ``foot`` (1): 0 where the right one stands, 1 where the left one does; ``command`` (3): what the walk is
            asked for, ahead and to the left [m/s], turn [rad/s]; ``clipped`` (1): 1 while that is less than was wanted;
            ``blind`` (1): 1 where what is read is not a number: then the walk goes on as planned.
    """

    units = MappingProxyType(
        {"target": "rad", "offset_velocity": "rad/s", "capture": "m", "command": "m/s, m/s, rad/s"}
    )
    components = MappingProxyType({"capture": ("ahead", "left"), "command": ("ahead", "left", "turn")})

    def __init__(
        self, section: Walk, engine: WalkingEngine, feet: Sequence[str], posture: Vector, commander: Commander
    ) -> None:
        """Make the block of a section, around the engine of a walk and what says what is asked for.

        ``feet`` are named in the engine's order; the forces on all of them are read, or on none. The posture (n,) [rad]
        is that of axes in no leg, and near which the legs are found.
        """
        self.engine, self.start, self._commander, self._strict = engine, posture, commander, section.strict
        self._feet = [foot for foot in feet if foot in section.reads]
        self._perhaps = {name: size for name, size in (("command", 3), ("waits", 1)) if name in section.reads}
        self._last = b"", Stride()  # of the last sample, and its numbers: it need not be made of them again
        zero = np.zeros(len(posture))
        reads = {"position": len(posture), "velocity": len(posture), "base_pose": 7, "base_velocity": 6}
        reads |= {**self._perhaps, **dict.fromkeys(self._feet, 3)}
        outputs: dict[str, Vector | float] = {"target": zero, "active": 0.0, "offset_velocity": zero}
        outputs |= {"capture": np.zeros(2), "foot": 1.0, "command": np.zeros(3), "clipped": 0.0, "blind": 0.0}
        memory = {**outputs, "stride": np.zeros(NUMBERS), "posture": zero, "begun": zero, "ready": 0.0}
        memory |= Commander.MEMORY
        super().__init__(period=1 / section.rate, reads=reads, memory=memory, gives=tuple(outputs))

    def command_by_hand(self, context: Context, values: Sequence[float]) -> None:
        """Command the walk from the next sample on. Neither the section nor a port commands it any more in this run.

        Args:
            context: context of the block, which is changed.
            values: speeds ahead and to the left [m/s], and turn [rad/s].
        """
        self.remember(context, {"hand": np.array([1.0, *values])})

    def sample(self, memory: Named, read: Named) -> Changes:
        """Return the next posture."""
        seen = np.concatenate([read[name] for name in _READ])
        blind = 0.0 if math.isfinite(seen.dot(seen)) else 1.0
        changes: dict[str, Vector | float] = {} if memory["blind"][0] == blind else {"blind": blind}
        if not read[TIME][0]:  # what a hand asked for in another run is past
            changes["hand"] = np.zeros(4)
        if "waits" in self._perhaps and read["waits"][0]:
            return {**changes, "active": 0.0, "offset_velocity": np.zeros(len(self.start))}
        if not memory["active"][0]:
            return {**changes, **({} if blind else self._begun(read))}
        if memory["ready"][0] < 1.0:
            begun, end = memory["begun"], memory["posture"]
            time = _READY * math.sqrt(np.abs(end - begun).max() / (math.pi / 4))
            ready = min(memory["ready"][0] + self.period / max(time, self.period), 1.0)
            target = begun + smoothstep(ready) * (end - begun)
            velocity = (target - memory["target"]) / self.period
            return {**changes, "target": target, "offset_velocity": velocity, "ready": ready}
        posture, engine, (known, stride) = memory["posture"], self.engine, self._last
        estimator = engine.estimator
        if memory["stride"].tobytes() != known:
            stride = Stride.of(memory["stride"])
        command = self._commanded(memory, read, changes)
        estimate = None if blind else estimator.estimate(stride, engine.body.observe(seen), self._forces(stride, read))
        after, target = engine.sample(stride, posture, command, estimate)
        numbers = after.numbers()
        self._last = numbers.tobytes(), after
        if estimate is not None:
            changes["capture"] = np.array([estimate.xi.real, estimate.xi.imag])
        return {
            **changes,
            "target": target,
            "offset_velocity": (target - posture) / self.period,
            "posture": target,
            "stride": numbers,
            "foot": after.step.standing,
        }

    def _commanded(self, memory: Named, read: Named, changes: dict[str, Vector | float]) -> Command:
        """Return what is asked for within what the legs can follow, and add to what is told."""
        time, by_port = float(read[TIME][0]), read["command"] if "command" in self._perhaps else None
        progress, before = float(memory["progress"][0]), memory["command"]
        desired, along = self._commander.now(time, memory["hand"], by_port, read["base_pose"], progress)
        if along != progress:
            changes["progress"] = along
        if desired is None:  # the path does not see where the robot is
            return command_of(before)
        command = clip_command(desired, self.engine.max_speed)
        less = float(command is not desired)
        if less and self._strict:
            part, value, limit, unit = find_excess(desired, self.engine.max_speed)[0]
            raise RunEnds(
                message(
                    "parts.command_beyond_legs",
                    "the command {part} of {value:g} {unit} is beyond the {limit:g} {unit} that the legs can follow",
                    part=part,
                    value=value,
                    unit=unit,
                    limit=limit,
                )
            )
        if less != memory["clipped"][0]:
            changes["clipped"] = less
        numbers = [command.speed.real, command.speed.imag, command.turn]
        if numbers != before.tolist():
            changes["command"] = np.array(numbers)
        return command

    def _forces(self, stride: Stride, read: Named) -> list[float] | None:
        """Return the vertical forces on the feet where they count, for reading them takes time; None: none are told."""
        if not self._feet:
            return None
        felt = self.engine.estimator.feet_to_measure(stride)
        return [abs(float(read[foot][2])) if place in felt else 0.0 for place, foot in enumerate(self._feet)]

    def _begun(self, read: Named) -> Changes:
        engine = self.engine
        seen = engine.body.observe(np.concatenate([read[name] for name in _READ]))
        stride, posture = engine.stand(self.start, engine.estimator.slope(seen))
        far = np.abs(posture - read["position"]).max()
        return {
            "target": read["position"] if far > _SAME else posture,
            "active": 1.0,
            "begun": read["position"],
            "posture": posture,
            "stride": stride.numbers(),
            "ready": 0.0 if far > _SAME else 1.0,
        }


_READ = ("position", "velocity", "base_pose", "base_velocity")
