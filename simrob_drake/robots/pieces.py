"""Pieces: work objects, tools and loads. A piece is a rigid body with a mass, named frames, a colour and shapes.

A piece is read from a file ``piece.yaml``, and written as a link of a URDF. The file may give the mass and the inertia,
or a density from which they follow.
"""

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Annotated, Any, cast

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
    validate_section,
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
    name_of,
    pose_of,
    set_inertia,
    six_moments,
)

_NOTHING = 1e-12
"""Share of the largest moment of inertia below which a product of inertia is a rounding error."""


@dataclass(frozen=True)
class SolidInertia:
    """Volume, centre and moments of a body with an even density.

    Attributes:
        volume: the volume, positive [m³].
        centre: the centre of mass, shape (3,) [m].
        moments: moments of inertia about the centre for a density of 1 kg/m³: Ixx Iyy Izz Ixy Ixz Iyz, shape (6,) [m⁵].
    """

    volume: float
    centre: Vector
    moments: Vector


def solid_inertia(solids: Sequence[Solid], *, closed: bool) -> SolidInertia:
    """Compute volume, centre and moments of several solids as one body.

    The common volume of two solids that overlap counts twice.

    Args:
        solids: the solids, at least one.
        closed: whether every mesh must enclose a volume. If not, a mesh that does not counts as its convex hull.

    Raises:
        InvalidModel: Drake cannot read a mesh, or a mesh must enclose a volume and does not.
    """
    # With a density of 1 kg/m³, the mass is the volume.
    inertias = []
    origins = np.array([solid.pose.translation() for solid in solids])
    for solid in solids:
        if isinstance(solid.shape, Path):
            inertia = _mesh_inertia(solid.shape, solid.scale, closed, file_state(solid.shape))
        else:
            inertia = CalcSpatialInertia(solid.shape, 1.0)
        # In the axes of the body, still about the origin of the solid.
        inertias.append(inertia.ReExpress(solid.pose.rotation()))

    # The common centre is the mean of the centres, weighted with the volumes: Σ V c / Σ V.
    volumes = np.array([inertia.get_mass() for inertia in inertias])
    centres = origins + np.array([inertia.get_com() for inertia in inertias])
    centre = volumes @ centres / volumes.sum()

    # Moments add up once all of them are about the common centre.
    about_centre = []
    for inertia, origin in zip(inertias, origins, strict=True):
        shifted = inertia.Shift(centre - origin)
        about_centre.append(shifted.CalcRotationalInertia().CopyToFullMatrix3())
    # A symmetric body has products of inertia of 0. Rounding errors would be written into files as long numbers.
    moments = six_moments(np.sum(about_centre, axis=0))
    is_rounding = abs(moments) < _NOTHING * moments.max()
    return SolidInertia(
        volume=float(volumes.sum()), centre=centre, moments=np.where(is_rounding, 0.0, moments)
    )


@lru_cache(maxsize=64)
def _mesh_inertia(
    file: Path, scale: float, closed: bool, state: FileState | None
) -> SpatialInertia:
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
                "is not an OBJ mesh that encloses a volume, so that its mass does not follow from a density; "
                "give the mass instead",
            )
            raise InvalidModel(file, "", problem)
        # Drake computes the integrals over the faces of a mesh, which have no meaning if the mesh has holes.
        shape = Mesh(str(file), scale) if encloses_volume else Convex(str(file), scale)
        return CalcSpatialInertia(shape, 1.0)
    # Failed assertions of Drake come as SystemExit.
    except (RuntimeError, ValueError, SystemExit) as problem:
        # The error of an open mesh, raised above, is one of these classes, too.
        if isinstance(problem, InvalidModel):
            raise
        raise InvalidModel(
            file,
            "",
            message(
                "robots.drake_cannot_read",
                "Drake cannot read this file: {problem}",
                problem=" ".join(str(problem).split()),
            ),
        ) from problem


def _is_closed(file: Path) -> bool:
    """Whether an OBJ mesh encloses a volume. Other files count as open.

    Every edge of such a mesh has a face on either side, and its faces look outwards: the corners of a face are in
    counterclockwise order, seen from outside.
    """
    if file.suffix.lower() != ".obj":
        return False
    # Drake splits faces with more than three corners into triangles.
    surface = ReadObjToTriangleSurfaceMesh(str(file))
    faces = np.array([[face.vertex(corner) for corner in range(3)] for face in surface.triangles()])
    points = np.array(surface.vertices())
    # Drake does not refuse a face whose points do not exist.
    if faces.max() >= len(points):
        return False

    # The volume is a sixth of the sum of a · (b × c) over the faces. It is negative if the faces look inwards.
    a, b, c = points[faces.T]
    six_volumes = np.einsum("ij,ij->", a, np.cross(b, c))
    if six_volumes <= 0:
        return False

    # The two faces at an edge pass it in opposite directions. So all edges, reversed, must be the same edges again.
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    return np.array_equal(_sorted_rows(edges), _sorted_rows(edges[:, ::-1]))


def mesh_sides(file: Path, scale: float) -> tuple[float, ...]:
    """Sides of the box that encloses a scaled OBJ mesh, along the axes of the mesh, shape (3,) [m].

    Args:
        file: the OBJ file.
        scale: factor from the unit of the file to metres.
    """
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
    """Sort the rows of a matrix, so that two matrices can be compared as sets of rows."""
    return rows[np.lexsort(rows.T)]


TCP = "tcp"
"""Name of the tool centre point, a frame that every piece has."""

FORMS = ("box", "cylinder", "sphere")
"""Keys of the shapes that are no meshes."""

_MOST_FRAMES = 1000
"""Largest count of frames of one series."""


class PieceShape(Strict):
    """One shape of a piece: exactly one of box, cylinder, sphere and mesh."""

    box: tuple[Positive, Positive, Positive] | None = None
    """Sides of a box [m]."""
    cylinder: tuple[Positive, Positive] | None = None
    """Radius and length of a cylinder along z [m]."""
    sphere: Positive | None = None
    """Radius of a sphere [m]."""
    mesh: str | None = None
    """A mesh file in the piece's folder, in a format that Drake reads. In contacts it counts as its convex hull."""
    scale: Positive = 1.0
    """Scale of the mesh; 0.001 for a mesh in millimetres."""
    pose: Pose = ORIGIN
    """Pose of the shape in the piece's frame, [x y z Rz Ry Rx]."""
    colour: Colour | None = None
    """Red, green, blue, opacity; the colour of the piece unless given."""
    name: str | None = None
    """Name of the shape; sensors call it `<piece>.<name>`. Its number unless given."""
    collides: bool = True
    """Whether the shape takes part in contact."""
    visible: bool = True
    """Whether the shape is drawn."""

    def solid(self, folder: Path) -> Solid:
        """Make the solid of the shape, in the piece's frame.

        Args:
            folder: folder in which the file of a mesh is looked for.

        Raises:
            InvalidModel: the file of a mesh is missing, is outside the folder, or has a format that Drake does not
                read.
        """
        pose = transform_from_pose(self.pose)
        if self.box is not None:
            return Solid(pose, Box(*self.box))
        if self.cylinder is not None:
            return Solid(pose, Cylinder(*self.cylinder))
        if self.sphere is not None:
            return Solid(pose, Sphere(self.sphere))
        return Solid(pose, mesh_file(str(self.mesh), folder), self.scale)

    @model_validator(mode="after")
    def _check_kind(self) -> "PieceShape":
        """Check that exactly one kind of shape is given. Raises ValueError, which pydantic reports with the key."""
        # Two keys in one shape are usually two shapes without a dash between them.
        kinds = (self.box, self.cylinder, self.sphere, self.mesh)
        if sum(kind is not None for kind in kinds) != 1:
            raise ValueError(
                message(
                    "robots.one_of_shapes",
                    "a shape needs exactly one of the keys box, cylinder, sphere and mesh",
                )
            )
        return self


class Repeat(Strict):
    """One direction of a series of frames."""

    count: Annotated[Integer, Field(ge=1, le=_MOST_FRAMES)]
    """Count of frames in this direction."""
    step: Pose
    """Motion from each frame to the next, [x y z Rz Ry Rx] in the piece's frame."""


class FrameSeries(Strict):
    """Frames at even steps. Their names are ``<name>_<i>``, or ``<name>_<i>_<j>`` in rows and columns, from 0."""

    pose: Pose
    """Pose of the first frame, [x y z Rz Ry Rx] in the piece's frame."""
    series: Annotated[tuple[Repeat, ...], Field(min_length=1)]
    """One direction for a row, two for rows and columns."""


class PieceModel(Strict):
    """A piece as its ``piece.yaml`` describes it. A station may replace any of the values.

    With a ``density``, or with a mass but no inertia, the shapes count as evenly filled: the mass, the centre of mass
    and the inertia that are not given follow from them (:func:`with_mass_properties`).
    """

    folder: Path
    """Folder of the piece's file, from which paths of meshes start."""
    description: str = ""
    """Description of the piece in one line."""
    density: Positive | None = None
    """Density of the material [kg/m³], in place of a mass."""
    mass: NotNegative = 0.0
    """Mass [kg]."""
    com: Place = (0.0, 0.0, 0.0)
    """Centre of mass, in the piece's frame [m]."""
    inertia: Inertia = (0.0, 0.0, 0.0)
    """Moments Ixx Iyy Izz about the centre of mass [kg m²]; six numbers, with Ixy Ixz Iyz, if these are not zero."""
    tcp: Pose = ORIGIN
    """Tool centre point, [x y z Rz Ry Rx] in the piece's frame."""
    frames: dict[str, Pose | FrameSeries] = Field(default_factory=dict)
    """Further frames by name: poses in the piece's frame, or series of them."""
    colour: Colour = (0.6, 0.6, 0.65, 1.0)
    """Red, green, blue, opacity of the shapes that have no colour of their own."""
    shapes: tuple[PieceShape, ...] = ()
    """Shapes that are drawn, and that touch other bodies."""

    @model_validator(mode="after")
    def _check_values(self) -> "PieceModel":
        """Check that values do not contradict each other, and that each frame has a name of its own.

        Raises:
            ValueError: both a mass and a density are given, a series has too many frames, or two frames have the same
                name or one that is not allowed; pydantic reports the error with the key.
        """
        # A mass of 0 that the file states contradicts a density as well; the default mass does not.
        if self.density is not None and "mass" in self.model_fields_set:
            raise ValueError(
                message("robots.mass_or_density", "a piece has either a mass or a density")
            )
        # Counted before the frames are computed: a slip in a count must not fill the memory.
        series = [entry.series for entry in self.frames.values() if isinstance(entry, FrameSeries)]
        if any(np.prod([step.count for step in steps]) > _MOST_FRAMES for steps in series):
            raise ValueError(
                message(
                    "robots.too_many_frames",
                    "a series can have {most} frames at most",
                    most=_MOST_FRAMES,
                )
            )
        names = [name for name, _ in self._named_poses()]
        for index, name in enumerate(names):
            check_plain(name)
            if name in names[:index]:
                raise ValueError(
                    message(
                        "robots.frame_twice",
                        "there are two frames '{name}'; each frame needs a name of its own",
                        name=name,
                    )
                )
        return self

    @property
    def frame_poses(self) -> dict[str, Pose]:
        """Poses of all frames by name, the tool centre point ``tcp`` first: [x y z Rz Ry Rx] in the piece's frame."""
        return dict(self._named_poses())

    def _named_poses(self) -> list[tuple[str, Pose]]:
        """List all frames with their poses, those of series one by one. A name can be in the list twice."""
        frames = [(TCP, self.tcp)]
        for name, entry in self.frames.items():
            if isinstance(entry, FrameSeries):
                frames += _series_poses(entry, name)
            else:
                frames.append((name, entry))
        return frames

    @property
    def shape_names(self) -> list[str]:
        """Names of the shapes, in order. A shape without a name has its number."""
        return [shape.name or str(index) for index, shape in enumerate(self.shapes)]


def piece_names() -> list[str]:
    """Return the names of the pieces that come with the package and with extensions."""
    return list(piece_files())


def piece_file(name: str) -> Path:
    """Return the file of a piece of the package, or of an extension, by its name.

    Raises:
        UnknownName: there is no such piece.
    """
    file = model_file("pieces", name)
    if file is not None:
        return file
    # The name is unknown: this raises the error, with the nearest known name.
    return piece_files()[one_of(message("base.piece", "piece"), name, piece_names())]


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
    """Replace values of a piece, and compute the mass properties that follow from them.

    A new mass removes the density. A new density removes the mass, the centre of mass and the inertia, unless they are
    given as well. With a new mass, an inertia and a centre of mass that the piece's file gives stay as they are: the
    inertia is not scaled.

    Args:
        piece: the piece as its file describes it.
        changes: new values by key.
        where: where the changes are written, for messages.

    Raises:
        InvalidConfig: a new value is not allowed.
        InvalidModel: see :func:`with_mass_properties`.
    """
    # Only the values that the file gives are kept: defaults would look like values that the user has set.
    removed = set(changes)
    if "density" in changes:
        removed |= {"mass", "com", "inertia"}
    if "mass" in changes:
        removed.add("density")
    kept = {
        key: value
        for key, value in piece.model_dump(exclude_unset=True).items()
        if key not in removed
    }
    return with_mass_properties(validate_section(PieceModel, {**kept, **changes}, where))


def with_mass_properties(piece: PieceModel) -> PieceModel:
    """Compute the mass, the centre of mass and the inertia of a piece from its shapes, unless they are given.

    This is done for a piece with a density, and for one with a mass but no inertia. Shapes count as solid, and where
    two overlap, both count.

    Returns:
        the piece with these values and without a density; the same piece if nothing is to be computed.

    Raises:
        InvalidModel: a mesh cannot be read. For a piece with a density: a mesh does not enclose a volume, or the piece
            has no shapes.
    """
    # A value that the file states counts, even if it does not fit the shapes: they may be a likeness of the body only.
    stated_keys = piece.model_fields_set
    shapes = piece.shapes
    needs_no_shapes = "inertia" in stated_keys or piece.mass == 0 or not shapes
    if piece.density is None and needs_no_shapes:
        return piece
    if not shapes:
        raise InvalidModel(
            piece.folder,
            "density",
            message(
                "robots.density_without_shapes", "is given, but the piece has no shapes to fill"
            ),
        )
    whole = solid_inertia(
        [shape.solid(piece.folder) for shape in shapes], closed=piece.density is not None
    )
    # A mass without a density means the even density with which the shapes have this mass.
    density = piece.density or piece.mass / whole.volume
    computed: dict[str, Any] = {
        "mass": density * whole.volume,
        "com": tuple(whole.centre.tolist()),
        "inertia": tuple((density * whole.moments).tolist()),
    }
    update = {key: value for key, value in computed.items() if key not in stated_keys}
    return piece.model_copy(update={**update, "density": None})


_PIECES: FileCache[PieceModel] = FileCache(size=128)
"""The pieces that were read last, by the absolute paths of their files."""


def _read_piece(file: Path) -> PieceModel:
    """Read a piece from its YAML file, without a look at the cache. Raises the errors of `described_piece`."""
    piece = validate_section(PieceModel, {"folder": file.parent, **read_yaml(file)}, file)
    for shape in piece.shapes:
        if shape.mesh is not None:
            # This raises InvalidModel if the mesh is missing.
            mesh = mesh_file(shape.mesh, file.parent)
            # The cache records each file whose state is asked for, and so notices if the mesh is deleted.
            file_state(mesh)
    return piece


@lru_cache(maxsize=64)
def _series_poses(series: FrameSeries, name: str) -> tuple[tuple[str, Pose], ...]:
    """Compute the frames of a series, with the name and the pose [x y z Rz Ry Rx] of each in the piece's frame.

    Args:
        series: the first frame, and the directions in which it is repeated.
        name: beginning of the names; the index of a frame in each direction follows.
    """
    frames: list[tuple[str, Pose]] = []
    # The index of a frame has one number for each direction, such as (row, column).
    for indices in product(*(range(direction.count) for direction in series.series)):
        pose = transform_from_pose(series.pose)
        for index, direction in zip(indices, series.series, strict=True):
            # The motion of this direction, done as often as the index says, in the fixed axes of the piece.
            step = transform_from_pose(direction.step)
            motion = RigidTransform()
            for _ in range(index):
                motion = step @ motion
            pose = motion @ pose
        full_name = "_".join([name, *map(str, indices)])
        frames.append((full_name, cast(Pose, tuple(pose_from_transform(pose).tolist()))))
    return tuple(frames)


FRICTION = {"mu_static": 1.0, "mu_dynamic": 0.9}
"""Friction of all pieces and floors, by the names of the coefficients in Drake. The Simulink library has the same."""


def add_piece(
    robot: ET.Element, *, name: str, piece: PieceModel, parent: str, pose: RigidTransform
) -> None:
    """Add a piece to a robot's URDF, in place, as a link that is fixed to another link.

    Args:
        robot: the URDF.
        name: name of the new link. The tool centre point becomes the frame ``<name>_tcp``, any other frame
            ``<name>_<frame>``.
        piece: the piece.
        parent: name of the link or frame that carries the piece.
        pose: pose of the piece in this link or frame.
    """
    # The frame is looked up at this moment, since a piece before may have added it: tools can hang on tools.
    link = parent
    pose_in_link = pose
    # Joints connect links, so a frame is replaced by the link to which it belongs.
    for frame in robot.iterfind("frame"):
        if name_of(frame) == parent:
            link = frame.get("link", "")
            pose_in_link = pose_of(frame) @ pose
            break
    _add_link(robot, name, piece)
    add_joint(robot, f"{name}_mount", parent=link, child=name, pose=pose_in_link)


def piece_robot(name: str, piece: PieceModel) -> ET.Element:
    """Make the URDF of a piece that no robot carries, with the frames ``<name>_tcp`` and ``<name>_<frame>``."""
    robot = ET.Element("robot", name=name)
    _add_link(robot, name, piece)
    return robot


def _add_link(robot: ET.Element, name: str, piece: PieceModel) -> None:
    """Add the link of a piece to a URDF, in place, with its inertia, shapes and frames. No joint holds it yet.

    Args:
        robot: the ``robot`` element.
        name: name of the link, with which the names of its frames begin.
        piece: the piece. Without mass, the link has no inertia.
    """
    link = ET.SubElement(robot, "link", name=name)
    if piece.mass > 0:
        set_inertia(
            link, mass=piece.mass, moments=piece.inertia, pose=RigidTransform(np.array(piece.com))
        )
    for index, (shape, shape_name) in enumerate(zip(piece.shapes, piece.shape_names, strict=True)):
        solid = shape.solid(piece.folder)
        # A shape may be drawn, touch other bodies, or both: a fine mesh for the eye, a few boxes for contacts.
        if shape.visible:
            visual = add_solid(link, "visual", f"{name}_{index}", solid)
            add_colour(visual, f"{name}_{index}_colour", shape.colour or piece.colour)
        if shape.collides:
            collision = add_solid(link, "collision", f"{name}.{shape_name}", solid)
            add_contact(collision, FRICTION)
    for frame, pose in piece.frame_poses.items():
        add_frame(robot, f"{name}_{frame}", name, transform_from_pose(pose))
