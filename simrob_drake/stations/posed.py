"""A station that is set to given positions and never simulated."""

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

from simrob_drake.frames import Vector
from simrob_drake.lifetime import built
from simrob_drake.parts.site import StationPlant, StationRobot
from simrob_drake.parts.targets import owner_of_shape
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.plant import add_plant
from simrob_drake.stations.resolve import resolve


class PosedStation:
    """Robots, pieces and floor of a station at any positions, for geometry queries.

    Attributes:
        resolved: the station's resolved configuration.
        station: its plant with the robots.
        plant: Drake's own plant.
        context: the plant's context.
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
            add: callback that adds further systems to the diagram before the diagram is built.

        Raises:
            InvalidModel: a robot cannot be built.
        """
        builder = DiagramBuilder()
        self.resolved = resolve(config)
        self.station = add_plant(builder, self.resolved)
        self.plant: MultibodyPlant = self.station.plant

        # The plant of a kinematic station is not part of the diagram, so a separate system
        # gives the poses of its shapes to the scene graph. Another engine, such as MuJoCo,
        # has its own model, so its positions are set separately as well.
        is_dynamic = config.mode == "dynamic"
        self._positions_port = None if is_dynamic else self.station.add_geometry_poses(builder)
        add(builder, self.station)
        self._diagram = built(builder)
        self._scene = self._diagram.CreateDefaultContext()
        own_context = self.plant.CreateDefaultContext()
        if is_dynamic and self.station.engine is None:
            self.context = self.plant.GetMyMutableContextFromRoot(self._scene)
        else:
            self.context = own_context
        self.initial: Vector = self.plant.GetPositions(own_context)
        self.place(self.initial)

    def place(self, positions: Vector) -> None:
        """Set the positions of the plant, shape (nq,), and move all shapes accordingly."""
        self.plant.SetPositions(self.context, positions)
        if self.station.engine is not None:
            self.station.place(self._scene, positions)
        if self._positions_port is not None:
            system = self._positions_port.get_system()
            context = system.GetMyMutableContextFromRoot(self._scene)
            self._positions_port.FixValue(context, positions)

    def pose(self, frame: Frame) -> RigidTransform:
        """Pose of a frame in the world at the present positions."""
        return frame.CalcPoseInWorld(self.context)

    def place_robots(self, postures: Mapping[str, Vector]) -> None:
        """Set the postures (n,) [rad or m] of some robots, by name; the other robots do not move."""
        for name, posture in postures.items():
            axis_map = self.station.robots[name].axis_map
            axis_map.set_positions(self.plant, self.context, posture)
        self.place(self.plant.GetPositions(self.context))

    @property
    def holders(self) -> Mapping[str, str]:
        """Name of the robot whose fingers hold a piece, for each piece that is held.

        It is empty here; a model in which grippers close on pieces overrides this property.
        """
        return {}

    def owner(self, shape: GeometryId) -> str:
        """Name of the body that a shape belongs to: a piece, a robot's link, the floor or a terrain box."""
        return owner_of_shape(self.station, shape)

    def query(self) -> QueryObject:
        """Drake's query object for the geometry at the present positions."""
        return self.station.query(self._scene)

    def ignore_nearer_than(self, distance: float) -> None:
        """Permanently exclude all pairs of shapes that are nearer than a distance [m] at the present positions.

        The excluded pairs no longer appear in collision and distance queries.
        """
        scene = self.station.scene_graph
        context = scene.GetMyMutableContextFromRoot(self._scene)
        filters = scene.collision_filter_manager(context)
        near = self.query().ComputeSignedDistancePairwiseClosestPoints(distance)
        for pair in near:
            first = GeometrySet(pair.id_A)
            second = GeometrySet(pair.id_B)
            declaration = CollisionFilterDeclaration()
            filters.Apply(declaration.ExcludeBetween(first, second))


def posture_range(robot: StationRobot) -> tuple[Vector, Vector]:
    """Lower and upper bounds of a robot's random postures, each of shape (n,) [rad or m].

    The bounds are the limits of the axes, but at most half a turn or one metre to each side
    of zero, since an axis may have no limits.
    """
    most = np.where(robot.model.prismatic, 1.0, np.pi)
    lower, upper = robot.model.axis_limits
    return np.clip(lower, -most, most), np.clip(upper, -most, most)


def random_posture(robot: StationRobot, random: np.random.Generator) -> Vector:
    """Draw a random posture (n,) [rad or m]; all fingers are open by the same random fraction."""
    posture = random.uniform(*posture_range(robot))
    if robot.model.fingers:  # maps each finger's axis to its closed and its open position
        closed, opened = np.array([*robot.model.fingers.values()]).T
        fraction = random.uniform()
        posture[[*robot.model.fingers]] = closed + fraction * (opened - closed)
    return posture
