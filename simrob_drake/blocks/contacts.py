"""What touches what, made once for all that look at it, with what force, and the distances between shapes."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.geometry import GeometryId, HalfSpace, QueryObject, SceneGraphInspector, Shape
from pydrake.math import RigidTransform
from pydrake.multibody.plant import ContactResults, MultibodyPlant
from pydrake.multibody.tree import Frame
from pydrake.systems.framework import BasicVector, Context

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Vector
from simrob_drake.base.lifetime import weakly
from simrob_drake.base.messages import message
from simrob_drake.blocks.block import Block
from simrob_drake.robots.outlines import lowest_points, shape_corners


@dataclass(frozen=True)
class Contacts:
    """What touches what at one moment: k points and surfaces, in the world.

    Attributes:
        pairs: the first and the second shape of each.
        points: where the forces act, shape (k, 3) [m].
        forces: on the first shapes, shape (k, 3) [N].
        moments: on the first shapes about the points, shape (k, 3) [N·m]; zero for points.
        normals: of the surfaces, out of the second shapes, shape (k, 3).
    """

    pairs: list[tuple[GeometryId, GeometryId]]
    points: Vector
    forces: Vector
    moments: Vector
    normals: Vector

    @classmethod
    def of(cls, results: "ContactResults | Contacts") -> "Contacts":
        """Return the contacts of Drake's contact results; those of another engine are contacts already."""
        if isinstance(results, Contacts):
            return results
        pairs, rows = [], []
        for index in range(results.num_point_pair_contacts()):
            info = results.point_pair_contact_info(index)
            pair = info.point_pair()
            pairs.append((pair.id_B, pair.id_A))
            rows.append((info.contact_point(), info.contact_force(), _NOTHING, -pair.nhat_BA_W))
        for index in range(results.num_hydroelastic_contacts()):
            info = results.hydroelastic_contact_info(index)
            surface, wrench = info.contact_surface(), info.F_Ac_W()
            areas = np.array([surface.area(face) for face in range(surface.num_faces())])
            normals = np.array([surface.face_normal(face) for face in range(surface.num_faces())])
            normal = areas @ normals  # normals of the faces point out of N, into M
            if not normal.any():  # bodies that only just touch: a surface without area, and without force
                continue
            pairs.append((surface.id_M(), surface.id_N()))
            unit = normal / np.linalg.norm(normal)
            rows.append((surface.centroid(), wrench.translational(), wrench.rotational(), unit))
        return cls(pairs, *np.array(rows).reshape(-1, 4, 3).transpose(1, 0, 2))

    @classmethod
    def together(cls, moments: "Sequence[Contacts]") -> "Contacts":
        """Return the contacts of several moments, one behind the other."""
        arrays = ([getattr(each, name) for each in moments] for name in ("points", "forces", "moments", "normals"))
        return cls([pair for each in moments for pair in each.pairs], *map(np.vstack, arrays))

    def __deepcopy__(self, memo: dict[int, object]) -> "Contacts":
        """Return itself: nothing in it changes, and Drake copies the values of ports when a context is cloned."""
        return self

    @cached_property
    def normal_forces(self) -> Vector:
        """The parts of the forces along the normals, shape (k, 3) [N]."""
        return np.asarray((self.forces * self.normals).sum(axis=1, keepdims=True) * self.normals)

    def senses(self, body: Collection[GeometryId], other: Collection[GeometryId] | None = None) -> Vector:
        """Return 1 where a body's shape is a contact's first, -1 where it is the second, shape (k,).

        Zero where the body has no part in it, or touches something else than ``other``; unless given that is all but
        the body itself.
        """

        def between(shape: GeometryId, presses: GeometryId) -> bool:
            return shape in body and (presses not in body if other is None else presses in other)

        known = {(a, b): between(a, b) or -1.0 * between(b, a) for a, b in set(self.pairs)}
        return np.array([known[pair] for pair in self.pairs], dtype=float)


_NOTHING = np.zeros(3)


def pressing(results: ContactResults | Contacts) -> Iterator[tuple[GeometryId, GeometryId]]:
    """Yield the pairs of shapes that press on each other, without a look at each face as in :meth:`Contacts.of`."""
    if isinstance(results, Contacts):
        yield from (pair for pair, force in zip(results.pairs, results.forces, strict=True) if force.any())
        return
    for index in range(results.num_point_pair_contacts()):
        point = results.point_pair_contact_info(index)
        if point.contact_force().any():
            yield point.point_pair().id_B, point.point_pair().id_A
    for index in range(results.num_hydroelastic_contacts()):
        info = results.hydroelastic_contact_info(index)
        if info.F_Ac_W().translational().any():
            yield info.contact_surface().id_M(), info.contact_surface().id_N()


class ContactReader(Block):
    """Hand on a plant's contact results as :class:`Contacts`, read once for all blocks that need them.

    Ports:
        in  ``contact_results``: of the plant.
        out ``contacts``.
    """

    def __init__(self) -> None:
        super().__init__()
        self._results = self.DeclareAbstractInputPort("contact_results", Value[ContactResults]())
        self.DeclareAbstractOutputPort("contacts", Value[object], weakly(self._read))

    def _read(self, context: Context, output: AbstractValue) -> None:
        output.set_value(Contacts.of(self._results.Eval(context)))


class ForceSensor(Block):
    r"""Measure the contact force on a body, and its moment about the origin of a frame.

    .. math:: f = \sum_i f_i, \qquad m = \sum_i (p_i - p_F) \times f_i + m_i

    over the point contacts and the contact surfaces (:math:`m_i`, about their centroids) between two sets of shapes.

    Ports:
        in  ``contacts``: those of a plant, of a ContactReader.
        in  ``body_poses``: of the plant.
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
        """Make the block for the shapes of ``body`` on which those of ``other`` press; everything unless given.

        The frame is the world's unless given. ``normal_only`` leaves friction out, for solvers whose tangential forces
        cannot be trusted.
        """
        super().__init__()
        frame = plant.world_frame() if frame is None else frame
        self._body, self._other, self._normal_only = set(body), None if other is None else set(other), normal_only
        self._index, self._fixed = int(frame.body().index()), frame.GetFixedPoseInBodyFrame()
        self._moves = not plant.IsAnchored(frame.body())
        self._pose = frame.CalcPoseInWorld(plant.CreateDefaultContext())  # where it stays, if it does
        self._contacts = self.DeclareAbstractInputPort("contacts", Value[object]())
        self._poses = self.DeclareAbstractInputPort("body_poses", Value[list[RigidTransform]]())
        self.DeclareVectorOutputPort("wrench", 6, weakly(self._calc_wrench))

    def _calc_wrench(self, context: Context, output: BasicVector) -> None:
        contacts: Contacts = self._contacts.Eval(context)
        if not any(shape in self._body for pair in contacts.pairs for shape in pair):  # at once, for loops ask often
            output.SetFromVector(np.zeros(6))
            return
        senses = contacts.senses(self._body, self._other)
        if not senses.any():
            output.SetFromVector(np.zeros(6))
            return
        pose = self._poses.Eval(context)[self._index] @ self._fixed if self._moves else self._pose
        forces = senses[:, np.newaxis] * (contacts.normal_forces if self._normal_only else contacts.forces)
        products = (contacts.points - pose.translation()).T @ forces
        moment = np.array([products[k - 2, k - 1] - products[k - 1, k - 2] for k in range(3)])
        if not self._normal_only:
            moment += senses @ contacts.moments
        turn = pose.rotation().inverse()
        output.SetFromVector(np.concatenate([turn @ forces.sum(axis=0), turn @ moment]))


Pair = tuple[GeometryId, GeometryId]


class Distances:
    """The signed distances of pairs of shapes, wherever they are.

    Drake finds them for all pairs of convex shapes (a mesh counts as its convex hull), but of half spaces for spheres
    alone; of other shapes the lowest point is looked up here.

    Attributes:
        pairs: in the order of the distances: those with half spaces come last.
    """

    def __init__(self, pairs: Collection[Pair], inspector: SceneGraphInspector) -> None:
        """Look at the shapes of pairs that can touch."""
        flat = [any(isinstance(inspector.GetShape(shape), HalfSpace) for shape in pair) for pair in pairs]
        self._above = [self._over_plane(inspector, *pair) for pair, is_flat in zip(pairs, flat, strict=True) if is_flat]
        self._between = [pair for pair, is_flat in zip(pairs, flat, strict=True) if not is_flat]
        self.pairs = [*self._between, *(pair for pair, is_flat in zip(pairs, flat, strict=True) if is_flat)]

    def of(self, query: QueryObject) -> Vector:
        """Return the distances, negative where shapes are in each other, shape (k,) [m]."""
        found = [query.ComputeSignedDistancePairClosestPoints(*pair).distance for pair in self._between]
        for shape_id, shape, corners, plane in self._above:
            base = query.GetPoseInWorld(plane).inverse() if isinstance(plane, GeometryId) else plane
            found.append(lowest_points(shape, base @ query.GetPoseInWorld(shape_id), corners)[:, 2].min())
        return np.array(found)

    @staticmethod
    def _over_plane(
        inspector: SceneGraphInspector, first: GeometryId, second: GeometryId
    ) -> tuple[GeometryId, Shape, Vector, GeometryId | RigidTransform]:
        """Return the shape over a half space, its corners, and the half space, or the world in it where it stands."""
        if isinstance(inspector.GetShape(first), HalfSpace):
            first, second = second, first
        stands = inspector.GetFrameId(second) == inspector.world_frame_id()
        plane = inspector.GetPoseInFrame(second).inverse() if stands else second
        return first, inspector.GetShape(first).Clone(), shape_corners(inspector, first), plane


class DistanceSensor(Block):
    """Measure the signed distance between two sets of shapes: that of the nearest, or deepest, pair.

    Ports:
        in  ``query``: of the scene graph.
        out ``distance`` (1): [m], negative where the shapes are in each other.
    """

    def __init__(
        self, *, body: Collection[GeometryId], other: Collection[GeometryId], inspector: SceneGraphInspector
    ) -> None:
        """Make the block for the shapes of ``body`` and ``other``.

        Raises:
            InvalidParameter: no pair whose distance can be measured: shapes of one robot, or of one body.
        """
        super().__init__()
        pairs = [(a, b) for a in body for b in other if a != b and not inspector.CollisionFiltered(a, b)]
        if not pairs:
            names = " and ".join(inspector.GetName(next(iter(shapes))) for shapes in (body, other))
            expected = message(
                "blocks.two_things_that_touch",
                "two things that can touch; parts of one robot can with contact.self_collision: true",
            )
            raise InvalidParameter(
                message("blocks.distance_sensor", "distance sensor"),
                message("blocks.between", "between {names}", names=names),
                expected,
            )
        self._distances = Distances(pairs, inspector)
        self._query = self.DeclareAbstractInputPort("query", Value[QueryObject]())
        self.DeclareVectorOutputPort("distance", 1, weakly(self._calc_distance))

    def _calc_distance(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, self._distances.of(self._query.Eval(context)).min())
