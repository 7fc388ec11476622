"""The plant of a station: Drake's multibody plant with its scene graph, and the station's robots and pieces in it.

:class:`StationPlant` is made from the station's contents (`simrob_drake.parts.resolved`) when the plant is built. A
station that another engine moves has a block of that engine in the diagram, in place of the plant. In such a station,
and in a kinematic one, Drake's plant is outside of the diagram and only computes poses, masses and forces.
"""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from pydrake.geometry import (
    CollisionFilterDeclaration,
    GeometryId,
    GeometrySet,
    QueryObject,
    SceneGraph,
)
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, Joint, ModelInstanceIndex, RigidBody
from pydrake.systems.framework import Context, DiagramBuilder, InputPort
from pydrake.systems.rendering import MultibodyPositionToGeometryPose

from simrob_drake.base.frames import Vector
from simrob_drake.base.renaming import keep_former_attributes
from simrob_drake.parts.engine import PlantBlock
from simrob_drake.parts.ground import Ground
from simrob_drake.parts.resolved import ResolvedRobot
from simrob_drake.robots.axis_map import AxisMap


@dataclass(frozen=True, repr=False)
class StationRobot(ResolvedRobot):
    """A robot in the plant of a station. It has n axes.

    If the tool centre point is at an offset from the tool in use, its frame is a tool of its own here: `tcp` and the
    key of the frame in `tools` are then the word ``tcp``.
    """

    plant: MultibodyPlant  # plant that contains the robot
    instance: ModelInstanceIndex  # its model instance in the plant
    joints: list[Joint]  # joints of its axes, in order
    root: Frame  # frame of its root link
    # frames of tools and carried pieces, by name
    tools: dict[str, Frame]

    @cached_property
    def axis_map(self) -> AxisMap:
        """Map between the robot's axes and the positions and velocities of the plant, which must be finalized."""
        # The positive sense of an axis may be opposite to that of its joint: q_axis = sign q_joint, with sign 1 or -1.
        signs = [axis.sign for axis in self.model.axes.values()]
        return AxisMap.of_joints(self.plant, self.joints, signs)

    def free_inertias(self, context: Context | None = None) -> Vector:
        r"""Compute the inertia that each axis feels if all else moves freely: all other axes, and a base that floats.

        It is :math:`1 / (M^{-1})_{ii}` with the plant's mass matrix M: a torque at axis i alone accelerates it by
        :math:`\ddot q_i = (M^{-1})_{ii} \tau_i`.

        Args:
            context: context of the plant. If it is None, the plant's default positions are used.

        Returns:
            The inertias, shape (n,) [kg m² or kg].
        """
        if context is None:
            context = self.plant.CreateDefaultContext()
        mass_matrix = self.plant.CalcMassMatrix(context)
        inverse = np.linalg.inv(mass_matrix)
        # The velocities of the plant include those of other robots and pieces: the axes' own are picked.
        return np.asarray(1 / np.diag(inverse)[self.axis_map.velocity_places])


@dataclass(frozen=True)
class StationPlant:
    """The plant of a station, and its robots and pieces in this plant."""

    plant: MultibodyPlant  # finalized
    scene_graph: SceneGraph  # scene graph that contains the plant's shapes
    robots: dict[str, StationRobot]  # by name
    # the bodies of the pieces that nothing holds, by name
    free_pieces: dict[str, RigidBody] = field(default_factory=dict)
    ground: Ground = field(default_factory=Ground)  # height of the ground, on which robots stand
    # small balls at the corners of flat bodies, such as boxes: contact forces act on the balls instead of the flat
    # shapes
    contact_points: frozenset[GeometryId] = frozenset()
    # pairs of shapes between which the contact points touch; a collision filter lets the two shapes themselves pass
    # through each other
    replaced_pairs: tuple[tuple[GeometryId, GeometryId], ...] = ()
    # block of another engine in the diagram; None if the plant itself is stepped
    stand_in: PlantBlock | None = None
    # whether the solver of the plant holds couplings as constraints; otherwise stiff springs hold them
    holds_constraints: bool = False
    # text before the names of the station's model instances, see `StationContents.scope`
    scope: str = ""
    # whether the plant may have further bodies and joints of the user's own: it is the user's plant, or the user's
    # functions have added to the station's plant
    is_shared: bool = False

    @property
    def plant_block(self) -> Any:
        """The block ``plant`` of a dynamic station's diagram: Drake's plant, or the block of another engine.

        Both have the same ports and the methods of :class:`simrob_drake.parts.engine.PlantBlock`.
        """
        return self.stand_in or self.plant

    def set_positions(self, root: Context, positions: Vector) -> None:
        """Set the positions of the plant's block.

        Args:
            root: context of the whole diagram, which is changed.
            positions: positions of the plant, shape (nq,).
        """
        context = self.plant_block.GetMyMutableContextFromRoot(root)
        self.plant_block.SetPositions(context, positions)

    def query(self, root: Context) -> QueryObject:
        """Query object of the scene graph, which finds distances and contacts of shapes.

        Args:
            root: context of the whole diagram, whose poses the query uses.
        """
        context = self.scene_graph.GetMyContextFromRoot(root)
        return self.scene_graph.get_query_output_port().Eval(context)

    def with_whole_shapes(self, root: Context) -> Context:
        """Clone a context of the diagram, and in the clone let the shapes of `replaced_pairs` themselves collide.

        In the given context only the contact points of these pairs collide. The small balls at the corners of two boxes
        do not show how deep the boxes are in each other.

        Args:
            root: context of the whole diagram, which stays as it is.

        Returns:
            The clone.
        """
        # Collision filters are a part of a context, so the filters of the clone do not affect the run.
        clone = root.Clone()
        context = self.scene_graph.GetMyMutableContextFromRoot(clone)
        filters = self.scene_graph.collision_filter_manager(context)
        for first, second in self.replaced_pairs:
            pair_collides = CollisionFilterDeclaration().AllowBetween(
                GeometrySet(first), GeometrySet(second)
            )
            filters.Apply(pair_collides)
        return clone

    @property
    def joints(self) -> list[Joint]:
        """Joints of the station's robots and free pieces, in the order of the plant.

        If the plant is not shared, they are all joints of the plant: those that weld fixed pieces, or a body of a
        coupling, to the world are among them, too.
        """
        joints = [self.plant.get_joint(index) for index in self.plant.GetJointIndices()]
        if not self.is_shared:
            return joints
        # A plant that is shared may also have joints of the user's own, which are not the station's.
        return [joint for joint in joints if int(joint.model_instance()) in self._own_instances]

    @cached_property
    def _own_instances(self) -> set[int]:
        """Indices of the model instances of robots, which contain the pieces that they carry, and of free pieces."""
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
        # A piece that a robot carries is a part of the robot's model instance. Every other piece has an instance of its
        # own, with this name.
        carriers = [robot.instance for robot in self.robots.values() if piece in robot.carried]
        instance = (
            carriers[0]
            if carriers
            else self.plant.GetModelInstanceByName(f"{self.scope}{piece}::{piece}")
        )
        return self.plant.GetFrameByName(frame, instance)

    def __repr__(self) -> str:
        return f"<StationPlant of {[*self.robots.values()]}, free pieces {[*self.free_pieces]}>"

    def add_geometry_poses(self, builder: DiagramBuilder, *, of_state: bool = False) -> InputPort:
        """Add the block that moves the plant's shapes in the scene graph, for a plant outside of the diagram.

        Args:
            builder: builder of the diagram, which contains the scene graph.
            of_state: whether the block reads the plant's state (nq + nv,) instead of its positions (nq,).

        Returns:
            The block's port for the state or the positions.
        """
        poses = MultibodyPositionToGeometryPose(self.plant, input_multibody_state=of_state)
        builder.AddNamedSystem("geometry_poses", poses)
        source_id = self.plant.get_source_id()
        # The function that makes a station's plant registers it, even if the plant stays outside of the diagram.
        assert source_id is not None
        builder.Connect(poses.get_output_port(), self.scene_graph.get_source_pose_port(source_id))
        return poses.get_input_port()


keep_former_attributes(StationPlant, stepped="plant_block", place="set_positions")
