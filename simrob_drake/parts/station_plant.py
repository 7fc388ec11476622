"""The plant of a station with its robots: Drake's multibody plant, its scene graph, and where each robot is in them."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from pydrake.geometry import CollisionFilterDeclaration, GeometryId, GeometrySet, QueryObject, SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, Joint, ModelInstanceIndex, RigidBody
from pydrake.systems.framework import Context, DiagramBuilder, InputPort
from pydrake.systems.rendering import MultibodyPositionToGeometryPose

from simrob_drake.base.frames import Vector
from simrob_drake.parts.engine import PlantBlock
from simrob_drake.parts.ground import Ground
from simrob_drake.parts.resolved import ResolvedRobot
from simrob_drake.robots.axis_map import AxisMap


@dataclass(frozen=True, repr=False)
class StationRobot(ResolvedRobot):
    """A robot in the plant of a station."""

    plant: MultibodyPlant  # that it is in
    instance: ModelInstanceIndex  # its model instance there
    joints: list[Joint]  # of the axes, in order
    root: Frame  # the frame of its root link
    tools: dict[str, Frame]  # frames of tools and carried pieces by name; ``tcp`` is the one in use

    @cached_property
    def axis_map(self) -> AxisMap:
        """Between its axes and the vectors of the plant, which is finalized."""
        return AxisMap.of_joints(self.plant, self.joints, [axis.sign for axis in self.model.axes.values()])

    def free_inertias(self, context: Context | None = None) -> Vector:
        """Return each axis's inertia (n,) [kg m² or kg] with the others free, at the start or in a context."""
        mass = self.plant.CalcMassMatrix(self.plant.CreateDefaultContext() if context is None else context)
        return np.asarray(1 / np.diag(np.linalg.inv(mass))[self.axis_map.velocity_places])


@dataclass(frozen=True)
class StationPlant:
    """The plant of a station and where its robots are in it."""

    plant: MultibodyPlant  # finalized
    scene_graph: SceneGraph  # with which it is registered
    robots: dict[str, StationRobot]  # by name
    # the bodies of the pieces that nothing holds, by name
    free_pieces: dict[str, RigidBody] = field(default_factory=dict)
    ground: Ground = field(default_factory=Ground)  # what there is to stand on
    # small balls at the corners of flat bodies, such as boxes: contact forces act on the balls instead of the flat
    # shapes
    contact_points: frozenset[GeometryId] = frozenset()
    # pairs of shapes between which the contact points touch; a collision filter lets the two shapes themselves pass
    # through each other
    replaced_pairs: tuple[tuple[GeometryId, GeometryId], ...] = ()
    stand_in: PlantBlock | None = None  # block of another engine in the diagram; None if the plant itself is stepped
    # whether the solver of the plant holds couplings as constraints; otherwise stiff springs hold them
    holds_constraints: bool = False
    scope: str = ""  # text before the names of the station's model instances, see `Surroundings.scope`
    is_shared: bool = False  # whether the plant is one of the user's own, with further bodies in it

    @property
    def stepped(self) -> Any:
        """What stands in the diagram of a dynamic station as ``plant``: Drake's own, or another engine's."""
        return self.stand_in or self.plant

    def place(self, root: Context, positions: Vector) -> None:
        """Let what is stepped stand at positions (nq,), in a context of its diagram."""
        self.stepped.SetPositions(self.stepped.GetMyMutableContextFromRoot(root), positions)

    def query(self, root: Context) -> QueryObject:
        """Return what tells which shapes touch, in a context of the diagram."""
        return self.scene_graph.get_query_output_port().Eval(self.scene_graph.GetMyContextFromRoot(root))

    def with_whole_shapes(self, root: Context) -> Context:
        """Clone a context of the diagram, and in the clone let the shapes of `replaced_pairs` collide themselves.

        In the given context only the contact points of these pairs collide. The small balls at the corners of two boxes
        do not show how deep the boxes are in each other.

        Args:
            root: context of the whole diagram, which stays as it is.
        """
        clone = root.Clone()
        context = self.scene_graph.GetMyMutableContextFromRoot(clone)
        filters = self.scene_graph.collision_filter_manager(context)
        for first, second in self.replaced_pairs:
            pair_collides = CollisionFilterDeclaration().AllowBetween(GeometrySet(first), GeometrySet(second))
            filters.Apply(pair_collides)
        return clone

    @property
    def joints(self) -> list[Joint]:
        """Joints of the station's robots and pieces, in the order of the plant."""
        joints = [self.plant.get_joint(index) for index in self.plant.GetJointIndices()]
        if not self.is_shared:
            return joints
        return [joint for joint in joints if int(joint.model_instance()) in self._own_instances]

    @cached_property
    def _own_instances(self) -> set[int]:
        """Indices of the model instances of the station's robots and pieces."""
        own = [robot.instance for robot in self.robots.values()]
        own += [body.model_instance() for body in self.free_pieces.values()]
        return {int(instance) for instance in own}

    def shapes_of_body(self, body: RigidBody) -> list[GeometryId]:
        """Collision shapes of a body, without the small balls at their corners (`contact_points`)."""
        shapes = self.plant.GetCollisionGeometriesForBody(body)
        return [shape for shape in shapes if shape not in self.contact_points]

    def piece_frame(self, piece: str, frame: str) -> Frame:
        """Find a frame of a piece in the plant.

        Args:
            piece: name of the piece.
            frame: name of the frame in the plant: ``<piece>_<frame>``, or the piece's own name for the frame in which
                the piece is described.
        """
        # A piece that a robot carries is a part of the robot's model instance.
        carriers = [robot.instance for robot in self.robots.values() if piece in robot.carried]
        instance = carriers[0] if carriers else self.plant.GetModelInstanceByName(f"{self.scope}{piece}::{piece}")
        return self.plant.GetFrameByName(frame, instance)

    def __repr__(self) -> str:
        return f"<StationPlant of {[*self.robots.values()]}, free pieces {[*self.free_pieces]}>"

    def add_geometry_poses(self, builder: DiagramBuilder, *, of_state: bool = False) -> InputPort:
        """Add the block that poses the plant's shapes in the scene graph, for a plant outside of the diagram.

        Args:
            builder: builder of the diagram, which contains the scene graph.
            of_state: whether the block reads the plant's state (nq + nv,) instead of its positions (nq,).

        Returns:
            the block's port for the state or the positions.
        """
        poses = MultibodyPositionToGeometryPose(self.plant, input_multibody_state=of_state)
        builder.AddNamedSystem("geometry_poses", poses)
        source_id = self.plant.get_source_id()
        assert source_id is not None  # add_plant registers the plant
        builder.Connect(poses.get_output_port(), self.scene_graph.get_source_pose_port(source_id))
        return poses.get_input_port()
