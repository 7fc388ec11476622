"""A station for geometry queries: it is set to given positions and never simulated.

A *posture* of a robot is the vector of the positions of its axes (n,), in rad or m. The positions (nq,) of the
*plant*, Drake's MultibodyPlant, cover all robots and free pieces. A *piece* is a body that is no robot, such as a
table or a workpiece.
"""

from collections.abc import Callable, Mapping

import numpy as np
from pydrake.geometry import (
    CollisionFilterDeclaration,
    GeometryId,
    GeometrySet,
    QueryObject,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame
from pydrake.systems.framework import DiagramBuilder

from simrob_drake.base.frames import Vector
from simrob_drake.base.lifetime import build_diagram
from simrob_drake.parts.station_plant import StationPlant, StationRobot
from simrob_drake.parts.targets import owner_of_shape
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.plant import add_plant
from simrob_drake.stations.resolve import resolve


class PosedStation:
    """Robots, pieces and floor of a station at any positions, for geometry queries.

    Attributes:
        resolved: the station's configuration with the models of its robots and pieces.
        station: Drake's plant and scene graph, with the robots and pieces of the station in them.
        plant: Drake's plant, the same as `station.plant`.
        context: the plant's context, which holds the present positions.
        initial: positions at the start, shape (nq,) [rad or m, quaternions for free bodies].
    """

    def __init__(
        self,
        config: StationConfig,
        add: Callable[[DiagramBuilder, StationPlant], None] = lambda *_: None,
    ) -> None:
        """Build the station in its initial configuration.

        Args:
            config: the station.
            add: callback that adds further systems to the diagram before the diagram is built. By default nothing is
                added.

        Raises:
            SimrobError: the station has a defect, such as a robot that cannot be built.
        """
        builder = DiagramBuilder()
        self.resolved = resolve(config)
        self.station = add_plant(builder, self.resolved)
        self.plant: MultibodyPlant = self.station.plant

        # Usually the plant in the diagram gives the poses of its shapes to the scene graph. Two cases differ:
        # The plant of a kinematic station is not part of the diagram, so an extra system computes the poses. The
        # positions are fixed at the input port of that system.
        # Another engine, such as MuJoCo, has its own model in the diagram, whose positions are set separately.
        is_dynamic = config.engine.moves_by_forces
        self._positions_port = None if is_dynamic else self.station.add_geometry_poses(builder)
        add(builder, self.station)
        self._diagram = build_diagram(builder)
        self._root_context = self._diagram.CreateDefaultContext()
        own_context = self.plant.CreateDefaultContext()  # of the plant alone
        is_plant_in_diagram = is_dynamic and self.station.stand_in is None
        if is_plant_in_diagram:
            self.context = self.plant.GetMyMutableContextFromRoot(self._root_context)
        else:
            self.context = own_context
        self.initial: Vector = self.plant.GetPositions(own_context)
        self.place(self.initial)

    def place(self, positions: Vector) -> None:
        """Set the positions of the plant, shape (nq,) [rad or m; quaternions of free bodies], and move all shapes."""
        self.plant.SetPositions(self.context, positions)
        if self.station.stand_in is not None:
            self.station.set_positions(self._root_context, positions)
        if self._positions_port is not None:
            system = self._positions_port.get_system()
            context = system.GetMyMutableContextFromRoot(self._root_context)
            self._positions_port.FixValue(context, positions)

    def pose(self, frame: Frame) -> RigidTransform:
        """Pose of a frame in the world at the present positions."""
        return frame.CalcPoseInWorld(self.context)

    def place_robots(self, postures: Mapping[str, Vector]) -> None:
        """Move some robots; the other robots and the pieces that are not carried stay where they are.

        Couplings between axes are not considered: each axis gets the position that its posture gives.

        Args:
            postures: the new posture (n,) [rad or m] of each robot that moves, by the robot's name.
        """
        # The context of the plant collects the postures. `place` then moves the shapes where another system poses them.
        for name, posture in postures.items():
            axis_map = self.station.robots[name].axis_map
            axis_map.set_positions(self.plant, self.context, posture)
        self.place(self.plant.GetPositions(self.context))

    @property
    def holders(self) -> Mapping[str, str]:
        """Name of the robot whose fingers hold a piece, for each piece that is held.

        The keys are the names of the pieces. The mapping is empty here: a subclass in which grippers close on pieces
        overrides this property.
        """
        return {}

    def owner(self, shape: GeometryId) -> str:
        """Name of the body that a shape belongs to: a piece, a robot's link, the floor or a terrain box."""
        return owner_of_shape(self.station, shape)

    def query(self) -> QueryObject:
        """Drake's query object for the geometry at the present positions."""
        return self.station.query(self._root_context)

    def ignore_nearer_than(self, distance: float) -> None:
        """Leave out, in all later queries, the pairs of shapes that are close together at the present positions.

        They no longer appear in collision and distance queries, at whatever positions.

        Args:
            distance: largest signed distance of such a pair [m].
        """
        scene = self.station.scene_graph
        # Filters in the context, as those of the model would need a new context.
        context = scene.GetMyMutableContextFromRoot(self._root_context)
        filters = scene.collision_filter_manager(context)
        near_pairs = self.query().ComputeSignedDistancePairwiseClosestPoints(distance)
        for pair in near_pairs:
            first = GeometrySet(pair.id_A)
            second = GeometrySet(pair.id_B)
            declaration = CollisionFilterDeclaration()
            filters.Apply(declaration.ExcludeBetween(first, second))


def posture_range(robot: StationRobot) -> tuple[Vector, Vector]:
    """Lower and upper bounds of a robot's random postures, each of shape (n,) [rad or m].

    The bounds are the limits of the axes. Since an axis may have no limits, they are at most half a turn from zero, or
    one metre for a prismatic axis. The bounds of an axis whose whole range is farther away than that begin at the limit
    that is nearest to zero, and span at most one turn, or two metres.
    """
    farthest = np.where(robot.model.prismatic, 1.0, np.pi)
    lower, upper = robot.model.axis_limits
    # The range is cut to -farthest … farthest or, if it lies outside of that, to a window of the same width at its end.
    window_lower = np.where(lower > farthest, lower, -farthest)
    window_upper = np.where(lower > farthest, lower + 2 * farthest, farthest)
    is_below = upper < -farthest
    window_lower = np.where(is_below, upper - 2 * farthest, window_lower)
    window_upper = np.where(is_below, upper, window_upper)
    return np.clip(lower, window_lower, window_upper), np.clip(upper, window_lower, window_upper)


def random_posture(robot: StationRobot, random: np.random.Generator) -> Vector:
    """Draw a random posture (n,) [rad or m], each axis uniformly between the bounds of :func:`posture_range`.

    The fingers of a gripper do not move independently: all are open by the same random fraction of their stroke. Other
    couplings between axes are not considered.
    """
    lower, upper = posture_range(robot)
    posture = random.uniform(lower, upper)
    if robot.model.fingers:
        fraction = random.uniform()
        # The mapping has the closed and the open position for the index of each finger's axis.
        for axis, (closed, opened) in robot.model.fingers.items():
            posture[axis] = closed + fraction * (opened - closed)
    return posture
