"""Work objects, tools and loads: rigid bodies with mass, named frames, colour and shapes, perhaps filled evenly."""

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, model_validator
from pydrake.geometry import Box, Convex, Cylinder, Mesh, ReadObjToTriangleSurfaceMesh, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.tree import CalcSpatialInertia, SpatialInertia

from simrob_drake.base.errors import InvalidModel, one_of
from simrob_drake.base.file_cache import FileCache, FileState, file_state
from simrob_drake.base.files import model_file, piece_files
from simrob_drake.base.frames import Vector, pose_from_transform, transform_from_pose
from simrob_drake.base.messages import message
from simrob_drake.base.sections import (
    ORIGIN,
    Colour,
    Inertia,
    Integer,
    NotNegative,
    Place,
    Pose,
    Positive,
    Strict,
    check_plain,
    validated,
)
from simrob_drake.base.yaml_files import read_yaml
from simrob_drake.robots.urdf import (
    Solid,
    add_colour,
    add_contact,
    add_frame,
    add_joint,
    add_solid,
    mesh_file,
    pose_of,
    set_inertia,
)

_NOTHING = 1e-12  # products of inertia smaller than this part of the largest moment are rounding


@dataclass(frozen=True)
class SolidInertia:
    """What follows from a body's form alone."""

    volume: float  # [m³], positive
    centre: Vector  # of mass, shape (3,) [m]
    moments: Vector  # about the centre, for a density of 1 kg/m³: Ixx Iyy Izz Ixy Ixz Iyz, shape (6,) [m⁵]


def solid_inertia(solids: Sequence[Solid], *, closed: bool) -> SolidInertia:
    """Return the figures of bodies, at least one, as one; where two overlap, both count.

    Every mesh must enclose a volume if ``closed``; if not, one that doesn't counts as its convex hull. Raises
    InvalidModel: a mesh that Drake cannot read, or that must enclose a volume and doesn't.
    """
    own = [
        _mesh_inertia(solid.shape, solid.scale, closed, file_state(solid.shape))
        if isinstance(solid.shape, Path)
        else CalcSpatialInertia(solid.shape, 1.0)
        for solid in solids
    ]
    parts = [inertia.ReExpress(solid.pose.rotation()) for inertia, solid in zip(own, solids, strict=True)]
    volumes = np.array([part.get_mass() for part in parts])
    centres = np.array([s.pose.translation() + part.get_com() for s, part in zip(solids, parts, strict=True)])
    centre = volumes @ centres / volumes.sum()
    about_centre = [
        part.Shift(centre - solid.pose.translation()).CalcRotationalInertia().CopyToFullMatrix3()
        for solid, part in zip(solids, parts, strict=True)
    ]
    moments = np.sum(about_centre, axis=0)[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    return SolidInertia(float(volumes.sum()), centre, np.where(abs(moments) < _NOTHING * moments.max(), 0.0, moments))


@lru_cache(maxsize=64)
def _mesh_inertia(file: Path, scale: float, closed: bool, state: FileState | None) -> SpatialInertia:
    """Compute the inertia of the volume that a mesh encloses, for a density of 1 kg/m³, in the mesh's own frame.

    Results are cached until the file changes.

    Args:
        file: the mesh.
        scale: factor for the lengths in the file.
        closed: whether the mesh must enclose a volume. If it need not and does not, its convex hull is taken.
        state: state of the file. The function does not read it: it is part of the cache's key, so that a changed file
            is read again.

    Raises:
        InvalidModel: Drake cannot read the mesh, or the mesh must enclose a volume and does not.
    """
    try:
        encloses_volume = _is_closed(file)
        if closed and not encloses_volume:
            problem = message(
                "robots.no_closed_obj",
                "is no OBJ that encloses a volume, so a density does not tell its mass; give the mass instead",
            )
            raise InvalidModel(file, "", problem)
        shape = Mesh(str(file), scale) if encloses_volume else Convex(str(file), scale)
        return CalcSpatialInertia(shape, 1.0)
    except (RuntimeError, ValueError, SystemExit) as problem:  # failed assertions come as SystemExit
        if isinstance(problem, InvalidModel):
            raise
        raise InvalidModel(
            file,
            "",
            message(
                "robots.drake_cannot_read", "Drake cannot read it: {problem}", problem=" ".join(str(problem).split())
            ),
        ) from problem


def _is_closed(file: Path) -> bool:
    """Return whether every edge of an OBJ mesh has a face on either side, and the faces look outwards."""
    if file.suffix.lower() != ".obj":
        return False
    surface = ReadObjToTriangleSurfaceMesh(str(file))
    faces = np.array([[face.vertex(corner) for corner in range(3)] for face in surface.triangles()])
    points = np.array(surface.vertices())
    if faces.max() >= len(points):  # a face of points that are not there, which Drake lets pass
        return False
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    a, b, c = points[faces.T]
    inside_out = np.einsum("ij,ij->", a, np.cross(b, c)) <= 0
    return not inside_out and np.array_equal(_sorted_rows(edges), _sorted_rows(edges[:, ::-1]))


def mesh_sides(file: Path, scale: float) -> tuple[float, ...]:
    """Sides of the box, along the axes of the mesh, that encloses an OBJ mesh which is scaled, shape (3,) [m]."""
    return tuple(scale * side for side in _unscaled_sides(file, file_state(file)))


@lru_cache(maxsize=64)
def _unscaled_sides(file: Path, state: FileState | None) -> tuple[float, ...]:
    """Sides of the box that encloses an OBJ mesh, in the unit of the file.

    Args:
        file: the OBJ file.
        state: state of the file. The function does not read it: it is part of the cache's key, so that a changed file
            is read again.
    """
    vertices = np.array(ReadObjToTriangleSurfaceMesh(str(file)).vertices())
    return tuple(np.ptp(vertices, axis=0).tolist())


def _sorted_rows(
    rows: np.ndarray[tuple[int, ...], np.dtype[np.int64]],
) -> np.ndarray[tuple[int, ...], np.dtype[np.int64]]:
    return rows[np.lexsort(rows.T)]


TCP = "tcp"  # the frame that every piece has
FORMS = "box", "cylinder", "sphere"

_MOST_FRAMES = 1000  # of one series


class PieceShape(Strict):
    """One shape of a piece: exactly one of box, cylinder, sphere and mesh."""

    box: tuple[Positive, Positive, Positive] | None = None
    """Its sides [m]."""
    cylinder: tuple[Positive, Positive] | None = None
    """Radius and length [m], along z."""
    sphere: Positive | None = None
    """Radius [m]."""
    mesh: str | None = None
    """A mesh file in the piece's folder, in a format that Drake reads; in contacts it counts as its convex hull."""
    scale: Positive = 1.0
    """Of the mesh: 0.001 for one in millimetres."""
    pose: Pose = ORIGIN
    """In the piece's frame, [x y z Rz Ry Rx]."""
    colour: Colour | None = None
    """Red, green, blue, opacity; the piece's unless given."""
    name: str | None = None
    """What sensors call it, `<piece>.<name>`; its number unless given."""
    collides: bool = True
    """Whether it takes part in contact."""
    visible: bool = True
    """Whether it is seen."""

    def solid(self, folder: Path) -> Solid:
        """Return the body that fills the shape, in the piece's frame."""
        pose = transform_from_pose(self.pose)
        if self.box is not None:
            return Solid(pose, Box(*self.box))
        if self.cylinder is not None:
            return Solid(pose, Cylinder(*self.cylinder))
        if self.sphere is not None:
            return Solid(pose, Sphere(self.sphere))
        return Solid(pose, mesh_file(str(self.mesh), folder), self.scale)

    @model_validator(mode="after")
    def _exactly_one(self) -> "PieceShape":
        if sum(kind is not None for kind in (self.box, self.cylinder, self.sphere, self.mesh)) != 1:
            raise ValueError(
                message("robots.one_of_shapes", "a shape has exactly one of box, cylinder, sphere and mesh")
            )
        return self


class Repeat(Strict):
    """How often a frame is repeated, and by which motion in the piece's frame."""

    count: Annotated[Integer, Field(ge=1, le=_MOST_FRAMES)]
    """How many frames there are in this direction."""
    step: Pose
    """From each to the next, [x y z Rz Ry Rx] in the piece's frame."""


class FrameSeries(Strict):
    """Frames at even steps, ``<name>_<i>`` or, in rows and columns, ``<name>_<i>_<j>``, counted from 0."""

    pose: Pose
    """Of the first, [x y z Rz Ry Rx] in the piece's frame."""
    series: Annotated[tuple[Repeat, ...], Field(min_length=1)]
    """One step for a row, two for rows and columns."""


class PieceModel(Strict):
    """A piece as its ``piece.yaml`` describes it; a station may change any of the figures.

    What is not given of mass, centre of mass and inertia follows from the shapes, evenly filled, where there is a
    ``density``, or a mass without an inertia (:func:`weighed`).
    """

    folder: Path
    """Where its file lies, which its meshes start from."""
    description: str = ""
    """What it is, in one line."""
    density: Positive | None = None
    """Of its material [kg/m³], instead of a mass."""
    mass: NotNegative = 0.0
    """[kg]."""
    com: Place = (0.0, 0.0, 0.0)
    """Centre of mass, in the piece's frame [m]."""
    inertia: Inertia = (0.0, 0.0, 0.0)
    """Moments Ixx Iyy Izz about the centre of mass [kg m²], and the products Ixy Ixz Iyz where they are not zero."""
    tcp: Pose = ORIGIN
    """Tool centre point, [x y z Rz Ry Rx] in the piece's frame."""
    frames: dict[str, Pose | FrameSeries] = Field(default_factory=dict)
    """Further frames by name, in the piece's frame: poses, or series of them."""
    colour: Colour = (0.6, 0.6, 0.65, 1.0)
    """Red, green, blue, opacity of the shapes that have none of their own."""
    shapes: tuple[PieceShape, ...] = ()
    """What it is made of: what is seen of it, and what touches others."""

    @model_validator(mode="after")
    def _consistent(self) -> "PieceModel":
        if self.density is not None and "mass" in self.model_fields_set:
            raise ValueError(message("robots.mass_or_density", "a piece has either a mass or a density"))
        series = [entry.series for entry in self.frames.values() if isinstance(entry, FrameSeries)]
        if any(np.prod([step.count for step in steps]) > _MOST_FRAMES for steps in series):
            raise ValueError(
                message("robots.too_many_frames", "a series of frames has at most {most}", most=_MOST_FRAMES)
            )
        names = [name for name, _ in self._named_poses()]
        for index, name in enumerate(names):
            check_plain(name)
            if name in names[:index]:
                raise ValueError(message("robots.frame_twice", "the frame '{name}' stands twice", name=name))
        return self

    @property
    def frame_poses(self) -> dict[str, Pose]:
        """Its frames, the tool centre point ``tcp`` first: pose [x y z Rz Ry Rx] in the piece's frame by name."""
        return dict(self._named_poses())

    def _named_poses(self) -> list[tuple[str, Pose]]:
        named = [(TCP, self.tcp)]
        for name, entry in self.frames.items():
            named += _series_poses(entry, name) if isinstance(entry, FrameSeries) else [(name, entry)]
        return named

    @property
    def shape_names(self) -> list[str]:
        """The names of the shapes, in order: their own, or their numbers."""
        return [shape.name or str(index) for index, shape in enumerate(self.shapes)]


def piece_names() -> list[str]:
    """Return the names of the pieces that come with the package."""
    return list(piece_files())


def piece_file(name: str) -> Path:
    """Return the file of a piece of the package; raises UnknownName: no such piece."""
    return model_file("pieces", name) or piece_files()[one_of(message("base.piece", "piece"), name, piece_names())]


def described_piece(file: Path) -> PieceModel:
    """Read a piece from its YAML file. Masses and inertias that the file leaves out are not computed yet.

    The piece is kept, and returned again until its file or one of its meshes changes.

    Raises:
        InvalidConfig: the file has a wrong entry.
        InvalidModel: a mesh is missing or cannot be used.
    """
    path = file.resolve()
    return _PIECES.value(path, lambda: _read_piece(path))


def with_changes(piece: PieceModel, changes: Mapping[str, Any], where: str) -> PieceModel:
    """Return a described piece with figures replaced, and all of them filled in.

    A mass replaces a density, and a density the mass; with it go a centre of mass and an inertia that are not changed.
    Raises InvalidConfig: a figure that cannot be; the message names ``where``; InvalidModel: as for :func:`weighed`.
    """
    replaced = {*changes, *(("mass", "com", "inertia") if "density" in changes else ())}
    replaced |= {"density"} if "mass" in changes else set()
    kept = {key: value for key, value in piece.model_dump(exclude_unset=True).items() if key not in replaced}
    return weighed(validated(PieceModel, {**kept, **changes}, where))


def weighed(piece: PieceModel) -> PieceModel:
    """Return a piece with mass, centre of mass and inertia filled in from its shapes, where they follow from them.

    They do with a density, and with a mass but no inertia. Shapes are solid, and where two overlap both count. Raises
    InvalidModel: a mesh cannot be read; with a density, a mesh does not enclose a volume, or there are no shapes.
    """
    stated, shapes = piece.model_fields_set, piece.shapes
    if piece.density is None and ("inertia" in stated or piece.mass == 0 or not shapes):
        return piece
    if not shapes:
        raise InvalidModel(
            piece.folder,
            "density",
            message("robots.density_without_shapes", "is given, but the piece has no shapes to fill"),
        )
    whole = solid_inertia([shape.solid(piece.folder) for shape in shapes], closed=piece.density is not None)
    density = piece.density or piece.mass / whole.volume
    found: dict[str, Any] = {
        "mass": density * whole.volume,
        "com": tuple(whole.centre.tolist()),
        "inertia": tuple((density * whole.moments).tolist()),
    }
    update = {key: value for key, value in found.items() if key not in stated}
    return piece.model_copy(update={**update, "density": None})


# Pieces that were read last, by the absolute paths of their files.
_PIECES: FileCache[PieceModel] = FileCache(size=128)


def _read_piece(file: Path) -> PieceModel:
    """Read a piece from its YAML file, without a look at the cache. Raises the errors of `described_piece`."""
    piece = validated(PieceModel, {"folder": file.parent, **read_yaml(file)}, file)
    for shape in piece.shapes:
        if shape.mesh is not None:
            mesh = mesh_file(shape.mesh, file.parent)  # raises InvalidModel if the mesh is missing
            file_state(mesh)  # the cache records the mesh, and so notices if it is deleted
    return piece


@lru_cache(maxsize=64)
def _series_poses(series: FrameSeries, name: str) -> tuple[tuple[str, Pose], ...]:
    found: list[tuple[str, Pose]] = []
    for places in product(*(range(step.count) for step in series.series)):
        pose = transform_from_pose(series.pose)
        for place, step in zip(places, series.series, strict=True):
            motion, repeated = transform_from_pose(step.step), RigidTransform()
            for _ in range(place):
                repeated = motion @ repeated
            pose = repeated @ pose
        x, y, z, rz, ry, rx = pose_from_transform(pose).tolist()
        found.append(("_".join([name, *map(str, places)]), (x, y, z, rz, ry, rx)))
    return tuple(found)


FRICTION = {"mu_static": 1.0, "mu_dynamic": 0.9}  # of all pieces and floors: the contacts of the Simulink library


def add_piece(robot: ET.Element, *, name: str, piece: PieceModel, parent: str, pose: RigidTransform) -> None:
    """Add a piece to a robot's URDF, in place, fixed to the link or frame ``parent`` at a pose in it.

    ``name`` is the new link's; its tool centre point is the frame ``<name>_tcp``, its others are ``<name>_<frame>``.
    """
    frame = next((frame for frame in robot.iterfind("frame") if frame.get("name") == parent), None)
    if frame is not None:
        parent, pose = frame.get("link", ""), pose_of(frame) @ pose
    _add_link(robot, name, piece)
    add_joint(robot, f"{name}_mount", parent=parent, child=name, pose=pose)


def piece_robot(name: str, piece: PieceModel) -> ET.Element:
    """Return the URDF of a piece that stands alone, with the frames ``<name>_tcp`` and ``<name>_<frame>``."""
    robot = ET.Element("robot", name=name)
    _add_link(robot, name, piece)
    return robot


def _add_link(robot: ET.Element, name: str, piece: PieceModel) -> None:
    link = ET.SubElement(robot, "link", name=name)
    if piece.mass > 0:
        set_inertia(link, mass=piece.mass, moments=piece.inertia, pose=RigidTransform(np.array(piece.com)))
    for index, (shape, shape_name) in enumerate(zip(piece.shapes, piece.shape_names, strict=True)):
        solid = shape.solid(piece.folder)
        if shape.visible:
            visual = add_solid(link, "visual", f"{name}_{index}", solid)
            add_colour(visual, f"{name}_{index}_colour", shape.colour or piece.colour)
        if shape.collides:
            add_contact(add_solid(link, "collision", f"{name}.{shape_name}", solid), FRICTION)
    for frame, pose in piece.frame_poses.items():
        add_frame(robot, f"{name}_{frame}", name, transform_from_pose(pose))
