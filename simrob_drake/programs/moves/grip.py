"""Fingers that close on a piece, which they hold by friction alone, or open."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from simrob_drake.errors import InvalidParameter
from simrob_drake.programs.moves.move import ArmStation, Move, Run
from simrob_drake.programs.plan import Plan
from simrob_drake.programs.planning import POINTS, Planning
from simrob_drake.programs.segments import joint_segment, joint_way
from simrob_drake.sections import Duration, NotNegative, Positive
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.servos import servo_gains

_SHORTEST = 0.5  # s
_EASY = 2.2  # times the time of a way at full speed: a smooth move is at most 1.9 times as fast as on average


class FingerMove(Move):
    """What closing and opening have in common.

    The width is how far the fingers are apart beyond what they are when closed, of fingers that slide.
    """

    brief: ClassVar[bool] = True
    of_legs: ClassVar[bool] = False
    opens: ClassVar[bool]

    width: NotNegative | None = None
    """How far they are to be apart [m]; all the way unless given."""
    duration: Duration | None = None
    """Of the move [s]; as their speed allows unless given."""
    robot: str | None = None
    """Whose; that of the program unless given."""

    def caption(self, *, robots: bool = False) -> str:
        """Return what they do."""
        return f"{self.key} of {self.robot}" if robots else self.key

    def plan(self, planning: Planning) -> Plan:
        """Return the fingers' move, planned; other axes stay; raises InvalidParameter: no fingers, or no such width."""
        robot, row = planning.model, planning.start.copy()
        if not robot.fingers:
            raise InvalidParameter("robot", robot.name, "one with a gripper: in its robot.yaml")
        part = float(self.opens) if self.width is None else self.width / self._widest(planning)
        for place, (closed, opened) in robot.fingers.items():
            row[place] = closed + part * (opened - closed)
        speed = np.where(np.isfinite(robot.speed_limits), robot.speed_limits, np.inf)
        time = self.duration or max(_SHORTEST, _EASY * float((np.abs(row - planning.start) / speed).max()))
        way = joint_way(planning.chain, planning.start, row)
        plan = planning.checked([joint_segment(way, points=POINTS)], {"duration": time, "check": "limits"}, POINTS)
        return replace(plan, entry={self.key: self.model_copy(update={"robot": planning.robot}).entry()[self.key]})

    def _widest(self, planning: Planning) -> float:
        robot = planning.model
        if not all(robot.prismatic[place] for place in robot.fingers):
            raise InvalidParameter("width", self.width, f"left out: the fingers of {robot.name} do not slide")
        widest = sum(abs(opened - closed) for closed, opened in robot.fingers.values())
        if self.width is not None and self.width > widest * (1 + 1e-9):
            raise InvalidParameter("width", self.width, f"at most {widest:.4g} m, as far as {robot.name} opens")
        return widest

    def perform(self, cell: ArmStation, robot: str | None, run: Run) -> Any:
        """Give the fingers their force, and move them."""
        planning = cell.planning(self.robot or robot)
        plan = self.plan(planning)
        force = self._force(planning, cell.config)
        if force is not None:
            axes = list(planning.model.axes)
            cell.limit_efforts(planning.robot, {axes[place]: force for place in planning.model.fingers})
        return run([plan], None)

    def _force(self, planning: Planning, config: StationConfig) -> float | None:
        """Return the largest force of each finger from now on; None: as its motor has it."""
        gripper = planning.model.gripper
        return None if gripper is None or config.mode == "kinematic" else gripper.force


class GripMove(FingerMove):
    """Fingers that close, until something is between them or all the way."""

    key: ClassVar[str] = "grip"
    title: ClassVar[str] = "Grip"
    opens: ClassVar[bool] = False
    form: ClassVar[Mapping[str, str | float | None]] = {"force": None, "width": None, "duration": None}

    force: Positive | None = None
    """Largest force of each finger from then on [N, or N·m of one that turns]; the gripper's own unless given."""

    def _force(self, planning: Planning, config: StationConfig) -> float | None:
        own = super()._force(planning, config)
        if self.force is None:
            return own
        if config.mode == "kinematic":
            raise InvalidParameter("force", self.force, "left out on a kinematic station, where attach() holds pieces")
        robot = planning.model
        most = own or min(float(robot.efforts[place]) for place in robot.fingers)
        if self.force > most:
            raise InvalidParameter("force", self.force, f"at most {most:g}, as much as the fingers have")
        servo = config.servo_of(planning.robot)
        gains = servo_gains(robot, servo)
        for place, (closed, opened) in robot.fingers.items():
            pressing = gains.kp[place] * abs(opened - closed)  # of one that is wide open; a piece leaves less
            if servo.law == "pid" and gains.ki[place] == 0 and pressing < self.force:
                expected = f"at most {pressing:.3g}, as servo.kp of {list(robot.axes)[place]} presses with wide open"
                raise InvalidParameter("force", self.force, expected)
        return self.force


class OpenMove(FingerMove):
    """Fingers that open."""

    key: ClassVar[str] = "open"
    title: ClassVar[str] = "Open"
    opens: ClassVar[bool] = True
    form: ClassVar[Mapping[str, str | float | None]] = {"width": None, "duration": None}
