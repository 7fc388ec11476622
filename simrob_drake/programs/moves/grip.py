"""What tools do: another one for an arm (SimRob's Tool), and fingers that close on a piece or open.

They hold it by friction alone.
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
    """A robot uses another tool; it takes no time."""

    key: ClassVar[str] = "tool"
    brief: ClassVar[bool] = True
    takes_time: ClassVar[bool] = False
    of_legs: ClassVar[bool] = False

    name: Annotated[str | None, NameOf("tools")] = None
    """A tool of the robot, or a piece that it carries."""
    pose: Pose | None = None
    """Or its pose in the frame of the tool that the robot has now."""
    robot: str | None = None
    """Which robot of the station; that of the program unless given."""

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if (self.name is None) == (self.pose is None):
            raise ValueError(message("programs.name_or_pose", "a tool is given by one of name and pose"))
        return self

    def perform(self, cell: StatefulStation, robot: str | None, run: Run) -> None:
        """Use it."""
        tool = self.name if self.pose is None else self.pose
        assert tool is not None  # one of them is given
        cell.tool(cell.robot_name(self.robot or robot), tool)


_SHORTEST = 0.5  # s
_EASY = 2.2  # times the time of a way at full speed: a smooth move is at most 1.9 times as fast as on average
_ALIKE = 1e-6  # parts of an effort
_USUAL = 100.0  # N: many files know no limit of a hand's motors, and have one that crushes what it holds


class FingerMove(Move):
    """What closing and opening have in common."""

    brief: ClassVar[bool] = True
    of_legs: ClassVar[bool] = False
    opens: ClassVar[bool]

    width: NotNegative | None = None
    """How far the inner faces of the fingers are to be apart [m]; all the way unless given."""
    duration: Duration | None = None
    """Of the move [s]; as their speed allows unless given."""
    robot: str | None = None
    """Whose; that of the program unless given."""

    @classmethod
    def possible_keys(cls, config: StationConfig, robot: str, model: RobotModel) -> frozenset[str] | None:
        """Find the keys that fingers can be given.

        A kinematic station has no forces, and fingers whose shapes do not meet have no width.
        """
        if not model.fingers:
            return None
        keys = set(cls.model_fields)
        if stroke_of(model) is None:
            keys -= {"width", "force"}
        if not config.engine.moves_by_forces:
            keys -= {"force"}
        return frozenset(keys)

    def plan(self, planning: Planning) -> Plan:
        """Return the fingers' move, planned; other axes stay; raises InvalidParameter: no fingers, or no such width."""
        robot, row = planning.model, planning.start.copy()
        if not robot.fingers:
            raise InvalidParameter(
                "robot",
                robot.name,
                message(
                    "programs.robot_with_gripper",
                    "one with a gripper: in its robot.yaml; {advice}",
                    advice=gripper_advice(robot),
                ),
            )
        part = float(self.opens) if self.width is None else self._part(robot, self.width)
        for place, (closed, opened) in robot.fingers.items():
            row[place] = closed + part * (opened - closed)
        speed_limits = planning.rate_limits[0]
        shortest = float((np.abs(row - planning.start) / speed_limits).max())
        time = self.duration or max(_SHORTEST, _EASY * shortest)
        way = joint_way(planning.chain, planning.start, row)
        plan = planning.checked([joint_segment(way, points=POINTS)], {"duration": time, "check": "limits"}, POINTS)
        return replace(plan, entry={self.key: self.model_copy(update={"robot": planning.robot}).entry()[self.key]})

    def _part(self, robot: RobotModel, width: float) -> float:
        """Return which part of their way the fingers are open at a width [m]."""
        stroke = _known(stroke_of(robot), robot, "width", width)
        if width > stroke.widest * (1 + 1e-9):
            raise InvalidParameter(
                "width",
                width,
                message(
                    "programs.as_far_as_opens",
                    "at most {widest:.4g} m, as far as {robot} opens",
                    widest=stroke.widest,
                    robot=robot.name,
                ),
            )
        return stroke.opening(width)

    def perform(self, cell: StatefulStation, robot: str | None, run: Run) -> Any:
        """Move the fingers with their force: as what turns presses where it begins, and then as where it stopped."""
        planning = cell.planning(self.robot or robot)
        name, model = planning.robot, planning.model
        plan, stroke = self.plan(planning), stroke_of(model)
        force = None if not cell.config.engine.moves_by_forces else self._force(model, stroke)
        if force is None:
            return run([plan], None)
        known = _known(stroke, model, "force", force)
        effort = force * known.effort(_open_part(model, cell.position(name)))
        self._press(cell, planning, effort)
        result = run([plan], None)
        last = force * known.effort(_open_part(model, cell.position(name)))
        if not np.isclose(last, effort, rtol=_ALIKE):
            self._press(cell, planning, last)
        return result

    def _press(self, cell: StatefulStation, planning: Planning, effort: float) -> None:
        """Let the motor of each finger give so much at most from now on [N·m or N]."""
        axes = list(planning.model.axes)
        cell.limit_efforts(planning.robot, {axes[place]: effort for place in planning.model.fingers})

    def _force(self, robot: RobotModel, stroke: Stroke | None) -> float | None:
        """Return the largest force of each finger from now on [N]; None: as its motor has it."""
        return None if robot.gripper is None else robot.gripper.force


class GripMove(FingerMove):
    """Fingers that close, until something is between them or all the way."""

    key: ClassVar[str] = "grip"
    opens: ClassVar[bool] = False

    force: Positive | None = None
    """With which each finger presses from then on [N]; the gripper's own unless given, or its motors' up to 100 N."""

    def perform(self, cell: StatefulStation, robot: str | None, run: Run) -> Any:
        """Check that the fingers can press so, and close them."""
        if self.force is not None:
            self._check_force(cell.planning(self.robot or robot), cell.config, self.force)
        return super().perform(cell, robot, run)

    def _check_force(self, planning: Planning, config: StationConfig, force: float) -> None:
        if not config.engine.moves_by_forces:
            raise Unsuitable(
                "force",
                message("programs.no_forces", "a kinematic station has no forces"),
                message("programs.attach_holds", "leave it out; attach() holds pieces there"),
            )
        robot = planning.model
        stroke = _known(stroke_of(robot), robot, "force", force)
        most = (robot.gripper and robot.gripper.force) or _motors_force(robot, stroke)
        if force > most:
            raise InvalidParameter(
                "force",
                force,
                message("programs.as_much_as_fingers", "at most {most:.4g}, as much as the fingers have", most=most),
            )
        servo = config.servo_of(planning.robot)
        gains = servo_gains(robot, servo)
        for place, (closed, opened) in robot.fingers.items():
            # of one that is wide open; a piece leaves less
            pressing = gains.kp[place] * abs(opened - closed) / stroke.effort(1.0)
            if servo.law == "pid" and gains.ki[place] == 0 and pressing < force:
                expected = message(
                    "programs.pressing_wide_open",
                    "at most {pressing:.3g}, as servo.kp of {axis} presses with wide open",
                    pressing=pressing,
                    axis=list(robot.axes)[place],
                )
                raise InvalidParameter("force", force, expected)

    def _force(self, robot: RobotModel, stroke: Stroke | None) -> float | None:
        own = self.force or super()._force(robot, stroke)
        return own if own or stroke is None else min(_motors_force(robot, stroke), _USUAL)


class OpenMove(FingerMove):
    """Fingers that open."""

    key: ClassVar[str] = "open"
    opens: ClassVar[bool] = True


def _known(stroke: Stroke | None, robot: RobotModel, key: str, value: float) -> Stroke:
    """Return how fingers close, which ``key`` asks for; raises InvalidParameter: their shapes do not tell."""
    if stroke is None:
        raise Unsuitable(
            key,
            message(
                "programs.fingers_without_shapes",
                "the fingers of {robot} have no shapes that tell where they meet",
                robot=robot.name,
            ),
        )
    return stroke


def _motors_force(robot: RobotModel, stroke: Stroke) -> float:
    """Return with how many newtons each finger can press wide open, as its weakest motor lets it."""
    return min(float(robot.efforts[place]) for place in robot.fingers) / stroke.effort(1.0)


def _open_part(robot: RobotModel, position: Vector) -> float:
    """Return which part of their way the fingers are open in a posture (n,) [rad or m], in the middle of them."""
    parts = [(position[place] - closed) / (opened - closed) for place, (closed, opened) in robot.fingers.items()]
    return float(np.clip(np.mean(parts), 0.0, 1.0))
