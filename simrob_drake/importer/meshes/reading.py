"""Read mesh files of all formats as :class:`MeshPart`.

The library trimesh parses the files. It may open only those further files that the caller has found and allowed. This
module converts its scenes: one part for each colour or texture, in the place in which the scene's nodes put it.
"""

import gc
import io
import logging
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import numpy as np

from simrob_drake.base.files import NotRead, TooLarge, content_of
from simrob_drake.base.frames import Vector
from simrob_drake.base.interrupts import heard_afterwards
from simrob_drake.base.messages import message
from simrob_drake.importer.meshes.checks import (
    LARGEST_FILE,
    MESH_FORMATS,
    UnreadableMesh,
    check_mesh,
    decode,
)
from simrob_drake.importer.meshes.parts import (
    MeshPart,
    Rgba,
    decode_texture,
    face_count,
    group_by_look,
)

_MOST_FACES = 1_500_000
"""Meshes with more faces are refused, because their simplification takes more than a gigabyte of memory."""

_MOST_SHADED = 200_000
"""Meshes with more faces lose their normals, because they are simplified, after which normals do not fit any more."""

_MOST_COLOURS = 16
"""A mesh with more colours gets their mean, because each colour is a shape of its own in the simulator."""

_LONGEST_REASON = 120
"""Largest count of characters of a library's error in a message."""

_LEAST_NORMAL = 1e-6
"""Least length of a normal that has a direction."""

_LEAST_OPACITY = 0.01
"""A part with less opacity would be invisible, which is mostly an error of the exporter. It becomes opaque."""

_Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, -1.0, 0], [0, 1.0, 0, 0], [0, 0, 0, 1.0]])
"""Rotation by 90 degrees about x, which turns y to z."""


class MeshFile(NamedTuple):
    """The content of a mesh file.

    Attributes:
        parts: one for each colour or texture, in metres, before the scale of the URDF.
        data: the bytes of the file if it is an OBJ, which may be copied as it is; else empty.
        notes: sentences for the user about repairs and about content that is ignored.
    """

    parts: list[MeshPart]
    data: bytes
    notes: list[str]


@heard_afterwards()
def read_mesh(path: Path, others: Mapping[str, Path]) -> MeshFile:
    """Read a mesh file.

    The length unit of a COLLADA file is applied. Its up axis is ignored, as in ROS, where the origins in URDFs are
    written for that. glTF files are rotated from y up to z up, as Drake does.

    Args:
        path: the file.
        others: the files to which the mesh may refer, by their names in it. It cannot open other files.

    Raises:
        UnreadableMesh: the file has a format that is not read, is too large or damaged, or contains no triangles.
    """
    suffix = path.suffix.lower()
    if suffix not in MESH_FORMATS:
        raise UnreadableMesh(
            message(
                "importer.unread_format",
                "has the format '{kind}', which is not read; the formats are {formats}",
                kind=suffix,
                formats=", ".join(MESH_FORMATS),
            )
        )
    data = mesh_content(path)
    checked = check_mesh(data, suffix)
    # The list is shared: the functions below append to it.
    notes = checked.notes
    try:
        with _without_output():
            scene = _load_scene(checked.data, suffix, others)
            parts = group_by_look(_scene_parts(scene, suffix, notes))
    except UnreadableMesh:
        raise
    except Exception as problem:  # for damaged files, libraries raise errors of all classes
        reason = " ".join(str(problem).split())[:_LONGEST_REASON] or type(problem).__name__
        raise UnreadableMesh(
            message(
                "importer.not_readable_as",
                "is not readable as {kind} ({reason})",
                kind=suffix.removeprefix(".").upper(),
                reason=reason,
            )
        ) from problem
    if not parts:
        raise UnreadableMesh(message("importer.no_triangles", "contains no triangles"))
    if face_count(parts) > _MOST_SHADED:
        # The objects of trimesh refer to each other, so that only the collector frees them: a quarter of a gigabyte
        # for a million faces.
        gc.collect()
    return MeshFile(parts, data if suffix == ".obj" else b"", notes)


def mesh_content(path: Path) -> bytes:
    """Read the bytes of a mesh file, or of a file to which it refers.

    Raises:
        UnreadableMesh: the file is too large or cannot be read.
    """
    try:
        return content_of(path, LARGEST_FILE)
    except NotRead as problem:
        hint = ""
        if isinstance(problem, TooLarge):
            hint = message("importer.decimate_it", "; decimate the mesh, in MeshLab or Blender")
        raise UnreadableMesh(
            message(
                "importer.cannot_be_read_hint",
                "cannot be read ({problem}){hint}",
                problem=problem,
                hint=hint,
            )
        ) from problem


def _load_scene(data: bytes, suffix: str, others: Mapping[str, Path]) -> Any:
    """Parse a mesh file with trimesh.

    Args:
        data: the bytes of the file.
        suffix: its format, such as ``.stl``.
        others: the files to which it may refer, by their names in it.

    Returns:
        a ``trimesh.Scene``: geometries, and a graph of nodes that place them.
    """
    import trimesh

    format_name = suffix.removeprefix(".")
    return trimesh.load_scene(
        io.BytesIO(data), file_type=format_name, resolver=_resolver(others), process=False
    )


@contextmanager
def _without_output() -> Iterator[None]:
    """Suppress the warnings and tracebacks that trimesh prints. The errors that matter are reported by this module."""
    log = logging.getLogger("trimesh")
    level = log.level
    # The level is restored afterwards, since other code may use trimesh and its log.
    log.setLevel(logging.CRITICAL)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        log.setLevel(level)


def _resolver(others: Mapping[str, Path]) -> Any:
    """Create the object through which trimesh opens further files. It opens the given ones only.

    Args:
        others: the files by their names in the mesh.
    """
    from trimesh.resolvers import Resolver

    class AllowedFiles(Resolver):
        """Opens the given files by their names in the mesh. Its methods are those that trimesh calls."""

        # The constructor of the base class is abstract.
        def __init__(self) -> None:
            pass

        def write(self, name: str, data: Any) -> NoReturn:
            raise NotImplementedError

        def namespaced(self, namespace: str) -> NoReturn:
            raise NotImplementedError

        def get(self, key: str) -> bytes:
            """Read a file by its name in the mesh; other names are missing files."""
            path = others.get(key.strip())
            if path is None:
                raise FileNotFoundError(key)
            data = content_of(path, LARGEST_FILE)
            # trimesh expects material libraries in UTF-8.
            return decode(data).encode() if path.suffix.lower() == ".mtl" else data

        def keys(self) -> list[str]:
            return list(others)

    return AllowedFiles()


class _PlacedMesh(NamedTuple):
    """A geometry of a scene at one of its places.

    Attributes:
        matrix: transform from the geometry to the scene, shape (4, 4).
        mesh: the geometry, a ``trimesh.Trimesh``.
    """

    matrix: Vector
    mesh: Any


def _scene_parts(scene: Any, suffix: str, notes: list[str]) -> Iterator[MeshPart]:
    """Yield the parts of a scene, in metres; those of a glTF file with z up. The up axis of other files is ignored.

    A geometry at a place whose transform is not finite is left out without a note.

    Args:
        scene: the ``trimesh.Scene``.
        suffix: format of the file, such as ``.dae``.
        notes: gets sentences about content that is left out.

    Raises:
        UnreadableMesh: the scene has too many faces.
    """
    from trimesh import Trimesh

    # A geometry has a place for each node that uses it.
    placed_meshes = []
    for node in scene.graph.nodes_geometry:
        matrix, name = scene.graph[node]
        geometry = scene.geometry[name]
        # Scenes may contain curves and points, too.
        if isinstance(geometry, Trimesh) and len(geometry.faces):
            placed_meshes.append(_PlacedMesh(matrix, geometry))
    # Checked before any geometry is converted: a small file can use one geometry thousands of times.
    if sum(len(placed.mesh.faces) for placed in placed_meshes) > _MOST_FACES:
        raise UnreadableMesh(
            message(
                "importer.too_many_faces",
                "has more than {most} faces; decimate the mesh",
                most=_MOST_FACES,
            )
        )

    to_z_up = _Y_UP if suffix in (".gltf", ".glb") else np.eye(4)
    for placed in placed_meshes:
        matrix = placed.matrix
        if suffix == ".dae":
            unit = _collada_unit(placed.mesh)
            matrix = np.diag([unit, unit, unit, 1.0]) @ matrix
        transform = to_z_up @ matrix
        # A node with a damaged transform would place its vertices nowhere.
        if np.isfinite(transform).all():
            for part in _geometry_parts(placed.mesh, suffix, notes):
                yield part.transform(transform)


def _collada_unit(mesh: Any) -> float:
    """Length unit of a COLLADA file [m]. It is 1 if the file has none that is known."""
    from trimesh.units import unit_conversion

    try:
        length = unit_conversion(mesh.units or "meters", "meters")
    except (AttributeError, KeyError, TypeError, ValueError):
        return 1.0
    return float(length) if np.isfinite(length) and length > 0 else 1.0


def _geometry_parts(mesh: Any, suffix: str, notes: list[str]) -> Iterator[MeshPart]:
    """Yield the parts of one geometry, each with one colour or texture.

    Args:
        mesh: the geometry, a ``trimesh.Trimesh``.
        suffix: format of the file, such as ``.dae``.
        notes: gets sentences about content that is left out.
    """
    bare = _part_without_look(mesh)
    # Only counted here. The faces are removed when the mesh is cleaned.
    is_finite = np.isfinite(bare.vertices[bare.faces]).all(axis=(1, 2))
    lost = np.count_nonzero(~is_finite)
    if lost:
        notes.append(
            message(
                "importer.faces_without_corner",
                "has {lost} faces with a corner that is not a finite number, which are left out",
                lost=lost,
            )
        )
    visual = mesh.visual
    if visual.kind == "texture":
        yield _part_with_material(bare, mesh, suffix)
    # trimesh converts colours of vertices to those of faces.
    elif visual.kind in ("vertex", "face") and len(visual.face_colors) == len(mesh.faces):
        yield from _split_by_colour(bare, visual.face_colors, notes)
    else:
        yield bare


def _part_without_look(mesh: Any) -> MeshPart:
    """Convert a geometry, without its colour or texture. Faces with indices of vertices that do not exist are left out.

    The normals of the file are kept if all faces and normals are valid, and the mesh is not so large that it will be
    simplified.
    """
    vertices = np.asarray(mesh.vertices, dtype=float).reshape(-1, 3)
    faces = np.asarray(mesh.faces, dtype=np.int64).reshape(-1, 3)
    part = MeshPart(vertices, faces)
    is_valid = np.all((faces >= 0) & (faces < len(vertices)), axis=1)

    # The property vertex_normals would compute normals if the file has none. The cache has those of the file only.
    normals = mesh._cache.cache.get("vertex_normals")
    has_normals = normals is not None and np.shape(normals) == vertices.shape
    if not has_normals or len(faces) > _MOST_SHADED or not is_valid.all():
        return part.only(is_valid)

    corner_normals = np.asarray(normals, dtype=float)[faces]
    lengths = np.linalg.norm(corner_normals, axis=-1)
    has_directions = np.isfinite(corner_normals).all() and bool((lengths > _LEAST_NORMAL).all())
    # One wrong normal makes all of them doubtful. New ones are computed when the mesh is written.
    if not has_directions:
        return part
    return MeshPart(vertices, faces, corner_normals / lengths[..., None])


def _part_with_material(bare: MeshPart, mesh: Any, suffix: str) -> MeshPart:
    """Give a part the material of its geometry: the texture if there is a usable one, else the colour.

    Args:
        bare: the part without colour and texture.
        mesh: the geometry, a ``trimesh.Trimesh``.
        suffix: format of the file, such as ``.glb``.
    """
    material = mesh.visual.material
    uv = mesh.visual.uv
    image = decode_texture(
        getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    )
    # Texture coordinates belong to vertices. They fit only if no face was left out.
    has_coordinates = (
        uv is not None and len(uv) == len(mesh.vertices) and len(bare.faces) == len(mesh.faces)
    )
    if image is not None and has_coordinates:
        corners = np.asarray(uv, dtype=float)[bare.faces][..., :2]
        if np.isfinite(corners).all():
            return replace(bare, uv=corners, image=image)
    return replace(bare, rgba=_material_colour(material, suffix))


def _material_colour(material: Any, suffix: str) -> Rgba:
    """Read the colour and the opacity of a material.

    Args:
        material: the material of trimesh.
        suffix: format of the file, such as ``.glb``.
    """
    colour = np.asarray(material.main_color, dtype=float)[:4] / 255
    if suffix in (".gltf", ".glb"):
        # The colours of glTF are linear in the amount of light. The equation converts them to sRGB (IEC 61966-2-1):
        # 12.92 c for c <= 0.0031308, and 1.055 c^(1/2.4) - 0.055 above.
        linear = colour[:3]
        colour[:3] = np.where(
            linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055
        )
    # trimesh ignores the opacity of OBJ materials.
    opacity = _mtl_opacity(material)
    return _rgba([*colour[:3], colour[3] if opacity is None else opacity])


def _mtl_opacity(material: Any) -> float | None:
    """Read the opacity of a material of an OBJ file. Returns None if it has none, or one that is no number."""
    entries = getattr(material, "kwargs", {}) or {}
    try:
        if "d" in entries:
            return float(entries["d"][0])
        if "tr" in entries:
            return 1 - float(entries["tr"][0])  # Tr is the transparency
    except (ValueError, IndexError, TypeError):
        return None
    return None


def _split_by_colour(bare: MeshPart, colours: Any, notes: list[str]) -> Iterator[MeshPart]:
    """Yield a part for each colour of the faces, or one with their mean if there are too many colours.

    Args:
        bare: the part without colour.
        colours: red, green, blue and opacity of each face, shape (m, 4), from 0 to 255.
        notes: gets a sentence if the mean is taken.
    """
    if len(bare.faces) != len(colours):
        # Invalid faces were left out, so that it is unknown which colour belongs to which face.
        yield bare
        return
    distinct, colour_index = np.unique(np.asarray(colours), axis=0, return_inverse=True)
    if len(distinct) > _MOST_COLOURS:
        notes.append(
            message(
                "importer.colours_become_mean",
                "has {count} colours of vertices, which their mean replaces",
                count=len(distinct),
            )
        )
        # Such colours are mostly a painted surface. The mean shows its tone.
        distinct = np.mean(colours, axis=0, keepdims=True)
        colour_index = np.zeros(len(colours), dtype=int)
    for index, colour in enumerate(distinct):
        part = bare.only(colour_index.reshape(-1) == index)
        yield replace(part, rgba=_rgba(np.asarray(colour) / 255))


def _rgba(colour: Any) -> Rgba:
    """Limit the numbers of a colour to 0 to 1, and make an invisible colour opaque."""
    limited = np.clip(np.asarray(colour, dtype=float), 0, 1)
    # Four digits, so that colours that differ by rounding only are one material.
    values: Vector = np.nan_to_num(limited, nan=1.0).round(4)
    red, green, blue = values[:3].tolist()
    opacity = float(values[3])
    return red, green, blue, opacity if opacity > _LEAST_OPACITY else 1.0
