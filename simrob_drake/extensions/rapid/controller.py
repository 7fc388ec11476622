"""What a robot's controller does with RAPID's instructions: moves of a program, one after the other, each looked at."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from pydrake.math import RigidTransform

from simrob_drake.base.arguments import SHORTEST
from simrob_drake.base.errors import SimrobError
from simrob_drake.base.frames import Vector, pose_from_transform
from simrob_drake.base.interpolation import turned_by
from simrob_drake.base.messages import message
from simrob_drake.extensions.rapid.configuration import (
    configuration,
    has_configuration,
    postures_like,
)
from simrob_drake.extensions.rapid.expressions import Call
from simrob_drake.extensions.rapid.signals import Signals
from simrob_drake.extensions.rapid.values import LeftOut, RecordValue, WrongType, transform_of
from simrob_drake.kinematics.solver import Unreachable, require
from simrob_drake.programs.arm import Planner, Workcell
from simrob_drake.programs.errors import AccelerationLimitExceeded, SpeedLimitExceeded
from simrob_drake.programs.moves.grip import ToolMove
from simrob_drake.programs.moves.motion import ArmMotion
from simrob_drake.programs.moves.move import Move, Run
from simrob_drake.programs.moves.move_j import MoveAbsJ, MoveJ
from simrob_drake.programs.moves.move_l import MoveC, MoveL
from simrob_drake.programs.moves.wait import WaitMove
from simrob_drake.programs.plan import CHECKED, Check, Plan

_MOST_MOVES = 5000
_SAME = 1e-6  # rad, that two ways to a posture are apart at most
_NEAR, _SAME_PLACE = 1e-12, 1e-9
_REACH_IN_METRES = 2e-3
"""Largest coordinate of a target whose author may have written metres [m]: a usual reach of 2 m, read as 2 mm."""
_ZONE = 3e-4  # m, the smallest
_SLOWER, _TRIES = 1.02, 4


class Motion(NamedTuple):
    """How a move is asked for: what is the same of moves that one zone joins."""

    kind: type[ArmMotion]
    wobj: tuple[float, ...] | None  # pose of the work object in the world
    speed: float | None  # m/s
    turning: float  # rad/s at most
    duration: float | None  # s
    acceleration: float | None  # m/s²


@dataclass
class Group:
    """Moves that are passed within zones: one move of a program to several targets."""

    motion: Motion
    call: Call
    zone: float  # m, at all targets but the last
    last_zone: float
    targets: list[list[float]] = field(default_factory=list)
    via: list[list[float]] = field(default_factory=list)
    poses: list[Vector] = field(default_factory=list)  # (4, 4), in the world
    postures: list[Vector] = field(default_factory=list)  # of moves of axes
    configuration: str = ""  # that the last target asks for


class Controller:
    """An arm of a workcell that is told to move, wait and set signals.

    Attributes:
        moves: of a program, so far.
        time: that they take [s].
        signals: of the controller.
        configured: whether the configurations of targets count for moves of axes, and for lines.
    """

    def __init__(
        self, cell: Workcell, robot: str | None, signals: Signals, run: Run, check: Check
    ) -> None:
        """Take an arm of a workcell, which goes on with each move; the only one need not be named.

        ``signals`` are what inputs and outputs mean; ``run`` does planned moves, as :meth:`Workcell.stand` or
        :meth:`Workcell.run_plans`; ``check`` is looked at before each of them beside its reach.
        """
        self.cell, self.robot = cell, cell.robot_name(robot)
        self.signals, self._run, self._check = signals, run, check
        self.moves: list[Move] = []
        self.lines: dict[int, str] = {}
        self.time, self.seen = 0.0, dict[str, float]()
        self.configured = {"j": True, "l": True}
        self.acceleration: float | None = None
        # of VelSet: m/s, and the part of a speed that is gone
        self.fastest, self.share = (
            np.inf,
            1.0,
        )
        self._unknown = set[str]()  # signals of which nothing is known, each named once
        self._group: Group | None = None
        self._planner: Planner | None = None
        own = cell.robot(self.robot)
        self._flange, self._base = next(iter(own.model.tools)), own.base
        chain = cell.model.chain(self.robot, own.tools[self._flange])
        self._to_flange = RigidTransform(chain.home).inverse()
        self._named = cell.config.only_robot is None

    @property
    def arm(self) -> Planner:
        """What plans its moves from where it is."""
        if self._planner is None:
            self._planner = self.cell.planning(self.robot)
        return self._planner

    def frame(self, wobj: RecordValue | None) -> tuple[float, ...] | None:
        """Return a work object's pose in the world, None for the world; raises LeftOut: one that is held or moved."""
        frame = self._base
        if wobj is not None:
            if wobj["robhold"] or (wobj["ufmec"] and not wobj["ufprog"]):
                raise LeftOut(
                    message(
                        "rapid.moving_work_object",
                        "a work object that a robot or another unit moves is not done",
                    )
                )
            frame = frame @ transform_of(wobj["uframe"]) @ transform_of(wobj["oframe"])
        if frame.IsNearlyEqualTo(RigidTransform(), _NEAR):
            return None
        return _numbers(frame)

    def cannot_begin_with(self, call: Call, motion: Motion, target: Sequence[float]) -> bool:
        """Tell whether a move to a pose (6,) is the first, and cannot be made from where the arm stands in its file."""
        if self._group is not None or any(isinstance(move, ArmMotion) for move in self.moves):
            return False
        try:
            motion.kind(**self._keys(Group(motion, call, 0.0, 0.0, [list(target)]))).plan(self.arm)
        except (SpeedLimitExceeded, AccelerationLimitExceeded):
            return False
        except SimrobError:
            return True
        return False

    def take_tool(self, tool: RecordValue) -> None:
        """Use the tool centre point of a tool; raises LeftOut: a tool that the robot does not hold."""
        if not tool["robhold"]:
            raise LeftOut(message("rapid.stationary_tool", "a tool that stands still is not done"))
        desired, whose = transform_of(tool["tframe"]), self.robot if self._named else None
        if (self._to_flange @ RigidTransform(self.arm.chain.home)).IsNearlyEqualTo(
            desired, _SAME_PLACE
        ):
            return
        self.finish()
        if self.cell.model.tool_in_use(self.robot) != self._flange:
            self._do(ToolMove(name=self._flange, robot=whose))
        change = (self._to_flange @ RigidTransform(self.arm.chain.home)).inverse() @ desired
        if not change.IsNearlyEqualTo(RigidTransform(), _NEAR):
            unchecked: dict[str, Any] = {"pose": _numbers(change), "robot": whose}
            self._do(ToolMove(**unchecked))

    def go(
        self, call: Call, motion: Motion, target: Sequence[float], zone: float, **more: Any
    ) -> None:
        """Take up an instruction's move to a pose (6,) [m, rad] or posture (n,), joined to the last by its zone.

        The zone is how near to the target the tool turns to the next one [m]; 0 to rest there. ``more`` has the
        ``pose`` of the tool in the world (4, 4), the ``posture`` of a move of axes, ``via`` of an arc, the
        ``configuration`` of a line's end.
        """
        group = self._group
        joins = group is not None and group.motion == motion and motion.duration is None
        if group is None or not joins or (len(group.targets) > 1 and group.last_zone != group.zone):
            if group is not None:
                group.call.remark(
                    message(
                        "rapid.rests_at_target",
                        "rests at its target: another kind of move, or another speed or zone, follows",
                    ),
                    lost=False,
                )
            self.finish()
            group = self._group = Group(motion, call, zone, zone)
        elif len(group.targets) == 1:
            group.zone = group.last_zone
        group.last_zone, group.call = zone, call
        group.targets.append(list(target))
        group.configuration = more.get("configuration", "")
        for key, rows in (("pose", group.poses), ("posture", group.postures), ("via", group.via)):
            if key in more:
                rows.append(more[key])
        if not zone or motion.duration is not None:
            self.finish()

    @property
    def ahead(self) -> Vector:
        """Where the moves that are taken up lead, shape (n,) [rad or m]."""
        if self._group and self._group.postures:
            return self._group.postures[-1]
        self.finish()
        return np.asarray(self.cell.reference(self.robot))

    def finish(self) -> None:
        """Plan and do what was taken up; a move that the robot cannot make is left out, and told."""
        group, self._group = self._group, None
        if group is None:
            return
        try:
            kind, keys = group.motion.kind, self._keys(group)
            if kind is MoveJ and not self._nearest(group):
                kind, keys["targets"] = MoveAbsJ, group.postures
                keys.pop("wobj", None)
                group.call.remark(
                    message(
                        "rapid.other_posture",
                        "goes to another posture than the nearest: written as move_abs_j",
                    ),
                    lost=False,
                )
            targets = [list(map(float, row)) for row in keys.pop("targets")]
            keys["targets"] = targets[0] if len(targets) == 1 else targets
            if kind is MoveC:
                keys["via"] = group.via[0] if len(group.via) == 1 else group.via
            move, plan = self._planned(kind, keys, group)
            if kind in (MoveL, MoveC):
                desired, chain = group.configuration, self.arm.chain
                if self.configured["l"] and desired and has_configuration(chain):
                    found = str(list(configuration(chain, plan.end)))
                    if found != desired:
                        group.call.remark(
                            message(
                                "rapid.other_configuration",
                                "comes to its target with configuration {found}, not {desired}",
                                found=found,
                                desired=desired,
                            ),
                            lost=False,
                        )
            self.lines[len(self.moves)] = group.call.task.where(group.call.node)
            self._do(move, plan)
        except SimrobError as problem:
            joined = (
                message(
                    "rapid.targets_joined",
                    ", with the {count} before that its zones join",
                    count=len(group.targets) - 1,
                )
                if len(group.targets) > 1
                else ""
            )
            # not positions of the tool
            are_targets_postures = bool(group.postures) and not group.poses
            hint = "" if are_targets_postures else metres_hint(np.array(group.targets)[:, :3])
            group.call.remark(
                message(
                    "rapid.move_left_out",
                    "{problem}{hint}; left out{joined}",
                    problem=problem,
                    hint=hint,
                    joined=joined,
                )
            )

    def _keys(self, group: Group) -> dict[str, Any]:
        motion = group.motion
        keys: dict[str, Any] = {
            "targets": group.targets,
            "wobj": motion.wobj,
            "duration": motion.duration,
        }
        if motion.duration is None:
            keys |= {"speed": motion.speed, "acceleration": motion.acceleration}
        if self._named:
            keys["robot"] = self.robot
        if self._check != CHECKED:
            keys["check"] = self._check
        if len(group.targets) > 1:
            keys |= self._zone(group)
        return {key: value for key, value in keys.items() if value is not None}

    def _zone(self, group: Group) -> dict[str, Any]:
        """Return the zone of a group, as small as its ways ask for; without one it rests at each target."""
        rows = group.poses or [self.arm.chain.forward(posture)[0] for posture in group.postures]
        places = np.array([self.arm.pose[:3, 3], *(pose[:3, 3] for pose in rows)])
        half = 0.499 * float(np.linalg.norm(np.diff(places, axis=0), axis=1).min())
        zone = min(group.zone, half)
        if zone < _ZONE:
            group.call.remark(
                message(
                    "rapid.rests_at_targets",
                    "rests at its targets: they are too near to each other for a zone",
                ),
                lost=False,
            )
            return {"stop": True} if group.motion.kind in (MoveJ, MoveAbsJ) else {}
        millimetres = round(1e3 * zone)
        named = abs(1e3 * zone - millimetres) < 1e-9 and 1 <= millimetres <= 200
        return {"zone": f"z{millimetres}" if named else "z0" if zone == _ZONE else zone}

    def _planned(
        self, kind: type[ArmMotion], keys: dict[str, Any], group: Group
    ) -> tuple[ArmMotion, Plan]:
        """Return a move with its plan, slower than asked for where axes or the tool's turn need more time."""
        for _ in range(_TRIES):
            move = kind(**keys)
            try:
                plan = move.plan(self.arm)
            except (SpeedLimitExceeded, AccelerationLimitExceeded) as problem:
                if group.motion.duration is not None:
                    raise
                group.call.remark(
                    message(
                        "rapid.slower_than_asked",
                        "is slower than asked for: {axis} is at its limit",
                        axis=problem.axis,
                    ),
                    lost=False,
                )
                keys = _in_time(keys, problem.duration)
                continue
            turning = self._turn(group) / group.motion.turning
            if plan.duration >= turning - SHORTEST or group.motion.duration is not None:
                return move, plan
            keys = _in_time(keys, turning)
        return move, move.plan(self.arm)

    def _turn(self, group: Group) -> float:
        rows = group.poses or [self.arm.chain.forward(posture)[0] for posture in group.postures]
        turns = [self.arm.pose[:3, :3], *(pose[:3, :3] for pose in rows)]
        return float(sum(turned_by(one, other) for one, other in pairwise(turns)))

    def _nearest(self, group: Group) -> bool:
        """Tell whether a move of axes goes to the nearest postures for its poses."""
        solutions = self.arm.inverse(None).solve(np.array(group.poses), self.arm.start)
        away = np.abs(solutions.positions - np.array(group.postures)).max()
        return bool(solutions.reached.all() and away < _SAME)

    def posture(self, call: Call, target: RecordValue, pose: Vector) -> Vector:
        """Find the posture (n,) [rad or m] of the arm for a target of a call.

        A target states a configuration: the quadrants of some axes, which select one of the postures that reach it. It
        counts if the program has not switched configurations off (ConfJ), and the robot has axes with quadrants.
        Otherwise the posture that is nearest to the start of the move is taken.

        Args:
            call: the call, which gets remarks.
            target: the ``robtarget``.
            pose: pose of the tool at the target in the world, shape (4, 4).

        Raises:
            LeftOut: no posture reaches the target, or none with its configuration.
        """
        arm = self.arm
        start = self.ahead  # the posture from which the move begins
        if self.configured["j"] and has_configuration(arm.chain):
            desired = [int(value) for value in target["robconf"].flat()]
            found, other_configurations = postures_like(arm.chain, pose, start, desired)
            if len(found):
                reached = list(configuration(arm.chain, found[0]))
                if reached != desired:
                    text = message(
                        "rapid.configuration_stands_for",
                        "comes to its target with configuration {reached}, which stands for {desired}",
                        reached=reached,
                        desired=desired,
                    )
                    call.remark(text, lost=False)
                return np.asarray(found[0])
            if other_configurations:
                listed = ", ".join(other_configurations)
                raise LeftOut(
                    message(
                        "rapid.only_configurations",
                        "a target with configuration {desired}, which has only {known}",
                        desired=desired,
                        known=listed,
                    )
                )
            # No posture at all reaches the target: below, the solver raises the error that says how near it came.
        elif self.configured["j"]:
            call.remark(
                message(
                    "rapid.configurations_mean_nothing",
                    "configurations mean nothing to this robot: the nearest posture is taken",
                ),
                lost=False,
            )
        try:
            return np.asarray(
                require(arm.inverse(None).solve(pose[np.newaxis], start), "target")[0]
            )
        except Unreachable as problem:
            hint = metres_hint(transform_of(target).translation())
            raise LeftOut(f"{problem}{hint}") from problem

    def _do(self, move: Move, plan: Plan | None = None) -> None:
        if len(self.moves) >= _MOST_MOVES:
            raise WrongType(
                message(
                    "rapid.endless_moves",
                    "the program does not end within {most} moves",
                    most=_MOST_MOVES,
                )
            )
        if isinstance(move, WaitMove) and self.moves and isinstance(self.moves[-1], WaitMove):
            self.moves[-1] = WaitMove(duration=self.moves[-1].duration + move.duration)
        else:
            self.moves.append(move)
        self._planner = None
        done = self._run([plan], None) if plan else move.perform(self.cell, self.robot, self._run)
        self.time += (
            done if isinstance(done, float) else float(done.times[-1]) if done is not None else 0.0
        )
        names: Mapping[str, int] = {
            name: column for column, name in enumerate(getattr(done, "names", ()))
        }
        self.seen |= {
            name: float(done.values[-1, names[name]])
            for name in self.signals.sensors
            if name in names
        }

    def wait(self, duration: float) -> None:
        """Let time pass [s]."""
        self.finish()
        if duration >= SHORTEST:
            self._do(WaitMove(duration=duration))

    def put(self, call: Call, name: str, value: float) -> None:
        """Set an output, and do what that means."""
        self.finish()
        does = self.signals.put(name, value)
        if does is None:
            self._remark_unnamed_signal(
                call,
                message("rapid.unknown_output", "nothing is known of the output {name}", name=name),
                lost=False,
            )
        for move in does or ():
            self._do(move)

    def read(self, call: Call, name: str) -> float:
        """Return the value of a signal; 0 if nothing tells."""
        self.finish()
        value = self.signals.value(name, self.time, self.seen)
        if value is None and self.signals.watches(name):
            self.wait(10 * SHORTEST)
            value = self.signals.value(name, self.time, self.seen)
        if value is None:
            self._remark_unnamed_signal(
                call,
                message(
                    "rapid.unknown_input",
                    "nothing is known of the input {name}, it is taken as 0",
                    name=name,
                ),
                lost=True,
            )
            return 0.0
        return value

    def _remark_unnamed_signal(self, call: Call, problem: str, *, lost: bool) -> None:
        """Remark, once for each signal, that the user's table (option --io) does not name it, and where to name it.

        Args:
            call: the call that uses the signal.
            problem: the problem in words, with the signal's name.
            lost: whether something is not done because of it.
        """
        # RAPID does not distinguish capital and small letters, so a signal may have been reported in other letters.
        if problem.lower() not in self._unknown:
            self._unknown.add(problem.lower())
            call.remark(
                message(
                    "rapid.name_in_table", "{problem}: name it in a table, --io", problem=problem
                ),
                lost=lost,
            )


def metres_hint(places: Vector) -> str:
    """Write a question for positions that the robot cannot reach, if their numbers may have been meant in metres.

    Args:
        places: positions, shape (..., 3) [m].

    Returns:
        the question, to be appended to a message. It is empty if a coordinate is too large for metres, or if all
        positions are the origin, which is the same in both units.
    """
    are_all_zero = not np.any(places)
    if are_all_zero or np.abs(places).max() > _REACH_IN_METRES:
        return ""
    return message(
        "rapid.were_these_metres", "; lengths of RAPID are in millimetres: were these metres?"
    )


def _numbers(pose: RigidTransform) -> tuple[float, ...]:
    return tuple((pose_from_transform(pose) + 0.0).tolist())  # no -0


def _in_time(keys: dict[str, Any], duration: float) -> dict[str, Any]:
    kept = {
        key: value
        for key, value in keys.items()
        if key not in ("speed", "acceleration", "duration")
    }
    kept.pop("stop", None)
    return {
        **kept,
        "duration": max(duration, keys.get("duration", 0.0) * _SLOWER),
        "profile": "s_curve",
    }
