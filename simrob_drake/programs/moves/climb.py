"""Move a robot with legs over stairs, gaps and thresholds, stride by stride.

A stride brings all feet ahead once. Its footholds are chosen on the ground as the station has it, and it is planned
from where the feet stand after the stride before. The frame of the climb has its origin in the middle of the feet at
the start and its x axis in the direction in which they look. A *foothold* is the place to which a foot goes.

A program is checked as a whole before it runs. The *outlook* is the station as it will be before a move, and the
*stage* of a move is the function that performs it later.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np
from pydantic import ConfigDict

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import compound, message
from simrob_drake.base.sections import Positive
from simrob_drake.programs.gaits.biped import FEET
from simrob_drake.programs.gaits.climb import Climb, has_edges
from simrob_drake.programs.gaits.climb_footholds import (
    BallFootholds,
    Footholds,
    FootPositions,
    SoleFootholds,
)
from simrob_drake.programs.gaits.registry import has_gait
from simrob_drake.programs.gaits.walker import UP, Foot, Walker, rotations_about
from simrob_drake.programs.geometry import LeggedGeometry
from simrob_drake.programs.legged_gait import perform, planned_gait
from simrob_drake.programs.moves.move import Move, Outlook, Stage, naming
from simrob_drake.results.result import SimulationResult, join_runs
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.resolve import resolve

_FARTHEST = 100.0  # longest distance of one move [m]
_ALIKE_DECIMALS = 3  # decimals to which two strides have to agree to count as alike [m]


class ClimbMove(Move):
    """Go ahead over ground that rises and falls. Further keys are parameters of the gait, and replace the gait's own.

    Footholds are chosen on the ground as the station has it, and each stride is planned from where the feet stand.
    """

    model_config = ConfigDict(extra="allow")
    key: ClassVar[str] = "climb"
    says: ClassVar[str] = "climb {it.distance:g} m"
    of_arms: ClassVar[bool] = False

    distance: Positive
    """Distance of the goal ahead of where the robot stands [m]."""
    gait: str = Climb.usual
    """Name of one of the climbs in the robot's `gaits.yaml`."""

    @classmethod
    def possible_keys(
        cls, config: StationConfig, robot: str, model: RobotModel
    ) -> frozenset[str] | None:
        """Keys that the pendant's input form offers for this move, without the parameters of the gait.

        See :meth:`Move.possible_keys`.

        Returns None if the robot cannot climb: its `gaits.yaml` lacks the usual climb, or its soles have no edges.
        """
        worn = config.robots[robot].feet
        possible = has_gait(model, Climb, Climb.usual) and has_edges(model, worn)
        return frozenset(cls.model_fields) if possible else None

    def stage(self, robot: LeggedGeometry, outlook: Outlook, name: str) -> Stage:
        """Check that the robot can stride on level ground, and return the stage that climbs.

        The ground is not checked before the stage begins, because earlier moves decide where the robot stands then. The
        outlook is marked as changed, because where the climb ends is not known before.

        Args:
            robot: the robot.
            outlook: the station as it will be before the move.
            name: name of the move for messages.

        Raises:
            InvalidParameter: the distance is too long for one move.
            SimrobError: the robot cannot make such a stride.
        """
        changes = self.model_extra or {}
        if self.distance > _FARTHEST:
            raise InvalidParameter(
                "distance",
                compound("{distance:g} m", distance=self.distance),
                message(
                    "programs.farthest_climb",
                    "at most {farthest:g} m in one move",
                    farthest=_FARTHEST,
                ),
            )
        # One stride on level ground finds wrong parameters and legs that are too short before any move runs.
        planned_gait(robot, self.gait, changes, station=outlook.station)
        outlook.changed = True

        def run_stage(robot: LeggedGeometry) -> SimulationResult | None:
            """Climb from where the robot stands, with one run for each stride, and join the runs.

            Returns None if the robot is at the goal already.

            Raises:
                SimrobError: a stride to the goal is not possible. If it is found before the first one, nothing moves.
            """
            with naming(name):
                gait = Climb.of(Walker.of(robot.model), self.gait, changes)
                path = ClimbPath.of(robot, gait, self.distance)
                # Plan all strides before the first one, so that an impossible one is found at once. With `bends` the
                # hips may be lower where the legs are too short, as on stairs.
                for position, stride in path.expected_strides(robot).items():
                    with naming(
                        message("programs.place_ahead", "{place:.2f} m ahead", place=position)
                    ):
                        planned_gait(robot, self.gait, {**changes, **stride}, bends=True)
            # A monitor or the user may end a stride early: then no further stride follows.
            runs = list[SimulationResult]()
            while not runs or runs[-1].ending == "completed":
                stride = path.next_stride(path.current_stance(robot))
                if not stride:
                    break
                with naming(name):
                    motion = planned_gait(robot, self.gait, {**changes, **stride}, bends=True)
                runs.append(perform(robot, motion))
            return replace(join_runs(runs), did=self.caption()) if runs else None

        return run_stage


class ClimbStance(NamedTuple):
    """Positions of the feet and the trunk in the frame of a climb.

    Attributes:
        feet: ahead [m], left [m] and turn [rad] of each foot, by its name, shape (3,).
        trunk_turn: turn of the trunk to the left [rad].
    """

    feet: FootPositions
    trunk_turn: float


StrideParameters = dict[str, Any]
"""Parameters of the gait for one stride; empty at the goal. Positions are in the frame of the climb.

`start` and `goals` are poses of the feet before and after the stride, by name: ahead, left and up [m], and the turn to
the left [rad]. `over` is the height of the highest ground on the way [m], `turned` the turn of the trunk to the left at
the start [rad]. Heights are above the lowest foot at the start.
"""


@dataclass(frozen=True)
class ClimbPath:
    """The straight path of a climb.

    Attributes:
        gait: parameters of the climb.
        feet: feet of the robot by name.
        facing: direction in which the robot looks while its root is not turned, from the world's x to the left [rad].
        origin: middle of the feet at the start in the world, horizontal, shape (2,) [m].
        heading: direction of the path, from the world's x to the left [rad].
        footholds: choice of the footholds on the ground ahead.
    """

    gait: Climb
    feet: Mapping[str, Foot]
    facing: float
    origin: Vector
    heading: float
    footholds: Footholds

    @classmethod
    def of(cls, robot: LeggedGeometry, gait: Climb, distance: float) -> "ClimbPath":
        """Lay the path ahead of a robot from where it stands.

        Args:
            robot: the robot.
            gait: parameters of the climb.
            distance: distance of the goal ahead of the middle of the feet [m].
        """
        walker = Walker.of(robot.model)
        feet = {foot.name: foot for foot in walker.feet(gait.feet)}
        # Poses of the feet in the world, shape (4, 4). A foot computes them for several postures, here for one.
        poses = [
            foot.poses(robot.position[np.newaxis], _root_pose(robot))[0] for foot in feet.values()
        ]
        origin = np.mean([pose[:2, 3] for pose in poses], axis=0)
        # The first column of a pose is where the foot looks. The climb goes in the mean direction of all feet.
        ahead = np.mean([pose[:2, 0] for pose in poses], axis=0)
        heading = float(np.arctan2(ahead[1], ahead[0]))
        to_world = _rotation(heading)
        ground = resolve(robot.cell.config).ground
        trunk_height = float(robot.base_pose.translation()[2])

        def height(positions: Vector) -> Vector:
            """Height of the ground at positions (k, 2) [m] in the frame of the climb, shape (k,) [m].

            Ground that is higher than the trunk now does not count.
            """
            # Ground above the trunk is a roof, not a floor to stand on.
            in_world = origin + positions @ to_world.T
            return ground.beneath(
                np.column_stack([in_world, np.full(len(positions), trunk_height)])
            )

        facing = np.deg2rad(walker.gaits.facing_deg)
        # Robots on two feet stand on soles. FEET are the names of the two, of which only the count matters here.
        kind = SoleFootholds if len(feet) == len(FEET) else BallFootholds
        footholds = kind(gait, feet, height, distance)
        return cls(gait, feet, facing, origin, heading, footholds)

    def current_stance(self, robot: LeggedGeometry) -> ClimbStance:
        """Compute where the feet and the trunk of the robot are now, in the frame of the climb."""
        to_world = _rotation(self.heading)
        positions = {}
        for name, foot in self.feet.items():
            pose = foot.poses(robot.position[np.newaxis], _root_pose(robot))[0]
            # Only the horizontal part of the foot's x axis counts: feet may be tilted.
            turn = float(np.arctan2(pose[1, 0], pose[0, 0])) - self.heading
            # For a row vector, the product with the rotation turns from the world into the frame of the climb.
            horizontal = (pose[:2, 3] - self.origin) @ to_world
            positions[name] = np.array([*horizontal, turn])
        # The direction in which the trunk looks, relative to that of the path.
        root = robot.base_pose.rotation().matrix()
        trunk_turn = float(np.arctan2(root[1, 0], root[0, 0])) + self.facing - self.heading
        return ClimbStance(positions, trunk_turn)

    def next_stride(self, stance: ClimbStance) -> StrideParameters:
        """Compute the parameters of the next stride.

        Args:
            stance: where the feet and the trunk are.

        Returns:
            Parameters of the gait, see :data:`StrideParameters`. They are empty if the robot is at the goal.

        Raises:
            InvalidParameter: the ground ahead has no foothold, or a foot stands on ground that is not level.
        """
        stride = self.footholds.next(stance.feet)
        if stride is None:
            return {}
        # The gait counts heights from the lowest foot.
        heights = {name: self.footholds.height(position) for name, position in stance.feet.items()}
        lowest = min(heights.values())
        start = {}
        for name, position in stance.feet.items():
            start[name] = (*position[:2], heights[name] - lowest, _within_half_turn(position[2]))
        goals = {}
        for name, goal in stride.goals.items():
            # Feet land looking along the path, so that errors of their turn do not add up.
            goals[name] = (*goal[:2], stride.heights[name] - lowest, 0.0)
        return {
            "start": start,
            "goals": goals,
            "over": max(stride.over - lowest, 0.0),
            "turned": _within_half_turn(stance.trunk_turn),
        }

    def expected_strides(self, robot: LeggedGeometry) -> dict[float, StrideParameters]:
        """Compute the strides to the goal if every foot lands where it is planned to.

        Of strides that are alike, such as those on level ground, only the first one is returned.

        Returns:
            Parameters of the strides, by the position ahead of the climb's origin where each begins [m].

        Raises:
            InvalidParameter: see :meth:`next_stride`.
        """
        stance = self.current_stance(robot)
        known = set[tuple[float, ...]]()
        strides = dict[float, StrideParameters]()
        while stride := self.next_stride(stance):
            start = {name: np.array(pose) for name, pose in stride["start"].items()}
            goals = {name: np.array(pose) for name, pose in stride["goals"].items()}
            # Two strides are alike if each foot goes as far ahead and up, and over ground of the same height.
            changes = []
            for name, goal in goals.items():
                changes += [goal[0] - start[name][0], goal[2] - start[name][2]]
            likeness = tuple(np.round([*changes, stride["over"]], _ALIKE_DECIMALS).tolist())  # [m]
            if likeness not in known:
                begin = float(np.mean([position[0] for position in stance.feet.values()]))
                strides[begin] = stride
            known.add(likeness)
            without_height = [0, 1, 3]  # of ahead, left, up and turn
            landed = {name: goal[without_height] for name, goal in goals.items()}
            # Every stride turns the trunk back to the direction of the path.
            stance = ClimbStance(landed, trunk_turn=0.0)
        return strides


def _root_pose(robot: LeggedGeometry) -> Vector:
    """Pose of the root link in the world now, shape (1, 4, 4): an array of one pose, as `Foot.poses` takes it."""
    return np.asarray(robot.base_pose.GetAsMatrix4())[np.newaxis]


def _rotation(heading: float) -> Vector:
    """Rotation of the plane by a heading [rad], shape (2, 2): from the frame of the climb to the world."""
    return np.asarray(rotations_about(UP, np.array([heading]))[0, :2, :2])


def _within_half_turn(turn: float) -> float:
    """Add whole turns to an angle so that it is between -pi and pi [rad]."""
    return float(np.remainder(turn + np.pi, 2 * np.pi) - np.pi)
