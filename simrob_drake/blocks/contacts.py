"""Contacts of a plant, read once for all blocks that need them; sensors of contact forces and of distances.

Shapes are collision geometries, named by their identifiers in Drake's scene graph. A body may have several.
"""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.geometry import GeometryId, HalfSpace, QueryObject, SceneGraphInspector, Shape
from pydrake.math import RigidTransform
from pydrake.multibody.plant import ContactResults, MultibodyPlant
from pydrake.multibody.tree import Frame
from pydrake.systems.framework import BasicVector, Context

from simrob_drake.base.errors import Unsuitable
from simrob_drake.base.frames import Vector
from simrob_drake.base.lifetime import weakly
from simrob_drake.base.messages import join_texts, message
from simrob_drake.base.renaming import former_names_of, keep_former_attributes
from simrob_drake.blocks.block import Block
from simrob_drake.robots.outlines import lowest_points, shape_corners

Pair = tuple[GeometryId, GeometryId]
"""Two shapes that touch, or may touch."""

# The moment of a point contact about its point [N·m].
_NO_MOMENT = np.zeros(3)


@dataclass(frozen=True)
class Contacts:
    """The k contacts of a plant at one moment. A contact is a point or a surface. Vectors are in the world's axes.

    Attributes:
        pairs: the first and the second shape of each contact.
        points: points at which the forces act, shape (k, 3) [m]: the contact points, or centroids of the surfaces.
        forces: forces on the first shapes, shape (k, 3) [N].
        moments: moments on the first shapes about the points, shape (k, 3) [N·m]; zero for contact points.
        normals: unit normals that point out of the second shapes, shape (k, 3).
    """

    pairs: list[Pair]
    points: Vector
    forces: Vector
    moments: Vector
    normals: Vector

    @classmethod
    def of(cls, results: "ContactResults | Contacts") -> "Contacts":
        """Read the contacts from Drake's contact results. Surfaces without area, which have no force, are left out.

        Contacts of another engine are returned as they come.
        """
        if isinstance(results, Contacts):
            return results

        pairs = list[Pair]()
        # Point, force, moment and normal of each contact, in the order of the fields.
        rows = list[tuple[Vector, Vector, Vector, Vector]]()
        for index in range(results.num_point_pair_contacts()):
            info = results.point_pair_contact_info(index)
            point_pair = info.point_pair()
            # Drake gives the force on B, and the normal that points from B into A.
            pairs.append((point_pair.id_B, point_pair.id_A))
            normal = -point_pair.nhat_BA_W
            rows.append((info.contact_point(), info.contact_force(), _NO_MOMENT, normal))
        for index in range(results.num_hydroelastic_contacts()):
            surface_info = results.hydroelastic_contact_info(index)
            surface = surface_info.contact_surface()
            wrench = surface_info.F_Ac_W()
            faces = range(surface.num_faces())
            areas = np.array([surface.area(face) for face in faces])
            face_normals = np.array([surface.face_normal(face) for face in faces])
            # Drake's normals of the faces point out of shape N, into shape M.
            # The faces of a curved surface have different normals: n = sum of A_i n_i, then normalised.
            normal = areas @ face_normals
            if not normal.any():
                # Bodies that only just touch: a surface without area, and so without force.
                continue
            pairs.append((surface.id_M(), surface.id_N()))
            unit_normal = normal / np.linalg.norm(normal)
            point = surface.centroid()
            rows.append((point, wrench.translational(), wrench.rotational(), unit_normal))

        # From (contacts, quantities, 3) to (quantities, contacts, 3). The reshape is for zero contacts.
        quantities = np.array(rows).reshape(-1, 4, 3).transpose(1, 0, 2)
        return cls(
            pairs,
            points=quantities[0],
            forces=quantities[1],
            moments=quantities[2],
            normals=quantities[3],
        )

    @classmethod
    def concatenate(cls, instants: "Sequence[Contacts]") -> "Contacts":
        """Join the contacts of one or several moments in time into one list, one moment after the other."""
        return cls(
            [pair for contacts in instants for pair in contacts.pairs],
            points=np.vstack([contacts.points for contacts in instants]),
            forces=np.vstack([contacts.forces for contacts in instants]),
            moments=np.vstack([contacts.moments for contacts in instants]),
            normals=np.vstack([contacts.normals for contacts in instants]),
        )

    def __deepcopy__(self, memo: dict[int, object]) -> "Contacts":
        """Return the contacts themselves, which never change: Drake copies values of ports when it clones a context."""
        return self

    @cached_property
    def normal_forces(self) -> Vector:
        """Components of the forces along the normals, as vectors: forces without friction, shape (k, 3) [N]."""
        # f_n = (f . n) n for each contact; the sum over axis 1 is the dot product.
        along_normals = (self.forces * self.normals).sum(axis=1, keepdims=True)
        return np.asarray(along_normals * self.normals)

    def force_signs(
        self,
        body: Collection[GeometryId],
        other: Collection[GeometryId] | None = None,
    ) -> Vector:
        """Signs that turn the forces of the contacts into forces on a body, shape (k,).

        A sign is 1 if the first shape of the contact belongs to the body, -1 if the second one does (an equal and
        opposite force acts on it), and 0 if the contact does not count.

        Args:
            body: shapes of the body.
            other: shapes whose contacts with the body count. If it is None, all contacts count but those of the body
                with itself.
        """

        def acts_on_body(shape: GeometryId, opposite: GeometryId) -> bool:
            """Check that a shape belongs to the body, and that its contact with the opposite shape counts."""
            if shape not in body:
                return False
            return opposite not in body if other is None else opposite in other

        # A pair of shapes often has many contacts, so each pair is looked at once.
        sign_of_pair = dict[Pair, float]()
        for first, second in set(self.pairs):
            if acts_on_body(first, second):
                sign_of_pair[first, second] = 1.0
            elif acts_on_body(second, first):
                sign_of_pair[first, second] = -1.0
            else:
                sign_of_pair[first, second] = 0.0
        return np.array([sign_of_pair[pair] for pair in self.pairs], dtype=float)


keep_former_attributes(Contacts, together="concatenate", senses="force_signs")


def pressing_pairs(results: ContactResults | Contacts) -> Iterator[Pair]:
    """Yield the pair of shapes of each contact that has a force. A pair with several contacts comes several times.

    It takes less time than :meth:`Contacts.of`, which visits each face of a contact surface.
    """
    if isinstance(results, Contacts):
        for pair, force in zip(results.pairs, results.forces, strict=True):
            if force.any():
                yield pair
        return
    for index in range(results.num_point_pair_contacts()):
        point = results.point_pair_contact_info(index)
        # A solver also lists contacts without a force, such as those of shapes that only just touch.
        if point.contact_force().any():
            yield point.point_pair().id_B, point.point_pair().id_A
    for index in range(results.num_hydroelastic_contacts()):
        info = results.hydroelastic_contact_info(index)
        if info.F_Ac_W().translational().any():
            yield info.contact_surface().id_M(), info.contact_surface().id_N()


class ContactReader(Block):
    """Convert a plant's contact results to :class:`Contacts`, once for all blocks that need them.

    Ports:
        in  ``contact_results``: the contact results of the plant.
        out ``contacts``: the same as `Contacts`.
    """

    def __init__(self) -> None:
        super().__init__()
        self._results = self.DeclareAbstractInputPort("contact_results", Value[ContactResults]())
        # `Contacts` is a class of Python, so the port carries it as a Python object. Drake keeps the callback of a
        # port, which holds the block weakly, as the block would otherwise never be freed.
        self.DeclareAbstractOutputPort("contacts", Value[object], weakly(self._read))

    def _read(self, context: Context, output: AbstractValue) -> None:
        output.set_value(Contacts.of(self._results.Eval(context)))


class ForceSensor(Block):
    r"""Measure the contact force on a body, and its moment about the origin of a frame.

    .. math:: f = \sum_i f_i, \qquad m = \sum_i (p_i - p_F) \times f_i + m_i

    The sums are over the contacts i between two sets of shapes: forces :math:`f_i` at points :math:`p_i`, and for
    contact surfaces the moments :math:`m_i` about their centroids. :math:`p_F` is the origin of the frame.

    Ports:
        in  ``contacts``: the contacts of a plant, from a `ContactReader`.
        in  ``body_poses``: the poses of the plant's bodies.
        out ``wrench`` (6): f [N], then m [N·m], in the axes of the frame.
    """

    def __init__(
        self,
        *,
        plant: MultibodyPlant,
        body: Collection[GeometryId],
        other: Collection[GeometryId] | None = None,
        frame: Frame | None = None,
        normal_only: bool = False,
    ) -> None:
        """Create the sensor.

        Args:
            plant: the finalized plant.
            body: shapes of the body on which the force is measured.
            other: shapes that exert the force. If it is None, all shapes count but those of the body.
            frame: frame of the measured wrench. If it is None, the world's frame is used.
            normal_only: whether friction is left out, for solvers whose tangential forces cannot be trusted. The
                moments :math:`m_i` of contact surfaces are then left out, too.
        """
        super().__init__()
        frame = plant.world_frame() if frame is None else frame
        self._body = set(body)
        self._other = None if other is None else set(other)
        self._normal_only = normal_only

        # Pose of the frame: in its body, and in the world, which is used if the body cannot move.
        self._body_index = int(frame.body().index())
        self._pose_in_body = frame.GetFixedPoseInBodyFrame()
        self._is_moving = not plant.IsAnchored(frame.body())
        self._fixed_pose = frame.CalcPoseInWorld(plant.CreateDefaultContext())

        self._contacts = self.DeclareAbstractInputPort("contacts", Value[object]())
        self._poses = self.DeclareAbstractInputPort("body_poses", Value[list[RigidTransform]]())
        self.DeclareVectorOutputPort("wrench", 6, weakly(self._calc_wrench))

    def _calc_wrench(self, context: Context, output: BasicVector) -> None:
        """Compute the wrench, shape (6,), in the axes of the frame: force [N], then moment about its origin [N·m]."""
        contacts: Contacts = self._contacts.Eval(context)
        # Loops ask often, mostly without a contact of the body: this check takes the least time.
        if not any(shape in self._body for pair in contacts.pairs for shape in pair):
            output.SetFromVector(np.zeros(6))
            return
        signs = contacts.force_signs(self._body, self._other)
        if not signs.any():
            output.SetFromVector(np.zeros(6))
            return

        pose = self._fixed_pose
        if self._is_moving:
            pose = self._poses.Eval(context)[self._body_index] @ self._pose_in_body
        # f_i of the class's equation: the force on the body, opposite if the body is the second shape.
        forces = signs[:, np.newaxis] * (
            contacts.normal_forces if self._normal_only else contacts.forces
        )

        # With arms r and forces f of all contacts, P[i, j] is the sum of r_i f_j, and the sum of the cross products
        # r x f has the components P[1, 2] - P[2, 1], P[2, 0] - P[0, 2] and P[0, 1] - P[1, 0]. The indices k - 2 and
        # k - 1 of the component k count from the end if they are negative.
        products = (contacts.points - pose.translation()).T @ forces
        moment = np.array([products[k - 2, k - 1] - products[k - 1, k - 2] for k in range(3)])
        if not self._normal_only:
            moment += signs @ contacts.moments

        # So far the vectors have the world's axes; R_FW gives them in the axes of the frame.
        to_frame = pose.rotation().inverse()
        output.SetFromVector(np.concatenate([to_frame @ forces.sum(axis=0), to_frame @ moment]))


class _ShapeOverPlane(NamedTuple):
    """A shape whose distance from a half space is measured.

    Attributes:
        shape_id: identifier of the shape.
        shape: the shape.
        corners: its corners in its frame, shape (m, 3) [m]; empty for round shapes.
        plane_id: identifier of the half space.
        world_in_plane: pose of the world in the half space's frame; None if the half space moves.
    """

    shape_id: GeometryId
    shape: Shape
    corners: Vector
    plane_id: GeometryId
    world_in_plane: RigidTransform | None

    def distance(self, query: QueryObject) -> float:
        """Signed distance of the shape's lowest point from the plane [m]."""
        to_plane = self.world_in_plane
        if to_plane is None:
            to_plane = query.GetPoseInWorld(self.plane_id).inverse()
        shape_in_plane = to_plane @ query.GetPoseInWorld(self.shape_id)
        # The z axis of a half space is its normal, so z is the height over the plane.
        heights = lowest_points(self.shape, shape_in_plane, self.corners)[:, 2]
        return float(heights.min())


class Distances:
    """Signed distances of pairs of shapes, at any poses of their bodies.

    Drake computes the distance of two convex shapes (a mesh counts as its convex hull), but that of a half space only
    from a sphere. For half spaces, the lowest point of the other shape is found here.

    Attributes:
        pairs: the pairs, in the order of the distances: pairs with a half space are at the end.
    """

    def __init__(self, pairs: Collection[Pair], inspector: SceneGraphInspector) -> None:
        """Prepare the distances of pairs of shapes that can touch.

        Args:
            pairs: the pairs.
            inspector: inspector of the scene graph that contains the shapes.
        """
        self._convex_pairs = list[Pair]()
        self._over_planes = list[_ShapeOverPlane]()
        plane_pairs = list[Pair]()
        for pair in pairs:
            if any(isinstance(inspector.GetShape(shape), HalfSpace) for shape in pair):
                plane_pairs.append(pair)
                self._over_planes.append(_shape_over_plane(inspector, pair))
            else:
                self._convex_pairs.append(pair)
        self.pairs = [*self._convex_pairs, *plane_pairs]

    def of(self, query: QueryObject) -> Vector:
        """Compute the distances of all k pairs, in the order of `pairs`, shape (k,) [m]; negative if shapes overlap.

        Args:
            query: query object of the scene graph, which has the present poses of the shapes.
        """
        distances = [
            query.ComputeSignedDistancePairClosestPoints(*pair).distance
            for pair in self._convex_pairs
        ]
        distances += [over_plane.distance(query) for over_plane in self._over_planes]
        return np.array(distances)


def _shape_over_plane(inspector: SceneGraphInspector, pair: Pair) -> _ShapeOverPlane:
    """Read the properties of a pair of shapes, of which at least one is a half space. The other one is measured.

    Args:
        inspector: inspector of the scene graph that contains the shapes.
        pair: the pair. If both are half spaces, the first one counts as the plane.
    """
    first, second = pair
    is_first_plane = isinstance(inspector.GetShape(first), HalfSpace)
    plane_id = first if is_first_plane else second
    shape_id = second if is_first_plane else first

    # The pose of a plane that is fixed to the world is inverted once here, not at each call.
    is_fixed = inspector.GetFrameId(plane_id) == inspector.world_frame_id()
    return _ShapeOverPlane(
        shape_id=shape_id,
        # A copy, as a reference to the shape would keep the whole scene graph in memory.
        shape=inspector.GetShape(shape_id).Clone(),
        corners=shape_corners(inspector, shape_id),
        plane_id=plane_id,
        world_in_plane=inspector.GetPoseInFrame(plane_id).inverse() if is_fixed else None,
    )


class DistanceSensor(Block):
    """Measure the signed distance between two sets of shapes: the smallest of all pairs of shapes that may collide.

    Ports:
        in  ``query``: the query object of the scene graph.
        out ``distance`` (1): [m], negative if shapes overlap.
    """

    def __init__(
        self,
        *,
        body: Collection[GeometryId],
        other: Collection[GeometryId],
        inspector: SceneGraphInspector,
    ) -> None:
        """Create the sensor.

        Args:
            body: first set of shapes.
            other: second set of shapes.
            inspector: inspector of the scene graph that contains the shapes.

        Raises:
            InvalidParameter: the collisions of all pairs are filtered out, as Drake does for shapes of one body, and a
                station for those of one robot unless the user wants them.
        """
        super().__init__()
        pairs = list[Pair]()
        for first in body:
            for second in other:
                # Drake filters pairs of one body, and a station those of one robot unless the user wants them.
                if first != second and not inspector.CollisionFiltered(first, second):
                    pairs.append((first, second))
        if not pairs:
            # The message names one shape of each set.
            names = join_texts(
                [inspector.GetName(next(iter(shapes))) for shapes in (body, other)],
                message("base.and", " and "),
            )
            raise Unsuitable(
                message("blocks.distance_sensor", "distance sensor"),
                message(
                    "blocks.cannot_collide", "collisions of {names} are filtered out", names=names
                ),
                message(
                    "blocks.two_things_that_touch",
                    "name two other bodies, or set contact.self_collision: true for parts of one robot",
                ),
            )
        self._distances = Distances(pairs, inspector)
        self._query = self.DeclareAbstractInputPort("query", Value[QueryObject]())
        self.DeclareVectorOutputPort("distance", 1, weakly(self._calc_distance))

    def _calc_distance(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, self._distances.of(self._query.Eval(context)).min())


if not TYPE_CHECKING:
    __getattr__ = former_names_of(__name__, {"pressing": "pressing_pairs"})
