"""The shapes of solids, outlines and mesh files among them: what a picture shows and, per density, what they weigh."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path, PureWindowsPath
from subprocess import SubprocessError, run
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from simrob_drake.base.extras import lacking
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.extensions.simulink.model.nodes import Node
from simrob_drake.importer.meshes.checks import MESH_FORMATS, UnreadableMesh
from simrob_drake.importer.meshes.library import obj_text
from simrob_drake.importer.meshes.parts import MeshPart, clean, combine_without_look
from simrob_drake.importer.meshes.places import in_any_case
from simrob_drake.importer.meshes.reading import read_mesh

_POINTS = np.array([np.roll([one, one, 1 - 2 * one], turn) for one in (0.445948490915965, 0.091576213509771)
                    for turn in (0, 2, 1)])  # fmt: skip
_WEIGHTS = np.repeat([0.223381589678011, 0.109951743655322], 3)
"""Quadrature over a triangle that is exact to degree four (Dunavant 1985)."""


def integral(outline: Vector, function: Callable[[Vector, Vector], Vector]) -> float:
    """Return the integral of a polynomial of degree at most four over the area inside an outline.

    Args:
        outline: corners in order, shape (n, 2) [m]; counterclockwise counts as positive.
        function: of x and y.
    """
    following = np.roll(outline, -1, axis=0)
    doubled = outline[:, 0] * following[:, 1] - outline[:, 1] * following[:, 0]
    # triangles from the origin, signed
    corners = np.stack([np.zeros_like(outline), outline, following], axis=1)
    points = np.einsum("qc,tcd->tqd", _POINTS, corners)
    values = function(points[..., 0], points[..., 1])
    return float((doubled / 2) @ (values @ _WEIGHTS))


def area(outline: Vector) -> float:
    """Return the area inside an outline [m²]; negative if its corners run clockwise."""
    return integral(outline, lambda x, y: np.ones_like(x))


def centre(outline: Vector) -> tuple[float, float]:
    """Return the middle of the area inside an outline [m]."""
    surface = area(outline)
    return integral(outline, lambda x, _: x) / surface, integral(outline, lambda _, y: y) / surface


def triangles(outline: Vector) -> Vector:
    """Return triangles that fill an outline, as indices of its corners, shape (m, 3).

    For pictures: an outline that a Delaunay net does not follow is filled roughly.
    """
    from matplotlib.path import Path as Way
    from scipy.spatial import Delaunay, QhullError

    try:
        net = Delaunay(outline).simplices
    except (QhullError, ValueError):
        return np.zeros((0, 3), dtype=int)
    return np.asarray(net[Way(outline).contains_points(outline[net].mean(axis=1))])


_SEGMENTS = 48  # of a full turn in pictures


@dataclass(frozen=True)
class Weight:
    """Mass of a body."""

    mass: float  # [kg]
    com: Vector  # centre of mass, shape (3,) [m]
    inertia: Vector  # about the centre of mass, shape (3, 3) [kg m²]

    def scaled(self, factor: float) -> Weight:
        """Return the same body of another density."""
        return Weight(self.mass * factor, self.com, self.inertia * factor)


@dataclass(frozen=True)
class Shape:
    """A shape about its own frame."""

    kind: str  # ``box`` (sides), ``cylinder`` (radius, length; along z), ``sphere`` (radius), ``mesh`` or ``plane``
    size: tuple[float, ...] = ()  # of a primitive, in metres
    mesh: MeshPart | None = None  # of the others


NOTHING = Weight(0.0, np.zeros(3), np.zeros((3, 3)))


def brick(node: Node, name: str = "BrickDimensions") -> tuple[Shape, Weight]:
    """Return a brick about its middle, with the weight of 1 kg/m³."""
    sides = positive(node, name, "[1 1 1]", 3)
    mass = float(np.prod(sides))
    squares = sides**2
    return Shape("box", tuple(sides)), Weight(
        mass, np.zeros(3), np.diag(mass / 12 * (squares.sum() - squares))
    )


def cylinder(node: Node) -> tuple[Shape, Weight]:
    """Return a cylinder along z about its middle, with the weight of 1 kg/m³."""
    (radius,), (length,) = (
        positive(node, "CylinderRadius", "1", 1),
        positive(node, "CylinderLength", "1", 1),
    )
    mass = np.pi * radius**2 * length
    across = mass * (3 * radius**2 + length**2) / 12
    inertia = np.diag([across, across, mass * radius**2 / 2])
    return Shape("cylinder", (radius, length)), Weight(mass, np.zeros(3), inertia)


def sphere(node: Node) -> tuple[Shape, Weight]:
    """Return a sphere, with the weight of 1 kg/m³."""
    (radius,) = positive(node, "SphereRadius", "1", 1)
    mass = 4 / 3 * np.pi * radius**3
    return Shape("sphere", (radius,)), Weight(mass, np.zeros(3), np.eye(3) * 0.4 * mass * radius**2)


def ellipsoid(node: Node) -> tuple[Shape, Weight]:
    """Return an ellipsoid, with the weight of 1 kg/m³."""
    radii = positive(node, "EllipsoidRadii", "[1 1 1]", 3)
    mass = float(4 / 3 * np.pi * np.prod(radii))
    squares = radii**2
    weight = Weight(mass, np.zeros(3), np.diag(mass / 5 * (squares.sum() - squares)))
    angle = np.linspace(0, np.pi, _SEGMENTS // 2 + 1)
    return Shape(
        "mesh",
        mesh=_turned(np.column_stack([np.sin(angle), np.cos(angle)])[::-1], 2 * np.pi, radii),
    ), weight


def extrusion(node: Node) -> tuple[Shape, Weight]:
    """Return an outline drawn out along z about its middle, with the weight of 1 kg/m³."""
    (length,) = positive(node, "ExtrusionLength", "1", 1)
    outline = extrusion_outline(node)
    surface = area(outline)
    x, y = centre(outline)
    xx = integral(outline, lambda x, _: x * x) - surface * x * x
    yy = integral(outline, lambda _, y: y * y) - surface * y * y
    xy = (integral(outline, lambda x, y: x * y) - surface * x * y) * length
    thick = surface * length**3 / 12
    inertia = np.array(
        [[yy * length + thick, -xy, 0], [-xy, xx * length + thick, 0], [0, 0, (xx + yy) * length]]
    )
    drawn = _skin(
        [np.column_stack([outline, np.full(len(outline), z)]) for z in (-length / 2, length / 2)],
        outline,
    )
    return Shape("mesh", mesh=drawn), Weight(surface * length, np.array([x, y, 0.0]), inertia)


def extrusion_outline(node: Node) -> Vector:
    """Return the corners of what is drawn out, counterclockwise, shape (n, 2) [m]."""
    if node.text("ExtrusionType", "General") != "Regular":
        return _outline(node, "ExtrusionCrossSection")
    (radius,) = positive(node, "PolygonOuterRadius", "1", 1)
    sides = round(node.number("PolygonNumSides", "3"))
    if not 3 <= sides <= 1000:
        raise node.refusal(
            message(
                "simulink.few_sides", "has {sides} sides; a polygon has at least three", sides=sides
            )
        )
    turns = 2 * np.pi * np.arange(sides) / sides
    return np.asarray(radius * np.column_stack([np.cos(turns), np.sin(turns)]))


def revolution(node: Node) -> tuple[Shape, Weight]:
    """Return an outline in the xz plane turned about z, with the weight of 1 kg/m³; a part turn is about that plane."""
    outline, angle = revolution_outline(node)
    if not 0 < angle <= 2 * np.pi + 1e-9 or outline[:, 0].min() < -1e-9:
        raise node.refusal(
            message(
                "simulink.outline_crosses_axis",
                "turns an outline that crosses the axis, or by more than one turn",
            )
        )
    mass = angle * integral(outline, lambda r, _: r)
    if mass <= 0:
        raise node.refusal(
            message("simulink.outline_without_area", "turns an outline without an area")
        )
    x = 2 * np.sin(angle / 2) * integral(outline, lambda r, _: r * r) / mass
    z = angle * integral(outline, lambda r, z: r * z) / mass
    rrr, rzz = integral(outline, lambda r, _: r**3), integral(outline, lambda r, z: r * z * z)
    rrz = integral(outline, lambda r, z: r * r * z)
    # of cos² and sin² over the angle
    along, across = (
        angle / 2 + np.sin(angle) / 2,
        angle / 2 - np.sin(angle) / 2,
    )
    about_origin = np.diag([rrr * across + angle * rzz, rrr * along + angle * rzz, angle * rrr])
    about_origin[0, 2] = about_origin[2, 0] = -2 * np.sin(angle / 2) * rrz
    com = np.array([x, 0.0, z])
    inertia = about_origin - mass * (com @ com * np.eye(3) - np.outer(com, com))
    return Shape("mesh", mesh=_turned(outline, angle, np.ones(3))), Weight(mass, com, inertia)


def revolution_outline(node: Node) -> tuple[Vector, float]:
    """Return the corners of what is turned, counterclockwise, shape (n, 2) [m], and by how much it is [rad]."""
    custom = node.text("RevolutionExtent", "Full") == "Custom"
    angle = node.number("RevolutionAngle", "360", unit="rad") if custom else 2 * np.pi
    return _outline(node, "RevolutionCrossSection"), angle


def positive(node: Node, name: str, default: str, size: int) -> Vector:
    """Return lengths, shape (size,) [m], that must be positive."""
    values = node.numbers(name, default, unit="m", size=size)
    if np.any(values <= 0):
        raise node.refusal(
            message(
                "simulink.length_not_positive",
                "{name} is {value}; lengths are positive",
                name=name,
                value=values.tolist(),
            )
        )
    return values


def _outline(node: Node, name: str) -> Vector:
    """Return corners in counterclockwise order, shape (n, 2) [m]."""
    corners = node.numbers(name, "[1 1; -1 1; -1 -1; 1 -1]", unit="m")
    if corners.size < 6 or corners.size % 2:
        raise node.refusal(
            message(
                "simulink.no_outline",
                "holds no outline in {name}: at least three corners, a row each",
                name=name,
            )
        )
    outline = corners.reshape(-1, 2)
    outline = outline[np.any(np.abs(outline - np.roll(outline, 1, axis=0)) > 1e-12, axis=1)]
    if len(outline) < 3 or abs(area(outline)) < 1e-15:
        raise node.refusal(
            message("simulink.encloses_no_area", "{name} encloses no area", name=name)
        )
    return outline if area(outline) > 0 else outline[::-1]


def _turned(outline: Vector, angle: float, scale: Vector) -> MeshPart:
    steps = max(3, int(np.ceil(_SEGMENTS * angle / (2 * np.pi))))
    turns = np.linspace(angle / 2, -angle / 2, steps + 1)
    rings = [
        np.column_stack([outline[:, 0] * np.cos(t), outline[:, 0] * np.sin(t), outline[:, 1]])
        for t in turns
    ]
    return _skin([ring * scale for ring in rings], outline if angle < 2 * np.pi - 1e-6 else None)


def _skin(rings: list[Vector], outline: Vector | None) -> MeshPart:
    """Return the faces between rings of corners (n, 3), one after the other, and over an outline at both ends."""
    count = len(rings[0])
    here = np.arange(count)
    following, above = np.roll(here, -1), np.roll(here, -1) + count
    band = np.vstack(
        [np.column_stack([here, following, above]), np.column_stack([here, above, here + count])]
    )
    faces: list[Any] = [band + step * count for step in range(len(rings) - 1)]
    if outline is not None:
        caps = triangles(outline)
        faces += [caps[:, ::-1], caps + (len(rings) - 1) * count]
    return MeshPart(np.vstack(rings), np.vstack(faces))


STEP = (".step", ".stp")
READ = (*MESH_FORMATS, *STEP)
_CONVERT = "import sys, cascadio; sys.exit(cascadio.step_to_glb(*sys.argv[1:]))"
_LONGEST = 120.0  # s, for one part
_UPRIGHT = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
"""What undoes the turn that glTF gets for its upward y: this one has z upward."""


class MeshFiles:
    """Finds meshes below given folders only."""

    def __init__(self, folders: Iterable[Path]) -> None:
        self._folders = [folder.resolve() for folder in folders]

    def of(self, node: Node) -> tuple[Path | None, float]:
        """Return the mesh of a File Solid and its scale to metres; None, and a note, where it cannot be had."""
        name = node.text("ExtGeomFileName")
        file = self._find(name) if name else None
        if file is None:
            if name:
                node.note(
                    "dropped",
                    message(
                        "simulink.mesh_not_below",
                        "the mesh {name} is not below the model's folder; give --mesh-path DIR",
                        name=name,
                    ),
                )
        elif file.suffix.lower() not in READ:
            node.note(
                "dropped",
                message(
                    "simulink.mesh_format",
                    "the mesh {name}: {suffix} is not read; convert it to STL",
                    name=name,
                    suffix=file.suffix,
                ),
            )
        elif file.suffix.lower() in STEP:  # it has units of its own
            return file, 1.0
        else:
            return file, node.in_si(node.text("ExtGeomFileUnits", "m"), "ExtGeomFileUnits", "m")
        return None, 1.0

    def weight(self, node: Node, file: Path | None, scale: float) -> Weight:
        """Return the weight of a mesh filled with 1 kg/m³.

        Raises InvalidModel: there is no mesh, or one that encloses nothing.
        """
        if file is None:
            raise node.refusal(
                message(
                    "simulink.weight_of_unread_mesh",
                    "its weight follows from the mesh {file}, which cannot be read",
                    file=node.text("ExtGeomFileName"),
                )
            )
        try:
            mesh = load_mesh(file)
        except UnreadableMesh as problem:
            raise node.refusal(
                message(
                    "simulink.weight_of_mesh",
                    "its weight follows from the mesh {file}, which {problem}",
                    file=file.name,
                    problem=problem,
                )
            ) from problem
        from trimesh.triangles import mass_properties

        properties = mass_properties((mesh.vertices * scale)[mesh.faces])
        if not properties.volume > 0:
            raise node.refusal(
                message(
                    "simulink.weight_of_open_mesh",
                    "its weight follows from the mesh {file}, which encloses no volume",
                    file=file.name,
                )
            )
        return Weight(
            float(properties.volume),
            np.asarray(properties.center_mass),
            np.asarray(properties.inertia),
        )

    def _find(self, name: str) -> Path | None:
        """Return the file in any folder: by its relative path, or by its name alone, in any case of letters."""
        parts = [
            part
            for part in PureWindowsPath(name).parts
            if part not in ("..", "\\", "/") and ":" not in part
        ]
        for folder in self._folders:
            for start in range(len(parts)):
                found = in_any_case(folder.joinpath(*parts[start:]))
                if found is not None and found.resolve().is_relative_to(folder):
                    return found
        return None


def load_mesh(file: Path) -> MeshPart:
    """Return the triangles of a mesh; no file is read but this one.

    Raises UnreadableMesh: it is too large, garbage, or holds no triangles; the text says what.
    """
    if file.suffix.lower() in STEP:
        return _from_step(file, file.stat().st_mtime_ns)
    parts = [part for part in map(clean, read_mesh(file, {}).parts) if len(part.faces)]
    if not parts:
        raise UnreadableMesh(message("simulink.no_area", "holds no triangle with an area"))
    return combine_without_look(parts)


@lru_cache(maxsize=8)  # a part is weighed, and then written
def _from_step(file: Path, _changed: int) -> MeshPart:
    """Return the faces of a STEP file [m], made by a process of its own, which a damaged file may end."""
    if find_spec("cascadio") is None:
        raise UnreadableMesh(lacking(message("simulink.is_step", "is STEP, which"), "step"))
    with TemporaryDirectory() as folder:
        target = Path(folder) / "part.glb"
        try:
            command = [sys.executable, "-c", _CONVERT, str(file.resolve()), str(target)]
            run(command, check=True, capture_output=True, timeout=_LONGEST)
            mesh = load_mesh(target)
        except (OSError, SubprocessError, UnreadableMesh) as problem:
            raise UnreadableMesh(
                message("simulink.no_solid_in_step", "holds no solid that can be read from STEP")
            ) from problem
    return MeshPart(mesh.vertices @ _UPRIGHT.T, mesh.faces)


def write_obj(mesh: MeshPart, target: Path) -> None:
    """Write triangles as OBJ, with the normals without which nothing renders them."""
    target.write_bytes(obj_text(mesh))
