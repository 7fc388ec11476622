"""Over stairs, gaps and thresholds, stride by stride."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from pydantic import ConfigDict

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import compound, message
from simrob_drake.base.sections import Positive
from simrob_drake.programs.gaits.biped import SIDES
from simrob_drake.programs.gaits.climb import BallFootholds, Climb, Footholds, Places, SoleFootholds, has_edges
from simrob_drake.programs.gaits.registry import has_gait
from simrob_drake.programs.gaits.walker import UP, Foot, Walker, rotations_about
from simrob_drake.programs.geometry import LeggedGeometry
from simrob_drake.programs.legged_gait import perform, planned_gait
from simrob_drake.programs.moves.move import Move, Outlook, Stage, naming
from simrob_drake.results.result import SimulationResult, joined
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.resolve import resolve

_FARTHEST = 100.0  # m


class ClimbMove(Move):
    """Ahead over ground that rises and falls; keys beside these are parameters of the gait in place of its own.

    Footholds are chosen on the ground as the station has it, and each stride is planned from where the feet stand.
    """

    model_config = ConfigDict(extra="allow")
    key: ClassVar[str] = "climb"
    says: ClassVar[str] = "climb {it.distance:g} m"
    of_arms: ClassVar[bool] = False

    distance: Positive
    """How far ahead of where it stands [m]."""
    gait: str = Climb.usual
    """One of the climbs of the robot's `gaits.yaml`."""

    @classmethod
    def possible_keys(cls, config: StationConfig, robot: str, model: RobotModel) -> frozenset[str] | None:
        """Return the keys that the move may have for a robot of a station, without the parameters of its gait.

        Returns:
            None if the robot cannot climb: its `gaits.yaml` lacks the usual climb, or its soles have no edges.
        """
        worn = config.robots[robot].feet
        possible = has_gait(model, Climb, Climb.usual) and has_edges(model, worn)
        return frozenset(cls.model_fields) if possible else None

    def stage(self, robot: LeggedGeometry, outlook: Outlook, name: str) -> Stage:
        """Check that the robot can stride so on level ground, and return the stage that looks for footholds then."""
        own = self.model_extra or {}
        if self.distance > _FARTHEST:
            raise InvalidParameter(
                "distance",
                compound("{distance:g} m", distance=self.distance),
                message("programs.farthest_climb", "at most {farthest:g} m at once", farthest=_FARTHEST),
            )
        planned_gait(robot, self.gait, own, station=outlook.station)
        outlook.changed = True

        def go(robot: LeggedGeometry) -> SimulationResult | None:
            with naming(name):
                path = ClimbPath.of(robot, Climb.of(Walker.of(robot.model), self.gait, own), self.distance)
                for place, aim in path.foreseen(robot).items():
                    with naming(message("programs.place_ahead", "{place:.2f} m ahead", place=place)):
                        planned_gait(robot, self.gait, {**own, **aim}, bends=True)
            runs = list[SimulationResult]()
            while not (runs and runs[-1].ending != "completed") and (aim := path.aim(*path.seen(robot))):
                with naming(name):
                    motion = planned_gait(robot, self.gait, {**own, **aim}, bends=True)
                runs.append(perform(robot, motion))
            return replace(joined(runs), did=self.caption()) if runs else None

        return go


@dataclass(frozen=True)
class ClimbPath:
    """The way of a climb: where it begins, where it leads, and the ground there."""

    gait: Climb
    feet: Mapping[str, Foot]
    facing: float  # of the root, where it is not turned, from the world's x [rad]
    origin: Vector  # between the feet in the world, shape (2,) [m]
    heading: float  # from the world's x [rad]
    footholds: Footholds

    @classmethod
    def of(cls, robot: LeggedGeometry, gait: Climb, distance: float) -> "ClimbPath":
        """Return the way ahead of a robot that stands; raises InvalidParameter: it leads to no foothold."""
        walker = Walker.of(robot.model)
        feet = {foot.name: foot for foot in walker.feet(gait.feet)}
        poses = [foot.poses(robot.position[np.newaxis], _root(robot))[0] for foot in feet.values()]
        ahead = np.mean([pose[:2, 0] for pose in poses], axis=0)
        origin, heading = np.mean([pose[:2, 3] for pose in poses], axis=0), float(np.arctan2(ahead[1], ahead[0]))
        turn, ground = _turn(heading), resolve(robot.cell.config).ground
        high = float(robot.base_pose.translation()[2])

        def height(places: Vector) -> Vector:
            return ground.beneath(np.column_stack([origin + places @ turn.T, np.full(len(places), high)]))

        facing = np.deg2rad(walker.gaits.facing_deg)
        kind = SoleFootholds if len(feet) == len(SIDES) else BallFootholds
        return cls(gait, feet, facing, origin, heading, kind(gait, feet, height, distance))

    def seen(self, robot: LeggedGeometry) -> tuple[Places, float]:
        """Return where the soles stand, and how the trunk is turned [rad]."""
        turn, places = _turn(self.heading), {}
        for name, foot in self.feet.items():
            pose = foot.poses(robot.position[np.newaxis], _root(robot))[0]
            own = float(np.arctan2(pose[1, 0], pose[0, 0])) - self.heading
            places[name] = np.array([*((pose[:2, 3] - self.origin) @ turn), own])
        root = robot.base_pose.rotation().matrix()
        return places, float(np.arctan2(root[1, 0], root[0, 0])) + self.facing - self.heading

    def aim(self, places: Places, turned: float = 0.0) -> dict[str, Any]:
        """Return the parameters of the stride from places of the soles and a turn of the trunk; none at the goal."""
        stride = self.footholds.next(places)
        if stride is None:
            return {}
        start = {name: self.footholds.height(place) for name, place in places.items()}
        low = min(start.values())
        return {
            "start": {name: (*place[:2], start[name] - low, _within(place[2])) for name, place in places.items()},
            "goals": {name: (*goal[:2], stride.heights[name] - low, 0.0) for name, goal in stride.goals.items()},
            "over": max(stride.over - low, 0.0),
            "turned": _within(turned),
        }

    def foreseen(self, robot: LeggedGeometry) -> dict[float, dict[str, Any]]:
        """Return the strides to the goal if feet land where they shall, by where they begin [m], alike ones once."""
        (places, turned), seen, found = self.seen(robot), set[tuple[float, ...]](), dict[float, dict[str, Any]]()
        while aim := self.aim(places, turned):
            start, goals = ({name: np.array(each) for name, each in aim[key].items()} for key in ("start", "goals"))
            change = [goals[name][axis] - start[name][axis] for name in goals for axis in (0, 2)]
            kind = tuple(np.round([*change, aim["over"]], 3).tolist())
            if kind not in seen:
                found[float(np.mean([place[0] for place in places.values()]))] = aim
            seen.add(kind)
            places, turned = {name: goal[[0, 1, 3]] for name, goal in goals.items()}, 0.0
        return found


def _root(robot: LeggedGeometry) -> Vector:
    return np.asarray(robot.base_pose.GetAsMatrix4())[np.newaxis]


def _turn(heading: float) -> Vector:
    """Return the rotation (2, 2) of the floor by a heading [rad]."""
    return np.asarray(rotations_about(UP, np.array([heading]))[0, :2, :2])


def _within(turn: float) -> float:
    """Return a turn as one between half turns to both sides [rad]."""
    return float(np.remainder(turn + np.pi, 2 * np.pi) - np.pi)
