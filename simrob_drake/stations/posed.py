"""A station that is put into configurations, and never stepped."""

from collections.abc import Callable, Mapping

from pydrake.geometry import GeometryId, QueryObject
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame
from pydrake.systems.framework import DiagramBuilder

from simrob_drake.frames import Vector
from simrob_drake.lifetime import built
from simrob_drake.parts.site import StationPlant
from simrob_drake.parts.targets import owner_of_shape
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.plant import add_plant
from simrob_drake.stations.resolve import resolve


class PosedStation:
    """Robots, pieces and floor of a station, where they are told to be.

    Attributes:
        resolved: what it is made of.
        station: its plant, with the robots.
        plant: Drake's own.
        context: of the plant, in the present configuration.
        initial: the configuration at the start, shape (nq,).
    """

    def __init__(
        self, config: StationConfig, add: Callable[[DiagramBuilder, StationPlant], None] = lambda *_: None
    ) -> None:
        """Build the station in its initial configuration; ``add`` puts more into its diagram.

        Raises:
            InvalidModel: a robot that cannot be built.
        """
        builder = DiagramBuilder()
        self.resolved = resolve(config)
        self.station = add_plant(builder, self.resolved)
        self.plant: MultibodyPlant = self.station.plant
        stepped = config.mode == "dynamic"
        self._positions_port = None if stepped else self.station.add_geometry_poses(builder)
        add(builder, self.station)
        self._diagram = built(builder)
        self._scene = self._diagram.CreateDefaultContext()
        own = self.plant.CreateDefaultContext()
        inside = stepped and self.station.engine is None
        self.context = self.plant.GetMyMutableContextFromRoot(self._scene) if inside else own
        self.initial: Vector = self.plant.GetPositions(own)
        self.place(self.initial)

    def place(self, positions: Vector) -> None:
        """Put the station into a configuration, shape (nq,)."""
        self.plant.SetPositions(self.context, positions)
        if self.station.engine is not None:
            self.station.place(self._scene, positions)
        if self._positions_port is not None:
            poses = self._positions_port.get_system()
            self._positions_port.FixValue(poses.GetMyMutableContextFromRoot(self._scene), positions)

    def pose(self, frame: Frame) -> RigidTransform:
        """Return the pose of a frame in the world."""
        return frame.CalcPoseInWorld(self.context)

    def place_robots(self, postures: Mapping[str, Vector]) -> None:
        """Put robots into postures (n,) [rad or m]; the others stay."""
        for name, posture in postures.items():
            self.station.robots[name].axis_map.set_positions(self.plant, self.context, posture)
        self.place(self.plant.GetPositions(self.context))

    def owner(self, shape: GeometryId) -> str:
        """Return what a shape belongs to: a piece, a link of a robot, the floor, or a box of its terrain."""
        return owner_of_shape(self.station, shape)

    def query(self) -> QueryObject:
        """Return the geometry in its present configuration, for distances and pictures."""
        return self.station.query(self._scene)
