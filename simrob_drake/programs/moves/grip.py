"""Moves of tools: change the tool of an arm (SimRob's Tool), close its fingers on a piece, and open them.

Fingers hold a piece by friction alone. Their *width* is the distance of their inner faces [m]; their *opening* goes
from 0 (closed) to 1 (open). The *stroke* of a gripper describes how its fingers meet: the opening at a width, and which
torque or force (the *effort*) of a finger's motor makes each finger press with a force of 1 N at an opening.
"""

from dataclasses import replace
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from pydantic import model_validator

from simrob_drake.base.errors import InvalidParameter, Unsuitable
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.base.sections import Duration, NotNegative, Pose, Positive
from simrob_drake.programs.moves.move import Move, NameOf, Run
from simrob_drake.programs.plan import Plan
from simrob_drake.programs.planning import POINTS, Planning
from simrob_drake.programs.segments import joint_segment, joint_way
from simrob_drake.programs.stateful_station import StatefulStation
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.robots.description_files import gripper_advice
from simrob_drake.robots.grasps import Stroke, stroke_of
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.servos import servo_gains


class ToolMove(Move):
    """Change the tool of a robot. This takes no time."""

    key: ClassVar[str] = "tool"
    brief: ClassVar[bool] = True
    takes_time: ClassVar[bool] = False
    of_legs: ClassVar[bool] = False

    name: Annotated[str | None, NameOf("tools")] = None
    """Name of a tool of the robot, or of a piece that it carries."""
    pose: Pose | None = None
    """Pose of the new tool in the frame of the present one, instead of a name."""
    robot: str | None = None
    """Robot of the station. If it is not set, that of the program."""

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        """Check that the tool is given in exactly one way."""
        if (self.name is None) == (self.pose is None):
            raise ValueError(
                message("programs.name_or_pose", "exactly one of name and pose must be set")
            )
        return self

    def perform(self, cell: StatefulStation, robot: str | None, run: Run) -> None:
        """Change the tool of the robot.

        Args:
            cell: the station.
            robot: name of the robot if the move names none. If it is None, too, the only robot of the station.
            run: not used, because the move takes no time.
        """
        tool = self.name if self.pose is None else self.pose
        assert tool is not None  # the validator checked that one of them is set
        cell.tool(cell.robot_name(self.robot or robot), tool)


_SHORTEST = 0.5  # shortest default duration of a move [s]
# Default duration over the time at full speed [1]. The peak of a smooth move is at most 1.9 times its mean speed.
_EASY = 2.2
# Relative difference of two efforts that are the same [1]. A new limit needs another plant: it is set only if needed.
_ALIKE = 1e-6
# Default of the largest force of a finger [N]. Many files have no limit for a gripper's motors, or one that would crush
# what the fingers hold.
_USUAL_FORCE = 100.0
_WIDTH_ROUNDING = 1 + 1e-9  # factor by which a width may be too large because of rounding errors


class FingerMove(Move):
    """A move of the fingers of a robot. Its other axes stay.

    Attributes:
        opens: whether the fingers open, if no width is set.
    """

    brief: ClassVar[bool] = True
    of_legs: ClassVar[bool] = False
    opens: ClassVar[bool]

    width: NotNegative | None = None
    """Distance of the inner faces of the fingers at the end [m]. If it is not set, they move as far as they can."""
    duration: Duration | None = None
    """Duration of the move [s]. If it is not set, as short as their speed allows."""
    robot: str | None = None
    """Robot of the station. If it is not set, that of the program."""

    @classmethod
    def possible_keys(
        cls, config: StationConfig, robot: str, model: RobotModel
    ) -> frozenset[str] | None:
        """Keys that the pendant's input form offers for this move; see :meth:`Move.possible_keys`.

        Returns None for a robot without fingers.

        A kinematic station has no forces, and fingers whose shapes do not meet have neither a width nor a force.
        """
        if not model.fingers:
            return None
        keys = set(cls.model_fields)
        # A width and a force need the geometry of the fingers: where their faces meet.
        if stroke_of(model) is None:
            keys -= {"width", "force"}
        if not config.engine.moves_by_forces:
            keys -= {"force"}
        return frozenset(keys)

    def plan(self, planning: Planning) -> Plan:
        """Plan the move of the fingers.

        Args:
            planning: the start of the move.

        Returns:
            The plan, whose entry for a program's file names the robot.

        Raises:
            InvalidParameter: the robot has no fingers, or they do not open to the width.
            Unsuitable: a width is set, and the shapes of the fingers do not determine one.
            SimrobError: the set duration is too short.
        """
        robot = planning.model
        posture = planning.start.copy()  # the target, in which only fingers differ from the start
        if not robot.fingers:
            raise InvalidParameter(
                "robot",
                robot.name,
                message(
                    "programs.robot_with_gripper",
                    "a robot with a gripper in its robot.yaml; {advice}",
                    advice=gripper_advice(robot),
                ),
            )
        # Without a width, fingers close or open as far as they can: opening 0 or 1.
        opening = float(self.opens) if self.width is None else self._opening_at(robot, self.width)
        # The fingers are axes, by their indices, with their closed and open positions [rad or m].
        for axis, (closed, opened) in robot.fingers.items():
            posture[axis] = closed + opening * (opened - closed)
        time_at_full_speed = float(
            (np.abs(posture - planning.start) / planning.rate_limits.speeds).max()
        )
        duration = self.duration or max(_SHORTEST, _EASY * time_at_full_speed)
        way = joint_way(planning.chain, planning.start, posture)
        segment = joint_segment(way, points=POINTS)
        # Collisions are not checked: the fingers shall touch the piece.
        plan = planning.plan_segments([segment], {"duration": duration, "check": "limits"}, POINTS)
        # The recorded move names its robot even if the user's entry does not: a station may have several robots.
        named_move = self.model_copy(update={"robot": planning.robot})
        return replace(plan, entry={self.key: named_move.entry()[self.key]})

    def _opening_at(self, robot: RobotModel, width: float) -> float:
        """Compute the opening of the fingers at a width [m]: 0 if they are closed, 1 if they are open.

        Raises:
            InvalidParameter: the fingers do not open so far.
            Unsuitable: the shapes of the fingers do not determine a width.
        """
        stroke = _require_stroke(stroke_of(robot), robot, "width")
        if width > stroke.widest * _WIDTH_ROUNDING:
            raise InvalidParameter(
                "width",
                width,
                message(
                    "programs.as_far_as_opens",
                    "at most {widest:.4g} m, the largest opening of {robot}",
                    widest=stroke.widest,
                    robot=robot.name,
                ),
            )
        return stroke.opening(width)

    def perform(self, cell: StatefulStation, robot: str | None, run: Run) -> Any:
        """Move the fingers with a limited force, which stays their limit afterwards; see :meth:`Move.perform`.

        The force is limited by the effort of the motors. The effort that gives this force depends on how far the
        fingers are open: during the move the limit is that of its start, afterwards that of its end. There is no limit
        on a kinematic station, nor if no force is known; then the motors keep the limits that they have.

        Args:
            cell: the station.
            robot: name of the robot if the move names none. If it is None, too, the only robot of the station.
            run: function that runs the plan of the fingers.

        Returns:
            The value that `run` returns.

        Raises:
            Unsuitable: the gripper has a force, and the shapes of its fingers do not determine the effort for it.
            SimrobError: see :meth:`plan`.
        """
        planning = cell.planning(self.robot or robot)
        name = planning.robot
        model = planning.model
        plan = self.plan(planning)
        stroke = stroke_of(model)
        # No torque moves a kinematic station, so that there is nothing to limit.
        force = self._force(model, stroke) if cell.config.engine.moves_by_forces else None
        if force is None:
            return run([plan], None)
        known_stroke = _require_stroke(stroke, model, "force")
        # The effort of the stroke is that for a force of 1 N.
        effort = force * known_stroke.effort(_mean_opening(model, cell.position(name)))
        self._limit_efforts(cell, planning, effort)
        result = run([plan], None)
        # The fingers have moved: the same force may need another torque now.
        last_effort = force * known_stroke.effort(_mean_opening(model, cell.position(name)))
        if not np.isclose(last_effort, effort, rtol=_ALIKE):
            self._limit_efforts(cell, planning, last_effort)
        return result

    def _limit_efforts(self, cell: StatefulStation, planning: Planning, effort: float) -> None:
        """Limit the effort of each finger's motor from now on [N·m or N]. The other motors keep their limits."""
        axes = list(planning.model.axes)
        cell.limit_efforts(planning.robot, {axes[axis]: effort for axis in planning.model.fingers})

    def _force(self, robot: RobotModel, stroke: Stroke | None) -> float | None:
        """Largest force of each finger from now on [N]: that of the gripper in the robot's file.

        If it is None, the motors keep the limits that they have. A subclass may need the stroke, None if it is unknown.
        """
        return None if robot.gripper is None else robot.gripper.force


class GripMove(FingerMove):
    """Close the fingers, until a piece is between them or as far as they can."""

    key: ClassVar[str] = "grip"
    opens: ClassVar[bool] = False

    force: Positive | None = None
    """Force of each finger from then on [N]. If it is not set, the gripper's own, or its motors' up to 100 N."""

    def perform(self, cell: StatefulStation, robot: str | None, run: Run) -> Any:
        """Check that the fingers can press with the force, if it is set, and close them; see :meth:`Move.perform`."""
        if self.force is not None:
            self._check_force(cell.planning(self.robot or robot), cell.config, self.force)
        return super().perform(cell, robot, run)

    def _check_force(self, planning: Planning, config: StationConfig, force: float) -> None:
        """Check that the fingers can press with a force.

        Args:
            planning: the start of the move.
            config: the station.
            force: force of each finger [N].

        Raises:
            Unsuitable: the station is kinematic and has no forces, or the shapes of the fingers do not determine one.
            InvalidParameter: the force is larger than the gripper's own force, or than that of its motors if the file
                gives the gripper none; or the gains of the servos are too weak.
        """
        if not config.engine.moves_by_forces:
            raise Unsuitable(
                "force",
                message("programs.no_forces", "a kinematic station has no forces"),
                message("programs.attach_holds", "leave it out; attach() holds pieces there"),
            )
        robot = planning.model
        stroke = _require_stroke(stroke_of(robot), robot, "force")
        # The gripper's own force counts before that of its motors, which may be larger than the gripper bears.
        most = (robot.gripper and robot.gripper.force) or _motors_force(robot, stroke)
        if force > most:
            raise InvalidParameter(
                "force",
                force,
                message(
                    "programs.as_much_as_fingers",
                    "at most {most:.4g} N, the largest force of the fingers",
                    most=most,
                ),
            )
        servo = config.servo_of(planning.robot)
        gains = servo_gains(robot, servo)  # of all axes, kp in N·m/rad or N/m
        for axis, (closed, opened) in robot.fingers.items():
            # Without an integral part a servo presses by its position error, which is at most the whole way of a finger
            # that a piece holds wide open. A smaller piece leaves less.
            pressing = gains.kp[axis] * abs(opened - closed) / stroke.effort(1.0)
            presses_by_error = servo.law == "pid" and gains.ki[axis] == 0
            if presses_by_error and pressing < force:
                expected = message(
                    "programs.pressing_wide_open",
                    "at most {pressing:.3g} N, the force that servo.kp of {axis} gives at the largest opening",
                    pressing=pressing,
                    axis=list(robot.axes)[axis],
                )
                raise InvalidParameter("force", force, expected)

    def _force(self, robot: RobotModel, stroke: Stroke | None) -> float | None:
        """Largest force of each finger from now on [N]: that of the move, else of the gripper, else of its motors.

        That of the motors counts up to 100 N. The result is None if neither the move nor the gripper has a force, and
        the shapes of the fingers do not determine that of the motors.

        Args:
            robot: the robot.
            stroke: the stroke of its gripper; None if the shapes of the fingers do not determine it.
        """
        own_force = self.force or super()._force(robot, stroke)
        if own_force or stroke is None:
            return own_force
        return min(_motors_force(robot, stroke), _USUAL_FORCE)


class OpenMove(FingerMove):
    """Open the fingers."""

    key: ClassVar[str] = "open"
    opens: ClassVar[bool] = True


def _require_stroke(stroke: Stroke | None, robot: RobotModel, key: str) -> Stroke:
    """Check that the stroke of a gripper is known, and return it.

    Args:
        stroke: the stroke, or None if the shapes of the fingers do not determine where they meet.
        robot: the robot.
        key: key of the move that needs the stroke.

    Raises:
        Unsuitable: the stroke is not known.
    """
    if stroke is None:
        raise Unsuitable(
            key,
            message(
                "programs.fingers_without_shapes",
                "the shapes of the fingers of {robot} do not determine where they meet",
                robot=robot.name,
            ),
        )
    return stroke


def _motors_force(robot: RobotModel, stroke: Stroke) -> float:
    """Force with which each finger can press when it is wide open, limited by the weakest motor of the fingers [N].

    It is infinite if none of these motors has a limit.
    """
    weakest = min(float(robot.efforts[axis]) for axis in robot.fingers)
    return weakest / stroke.effort(1.0)


def _mean_opening(robot: RobotModel, position: Vector) -> float:
    """Mean opening of the fingers in a posture of the robot, from 0 (closed) to 1 (open). A mean beyond is clipped.

    Args:
        robot: the robot.
        position: positions of all of its axes, shape (n,) [rad or m].
    """
    openings = [
        (position[axis] - closed) / (opened - closed)
        for axis, (closed, opened) in robot.fingers.items()
    ]
    return float(np.clip(np.mean(openings), 0.0, 1.0))
