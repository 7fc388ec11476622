"""Walking loop: from commands and the measured motion of the robot to the reference of its legs.

The walk itself is in :mod:`simrob_drake.walking`: its *engine* computes the next posture from a *stride*, the state of
the walk (which foot stands, where the other one lands, how the trunk moves), and from a *command*, the desired speeds
ahead and to the left [m/s] and the turn [rad/s]. The robot has n axes. A loop's output ``target`` replaces the
reference of its robot while its output ``active`` is 1.
"""

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field, model_validator
from pydrake.systems.framework import Context

from simrob_drake.base.errors import InvalidParameter, Unsuitable, one_of
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import compound, message
from simrob_drake.base.sections import Boolean
from simrob_drake.blocks.sampled import TIME, Changes, Named, RunEnds, SampledBlock
from simrob_drake.parts.controllers.loop import LoopSection
from simrob_drake.parts.controllers.section import CommandPart, TimedCommand
from simrob_drake.parts.controllers.support import axes_to
from simrob_drake.parts.resolved import ResolvedRobot, StationContents
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

# Postures that differ by less are the same, since servos leave small errors [rad].
_SAME_POSTURE = 1e-3
# Largest distance of the robot from the start of its path [m].
_LARGEST_START_DISTANCE = 0.5
# Level ground that is left free around a sole, on a known ground [m].
_EDGE = 0.02
# Time to take the first posture from a distance of 45 deg [s]. It grows with the square root of the distance.
_READY_TIME = 1.0
_READY_DISTANCE = math.pi / 4


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
        CommandPart(
            "turn",
            "rad/s",
            "turn ← → [°/s]",
            keys=("ArrowRight", "ArrowLeft"),
            slider_unit=math.radians(1),
        ),
    )
    command_key: ClassVar[str] = "commands"
    remarks: ClassVar[Mapping[str, str]] = {
        "clipped": message(
            "parts.asked_for_too_much",
            "clips commands that are beyond the speed limits of the legs",
        ),
        "blind": message(
            "parts.reads_no_number",
            "receives values that are not numbers, and continues as planned",
        ),
    }
    camera_follows: ClassVar[bool] = True
    overrules_reference: ClassVar[bool] = True

    kind: Literal["walk"]
    gait: dict[str, Any] = Field(default_factory=dict)
    """Parameters in place of those under `reacting` in the robot's `gaits.yaml`."""
    commands: tuple[Commanded, ...] = ()
    """Commands and their times, in the order of the times; before the first one the robot follows its path, or stands.
    An input `command` (3) that `reads` names has priority while its values are numbers: ahead, to the left [m/s], turn
    [rad/s]. While an input `waits` (1) that `reads` names, such as `get_up.active`, is not 0, the walk rests; then it
    begins anew."""
    path: Waypoints | None = None
    """Path that the robot follows, by the pose of its root that the loop reads."""
    height_map: Boolean = False
    """Use the height of the station's ground, seen from above, around the measured pose of the robot: feet are lifted
    to this height, and land on even ground, within 60 mm of where they would land otherwise."""
    strict: Boolean = False
    """Refuse commands that the legs cannot follow, by `max_speed` of the gait; otherwise they are clipped."""

    @model_validator(mode="after")
    def _check_times(self) -> "Walk":
        """Check that the commands are in the order of their times. Equal times are allowed.

        Raises:
            ValueError: a time is before the one in front of it.
        """
        times = [command.time for command in self.commands]
        if times != sorted(times):
            raise ValueError(
                message(
                    "parts.times_of_commands",
                    "the times of commands are {times}; they must not decrease",
                    times=times,
                )
            )
        return self

    def walking(self, robot: ResolvedRobot) -> WalkingParameters:
        """Parameters of the walk: those of the robot's `gaits.yaml`, with the section's own values in their place.

        Args:
            robot: robot of the loop.

        Raises:
            SimrobError: the robot has no such parameters, or a value of the section is wrong.
        """
        return load_walking(robot.model, self.gait)

    def check(self, key: str, station: StationContents) -> None:
        """Check that the robot stands on feet of its own and can walk, and that commands and path suit it.

        Args:
            key: key of the section in the station file, for errors.
            station: contents of the station.

        Raises:
            SimrobError: the robot does not stand on feet of its own, has no parameters or wrong ones, or stands too far
                from its path; a foot is no tool, or lacks a force sensor that the others have; force sensors are named,
                but the gait does not use them; a height map is asked for without feedback; a section that is strict has
                a command beyond the legs; or by the checks of every loop the robot does not exist, the station has no
                servos, or the rate is too high.
        """
        super().check(key, station)
        robot = self.on_feet(key, station)
        parameters = self.walking(robot)
        self._check_feet(key, robot, parameters)
        # The height map is read around the measured pose of the robot, which a walk without feedback does not use.
        if self.height_map and parameters.feedback is None:
            raise InvalidParameter(
                f"{key}.height_map",
                True,
                message(
                    "parts.false_without_feedback",
                    "false without gait.feedback, which measures where the feet are",
                ),
            )
        self.warnings(key, robot)  # it raises an error in a strict section
        if self.path is not None:
            self._check_path_start(key, robot, self.path)

    def _check_feet(self, key: str, robot: ResolvedRobot, parameters: WalkingParameters) -> None:
        """Check that the feet of the gait are tools of the robot, and that all of them have force sensors, or none.

        Args:
            key: key of the section in the station file, for errors.
            robot: robot of the loop.
            parameters: parameters of the walk.

        Raises:
            SimrobError: a foot is no tool, only some feet have a force sensor, or the forces are not used, since the
                gait has no ``feedback.touch_force``.
        """
        feet = [foot for group in parameters.groups for foot in group]
        what = message(
            "parts.foot_for_groups",
            "foot of {robot} for {key}.gait.groups",
            robot=robot.name,
            key=key,
        )
        for foot in feet:
            one_of(what, foot, robot.model.tools)
        measured = [foot for foot in feet if foot in self.reads]
        # Without force sensors, the estimator finds the feet that stand by their heights.
        if not measured:
            return
        feedback = parameters.feedback
        uses_forces = feedback is not None and feedback.touch_force is not None
        if measured != feet or not uses_forces:
            found = message(
                "parts.forces_on", "it names force sensors for {read}", read=", ".join(measured)
            )
            remedy = message(
                "parts.force_sensors_of_feet",
                "name a force sensor for each of {feet} and set gait.feedback.touch_force, or name none",
                feet=", ".join(feet),
            )
            raise Unsuitable(f"{key}.reads", found, remedy)

    def _check_path_start(self, key: str, robot: ResolvedRobot, path: Waypoints) -> None:
        """Check that the robot stands near the first point of its path at the start.

        Args:
            key: key of the section in the station file, for errors.
            robot: robot of the loop.
            path: path of the section.

        Raises:
            InvalidParameter: the point is too far away.
        """
        # Complex numbers x + i y stand for points of the floor [m].
        path_start = complex(*path.points[0])
        robot_start = complex(*robot.base.translation()[:2])
        if abs(path_start - robot_start) > _LARGEST_START_DISTANCE:
            raise InvalidParameter(
                f"{key}.path.points[0]",
                compound("({x:g}, {y:g}) m", x=path_start.real, y=path_start.imag),
                message(
                    "parts.near_robot",
                    "a point within {near:g} m of {robot}, which stands at ({x:g}, {y:g}) m",
                    near=_LARGEST_START_DISTANCE,
                    robot=robot.name,
                    x=robot_start.real,
                    y=robot_start.imag,
                ),
            )

    def warnings(self, key: str, robot: ResolvedRobot) -> list[str]:
        """Find the commands and the speed of the path that are faster than the legs, and will be clipped.

        Args:
            key: key of the section in the station file.
            robot: robot of the loop.

        Returns:
            A sentence for each number of a command that will be clipped.

        Raises:
            InvalidParameter: there is such a command, and the section is strict.
            SimrobError: the robot has no parameters of a walk, or a value of the section is wrong.
        """
        max_speed = self.walking(robot).max_speed
        commands = {
            f"commands[{number}]": entry.command for number, entry in enumerate(self.commands)
        }
        # Along a path the robot slows down in bends, so that it turns within its limit: only the speed ahead can be too
        # large.
        if self.path is not None:
            commands["path"] = Command(complex(self.path.speed))
        found = list[str]()
        for own_key, command in commands.items():
            for part in find_excess(command, max_speed):
                # A path has the key `speed` in place of the keys of a command (`ahead`, `sideways`, `turn_deg`).
                part_name = "speed" if own_key == "path" else part.key
                name = f"{key}.{own_key}.{part_name}"
                if self.strict:
                    value = compound("{value:g} {unit}", value=part.value, unit=part.unit)
                    expected = message(
                        "parts.speed_of_legs",
                        "at most {limit:g} {unit}, the limit of the legs of {robot}",
                        limit=abs(part.limit),
                        unit=part.unit,
                        robot=robot.name,
                    )
                    raise InvalidParameter(name, value, expected)
                found.append(
                    message(
                        "parts.command_clipped",
                        "{name}, {value:g} {unit}, is clipped to {limit:g} {unit}",
                        name=name,
                        value=part.value,
                        unit=part.unit,
                        limit=part.limit,
                    )
                )
        return found

    def command_limits(self, robot: ResolvedRobot) -> list[tuple[float, float]]:
        """Lower and upper limits of the speeds ahead and to the left [m/s] and of the turn [deg/s], for sliders.

        They are the largest speeds that the legs of the robot can follow, by the parameters of its walk.
        """
        limits = self.walking(robot).max_speed
        return [
            (-limits.backward, limits.ahead),
            (-limits.sideways, limits.sideways),
            (-limits.turn_deg, limits.turn_deg),
        ]

    def command_at(self, time: float) -> tuple[float, ...]:
        """The command of the section at a time [s]: speeds ahead and to the left [m/s], and turn [rad/s].

        They are zero before the first command. A path, inputs and users, who may command the walk, too, are not
        considered.
        """
        # The last command whose time has come holds.
        due = [entry for entry in self.commands if entry.time <= time]
        return _command_values(due[-1] if due else Commanded())

    def rounded_command(self, command: TimedCommand) -> TimedCommand:
        """Round the turn of a command to what the section's file can hold in degrees.

        A run rounds a command before it applies it, so that a run of the saved file gets equal numbers.
        """
        return command._replace(values=_command_values(_entry_of_command(command)))

    def with_commands(self, commands: Sequence[TimedCommand]) -> "Walk":
        """Copy the section with commands that a user or a program gave during a run, to save them in a station file.

        The section's own commands before the first given one are kept, its later ones are dropped.

        Args:
            commands: commands in the order of their times, at least one.
        """
        # A command holds until the next one, so commands of the section after the first new one would interrupt it.
        before = [entry for entry in self.commands if entry.time < commands[0].time]
        return self.model_copy(update={"commands": (*before, *map(_entry_of_command, commands))})

    def _block(self, key: str, robot: StationRobot, site: Site) -> SampledBlock:
        """Create the block with its engine, for a robot of the station under construction, the site.

        The key of the section is for errors.
        """
        parameters = self.walking(robot)
        feet = robot.feet
        assert feet is not None  # check() has checked it
        names = [foot for group in parameters.groups for foot in group]
        # The gait names a foot by a tool of the robot. The engine needs the frame of the link to which the tool is
        # fixed, and which has the contact points of the foot.
        link_of_body = {
            robot.plant.GetFrameByName(link, robot.instance).body().index(): link
            for link in feet.links
        }
        frames = []
        for foot in names:
            link = link_of_body[robot.tools[foot].body().index()]
            frames.append(robot.plant.GetFrameByName(link, robot.instance))
        # Direction in which the robot looks, from the x axis of its root link.
        facing = math.radians(gaits_file(robot.model).facing_deg)
        posture = robot.model.axis_vector(
            parameters.bearing.posture_deg, f"{key}.gait.bearing.posture_deg"
        )
        body = Body(
            plant=robot.plant,
            instance=robot.instance,
            root=robot.root,
            axes=robot.axis_map,
            limits=robot.model.axis_limits,
            posture=np.deg2rad(posture),
            stance=np.deg2rad(
                robot.model.axis_vector(parameters.stance_deg, f"{key}.gait.stance_deg")
            ),
            feet=frames,
            contact=feet,
            legs=[axes_to(robot, frame) for frame in frames],
            facing=facing,
        )
        # Feet of one group are lifted together; the engine has indices in place of names.
        groups = [[names.index(foot) for foot in group] for group in parameters.groups]
        height_map = (
            HeightMap(site.plant.ground.beneath, body.sole_reach + _EDGE)
            if self.height_map
            else None
        )
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


class _SelectedCommand(NamedTuple):
    """Command of a sample.

    Attributes:
        command: the command, within the speeds that the legs can follow.
        changes: changes of the loop's memory.
    """

    command: Command
    changes: Changes


class WalkingLoop(SampledBlock):
    """Compute the next posture of a walk.

    Ports:
        in  ``position`` (n) [rad], ``velocity`` (n) [rad/s]; ``base_pose`` (7): x y z [m] and a quaternion;
            ``base_velocity`` (6): linear and angular, in the world [m/s, rad/s]; optionally, for each foot, the force
            on it (3), by its name, the last component upward [N]; ``command`` (3), as below, or not a number; ``waits``
            (1): not 0 while another loop moves the robot.
        out ``target`` (n) [rad]; ``active`` (1): 1, but 0 while ``waits`` is not 0 and until the first finite motion is
            measured; ``offset_velocity`` (n) [rad/s]: velocity of the target; ``capture`` (2): divergent component from
            the stance foot, ahead and to the left [m]; ``foot`` (1): the stance foot, or group of feet, 0 for the right
            one, 1 for the left one; ``command`` (3): command of the walk, ahead and to the left [m/s], turn [rad/s];
            ``clipped`` (1): 1 while more was commanded than the legs can follow; ``blind`` (1): 1
            while one of the first four inputs, the measured motion, is not finite. The walk then continues as planned.
    """

    units = MappingProxyType(
        {"target": "rad", "offset_velocity": "rad/s", "capture": "m", "command": "m/s, m/s, rad/s"}
    )
    components = MappingProxyType(
        {"capture": ("ahead", "left"), "command": ("ahead", "left", "turn")}
    )

    def __init__(
        self,
        section: Walk,
        engine: WalkingEngine,
        feet: Sequence[str],
        posture: Vector,
        commander: Commander,
    ) -> None:
        """Create the block.

        Args:
            section: section of the loop.
            engine: engine of the walk.
            feet: names of the feet, in the engine's order. The forces on all of them are read, or on none.
            posture: posture of the axes that are in no leg, and the one near which postures of the legs are searched,
                shape (n,) [rad].
            commander: selects the command.
        """
        self.engine = engine
        self.start = posture
        self._commander = commander
        self._strict = section.strict
        self._measured_feet = [foot for foot in feet if foot in section.reads]
        self._has_command_port = "command" in section.reads
        self._has_waits_port = "waits" in section.reads
        # The stride after the last sample, and its numbers as bytes: as long as the memory has these numbers, the
        # stride need not be made from them again.
        self._last_numbers = b""
        self._last_stride = Stride()

        # Optional inputs are only declared if the section names their sources: other inputs must be connected.
        count = len(posture)
        zero = np.zeros(count)
        reads = {"position": count, "velocity": count, "base_pose": 7, "base_velocity": 6}
        if self._has_command_port:
            reads["command"] = 3
        if self._has_waits_port:
            reads["waits"] = 1
        reads |= dict.fromkeys(self._measured_feet, 3)
        outputs: dict[str, Vector | float] = {
            "target": zero,
            "active": 0.0,
            "offset_velocity": zero,
            "capture": np.zeros(2),
            "foot": 1.0,
            "command": np.zeros(3),
            "clipped": 0.0,
            "blind": 0.0,
        }
        more_memory: dict[str, Vector | float] = {
            "stride": np.zeros(NUMBERS),
            "posture": zero,  # posture of the walk at the last sample
            "begun": zero,  # posture of the robot when the loop began
            "ready": 0.0,  # part of the motion from there to the first posture that is done
        }
        super().__init__(
            period=1 / section.rate,
            reads=reads,
            memory={**outputs, **more_memory, **Commander.MEMORY},
            gives=tuple(outputs),
        )

    def command_by_hand(self, context: Context, values: Sequence[float]) -> None:
        """Command the walk from the next sample on. Neither the section nor a port commands it any more in this run.

        The sample at the time 0 discards a command that is given before it.

        Args:
            context: context of the block, which is changed.
            values: speeds ahead and to the left [m/s], and turn [rad/s].
        """
        # The 1 in front marks that a user commands the walk, with the three numbers after it.
        self.remember(context, {"hand": np.array([1.0, *values])})

    def sample(self, memory: Named, read: Named) -> Changes:
        """Compute the next posture, or the way to the first one. While another loop moves the robot, be inactive.

        Args:
            memory: memory before the sample.
            read: inputs of the block, and the time.

        Returns:
            The new values of the memory.

        Raises:
            RunEnds: the section is strict, and the command is faster than the legs.
        """
        measured = np.concatenate([read[name] for name in _MEASURED])
        # The sum of the squares is not finite if one of the values is not: this is the fastest test of all values.
        is_blind = not math.isfinite(measured.dot(measured))
        changes: dict[str, Vector | float] = {}
        if memory["blind"][0] != is_blind:
            changes["blind"] = float(is_blind)
        if not read[TIME][0]:
            # A user's command in an earlier run, which this one continues, is over.
            changes["hand"] = np.zeros(4)

        # While another loop moves the robot, this one is not active. It begins anew afterwards, from the posture then.
        if self._has_waits_port and read["waits"][0]:
            return {**changes, "active": 0.0, "offset_velocity": np.zeros(len(self.start))}
        if not memory["active"][0]:
            return changes if is_blind else {**changes, **self._begin(read)}
        if memory["ready"][0] < 1.0:
            return {**changes, **self._approach_start(memory)}
        return {**changes, **self._walk(memory, read, None if is_blind else measured)}

    def _approach_start(self, memory: Named) -> Changes:
        """Move on from the posture at the beginning to the first posture of the walk.

        Args:
            memory: memory before the sample: posture at the beginning, first posture, and part of the way that is done.
        """
        begin = memory["begun"]
        end = memory["posture"]
        # With the same largest acceleration for all distances, the time of a motion grows with their square root.
        duration = _READY_TIME * math.sqrt(np.abs(end - begin).max() / _READY_DISTANCE)
        ready = min(memory["ready"][0] + self.period / max(duration, self.period), 1.0)
        # A polynomial from 0 to 1 without a jump of the speed at its ends.
        progress = smoothstep(ready)
        target = begin + progress * (end - begin)
        velocity = (target - memory["target"]) / self.period
        return {"target": target, "offset_velocity": velocity, "ready": ready}

    def _walk(self, memory: Named, read: Named, measured: Vector | None) -> Changes:
        """Compute the next posture of the walk.

        Args:
            memory: memory before the sample.
            read: inputs of the sample.
            measured: measured motion, the inputs of `_MEASURED` one after the other; None if it is not finite. Then the
                walk continues as planned.

        Returns:
            The new values of the memory.

        Raises:
            RunEnds: the section is strict, and the command is faster than the legs.
        """
        engine = self.engine
        stride = self._last_stride
        # The stride of the last sample is kept as an object. The memory differs from it after a jump to another state,
        # such as the beginning of a run.
        if memory["stride"].tobytes() != self._last_numbers:
            stride = Stride.of(memory["stride"])
        selected = self._select_command(memory, read)
        estimate = None
        if measured is not None:
            state = engine.body.observe(measured)
            estimate = engine.estimator.estimate(stride, state, self._vertical_forces(stride, read))

        # The posture of the last sample is where the inverse kinematics starts to search.
        posture = memory["posture"]
        new_stride, target = engine.sample(stride, posture, selected.command, estimate)
        numbers = new_stride.numbers()
        self._last_numbers = numbers.tobytes()
        self._last_stride = new_stride
        changes: dict[str, Vector | float] = {
            **selected.changes,
            "target": target,
            "offset_velocity": (target - posture) / self.period,
            "posture": target,
            "stride": numbers,
            "foot": new_stride.step.standing,
        }
        if estimate is not None:
            # xi is the divergent component as a complex number, ahead + i left.
            changes["capture"] = np.array([estimate.xi.real, estimate.xi.imag])
        return changes

    def _select_command(self, memory: Named, read: Named) -> _SelectedCommand:
        """Select the command of this sample, and clip it to the speeds that the legs can follow.

        Args:
            memory: memory before the sample.
            read: inputs of the sample.

        Raises:
            RunEnds: the section is strict, and the command is faster than the legs.
        """
        last_values = memory["command"]
        last_progress = float(memory["progress"][0])
        desired, progress = self._commander.now(
            float(read[TIME][0]),
            hand=memory["hand"],  # command of a user who steers
            by_port=read["command"] if self._has_command_port else None,
            base=read["base_pose"],
            progress=last_progress,
        )
        changes: dict[str, Vector | float] = {}
        if progress != last_progress:
            changes["progress"] = progress
        # Without a finite pose of the robot a path gives no command: the one of the last sample stays.
        if desired is None:
            return _SelectedCommand(command=command_of(last_values), changes=changes)

        command = clip_command(desired, self.engine.max_speed)
        # `clip_command` returns the same object if the command is within the limits.
        is_clipped = command is not desired
        if is_clipped and self._strict:
            excess = find_excess(desired, self.engine.max_speed)[0]
            raise RunEnds(
                message(
                    "parts.command_beyond_legs",
                    "the command {part}, {value:g} {unit}, is beyond the limit of the legs, {limit:g} {unit}",
                    part=excess.key,
                    value=excess.value,
                    unit=excess.unit,
                    limit=excess.limit,
                )
            )
        # Unchanged values are not written: each write takes time.
        if is_clipped != memory["clipped"][0]:
            changes["clipped"] = float(is_clipped)
        values = [command.speed.real, command.speed.imag, command.turn]
        if values != last_values.tolist():
            changes["command"] = np.array(values)
        return _SelectedCommand(command=command, changes=changes)

    def _vertical_forces(self, stride: Stride, read: Named) -> list[float] | None:
        """Read the absolute vertical forces on the feet, in the order of the feet [N].

        Only the forces that the estimator needs at this stride are read, since reading takes time. The others are 0.
        Returns None if no forces are measured.
        """
        if not self._measured_feet:
            return None
        needed = self.engine.estimator.feet_to_measure(stride)
        forces = [0.0] * len(self._measured_feet)
        for number in needed:
            foot = self._measured_feet[number]
            forces[number] = abs(float(read[foot][2]))
        return forces

    def _begin(self, read: Named) -> Changes:
        """Begin the walk from the robot's present posture: first it moves to the posture in which the walk stands.

        The slope of the ground under the feet is taken into account. Returns the new values of the memory.

        Args:
            read: inputs of the sample, of which the measured motion is finite.
        """
        engine = self.engine
        state = engine.body.observe(np.concatenate([read[name] for name in _MEASURED]))
        stride, posture = engine.stand(self.start, engine.estimator.slope(state))
        # A robot that stands in another posture first moves to the one of the walk, see `_approach_start`.
        distance = np.abs(posture - read["position"]).max()
        is_there = distance <= _SAME_POSTURE
        return {
            "target": posture if is_there else read["position"],
            "active": 1.0,
            "begun": read["position"],
            "posture": posture,
            "stride": stride.numbers(),
            "ready": 1.0 if is_there else 0.0,
        }


# Inputs that are the measured motion of the robot, in the order of `Body.observe`.
_MEASURED = ("position", "velocity", "base_pose", "base_velocity")
