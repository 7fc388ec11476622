"""Load a mesh file of any format into plain parts."""

import gc
import io
import logging
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import numpy as np

from simrob_drake.base.files import NotRead, TooLarge, content_of
from simrob_drake.base.frames import Vector
from simrob_drake.base.interrupts import heard_afterwards
from simrob_drake.base.messages import message
from simrob_drake.importer.meshes.checks import LARGEST_FILE, MESH_FORMATS, UnreadableMesh, check_mesh, decode
from simrob_drake.importer.meshes.parts import MeshPart, Rgba, decode_texture, face_count, group_by_look

_MOST_FACES = 1_500_000  # more take more than a gigabyte of memory to decimate
_MOST_SHADED = 200_000  # a mesh with more faces is decimated, which leaves nothing of its normals
_MOST_COLOURS = 16
"""A mesh with more vertex colours than that gets their mean: each colour is a shape of its own in the simulator."""


class MeshFile(NamedTuple):
    """What was read from a file."""

    parts: list[MeshPart]  # one for each colour or texture, in metres but for what a URDF's scale says
    data: bytes  # the bytes of the file, if it is an OBJ, which may stay as it is
    notes: list[str]  # what is worth knowing, in words


@heard_afterwards()
def read_mesh(path: Path, others: Mapping[str, Path]) -> MeshFile:
    """Read a mesh file that may be read, with the ``others`` that it may ask for, by the names that it uses for them.

    COLLADA's unit is applied; its up axis is not, as in ROS, where a URDF's origins are written for that. glTF has Y
    upwards by definition and is turned, as Drake turns it. Raises UnreadableMesh: it is too large, garbage, or holds no
    triangles; the text says what.
    """
    kind = path.suffix.lower()
    if kind not in MESH_FORMATS:
        raise UnreadableMesh(
            message(
                "importer.unread_format",
                "is of a format '{kind}' that is not read; {formats} are",
                kind=kind,
                formats=", ".join(MESH_FORMATS),
            )
        )
    data = mesh_content(path)
    content, notes = check_mesh(data, kind)
    try:
        with _quiet():
            parts = group_by_look(_parts(_loaded(content, kind, others), kind, notes))
    except UnreadableMesh:
        raise
    except Exception as problem:  # readers of damaged files raise whatever they like
        reason = " ".join(str(problem).split())[:120] or type(problem).__name__
        raise UnreadableMesh(
            message(
                "importer.not_readable_as",
                "is not readable as {kind} ({reason})",
                kind=kind.removeprefix(".").upper(),
                reason=reason,
            )
        ) from problem
    if not parts:
        raise UnreadableMesh(message("importer.no_triangles", "holds no triangles"))
    if face_count(parts) > _MOST_SHADED:
        gc.collect()  # the objects of mesh libraries hold each other: a quarter of a gigabyte for a million faces
    return MeshFile(parts, data if kind == ".obj" else b"", notes)


def mesh_content(path: Path) -> bytes:
    """Return the bytes of a mesh, or of a file of it; raises UnreadableMesh: it is too large, or cannot be read."""
    try:
        return content_of(path, LARGEST_FILE)
    except NotRead as problem:
        hint = (
            message("importer.decimate_it", "; decimate it, in MeshLab or Blender")
            if isinstance(problem, TooLarge)
            else ""
        )
        raise UnreadableMesh(
            message("importer.cannot_be_read_hint", "cannot be read ({problem}){hint}", problem=problem, hint=hint)
        ) from problem


def _loaded(data: bytes, kind: str, others: Mapping[str, Path]) -> Any:
    import trimesh

    name = kind.removeprefix(".")
    return trimesh.load_scene(io.BytesIO(data), file_type=name, resolver=_resolver(others), process=False)


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep a mesh library from writing its tracebacks and warnings on the screen: what matters is told by us."""
    log = logging.getLogger("trimesh")
    level = log.level
    log.setLevel(logging.CRITICAL)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        log.setLevel(level)


def _resolver(others: Mapping[str, Path]) -> Any:
    """Return what hands a mesh library the files that it asks for: those that were found and allowed, no other."""
    from trimesh.resolvers import Resolver

    class Allowed(Resolver):
        def __init__(self) -> None:
            pass

        def write(self, name: str, data: Any) -> NoReturn:
            raise NotImplementedError

        def namespaced(self, namespace: str) -> NoReturn:
            raise NotImplementedError

        def get(self, key: str) -> bytes:
            path = others.get(key.strip())
            if path is None:
                raise FileNotFoundError(key)
            data = content_of(path, LARGEST_FILE)
            return decode(data).encode() if path.suffix.lower() == ".mtl" else data

        def keys(self) -> list[str]:
            return list(others)

    return Allowed()


def _parts(scene: Any, kind: str, notes: list[str]) -> Iterator[MeshPart]:
    """Yield the parts of a scene, each geometry where its nodes place it."""
    from trimesh import Trimesh

    nodes = [(scene.graph[node]) for node in scene.graph.nodes_geometry]
    placed = [(matrix, scene.geometry[name]) for matrix, name in nodes]
    meshes = [(matrix, mesh) for matrix, mesh in placed if isinstance(mesh, Trimesh) and len(mesh.faces)]
    if sum(len(mesh.faces) for _, mesh in meshes) > _MOST_FACES:
        raise UnreadableMesh(
            message("importer.too_many_faces", "has more than {most} faces; decimate it", most=_MOST_FACES)
        )
    turn = _Y_UP if kind in (".gltf", ".glb") else np.eye(4)
    for matrix, mesh in meshes:
        place = turn @ (np.diag([*[_unit(mesh)] * 3, 1.0]) @ matrix if kind == ".dae" else matrix)
        if np.isfinite(place).all():
            yield from (part.transform(place) for part in _looks(mesh, kind, notes))


_Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, -1.0, 0], [0, 1.0, 0, 0], [0, 0, 0, 1.0]])


def _unit(mesh: Any) -> float:
    """Return COLLADA's unit [m]; 1 where it is none."""
    from trimesh.units import unit_conversion

    try:
        length = unit_conversion(mesh.units or "meters", "meters")
    except (AttributeError, KeyError, TypeError, ValueError):
        return 1.0
    return float(length) if np.isfinite(length) and length > 0 else 1.0


def _looks(mesh: Any, kind: str, notes: list[str]) -> Iterator[MeshPart]:
    """Yield the parts of one geometry, each with one colour or texture."""
    plain = _plain(mesh)
    lost = np.count_nonzero(~np.isfinite(plain.vertices[plain.faces]).all(axis=(1, 2)))
    if lost:
        notes.append(
            message(
                "importer.faces_without_corner",
                "{lost} faces with a corner that is no finite number left out",
                lost=lost,
            )
        )
    visual = mesh.visual
    if visual.kind == "texture":
        yield _textured(plain, mesh, kind)
    elif visual.kind in ("vertex", "face") and len(visual.face_colors) == len(mesh.faces):
        yield from _coloured(plain, visual.face_colors, notes)
    else:
        yield plain


def _plain(mesh: Any) -> MeshPart:
    """Return a geometry without its look; faces that point at no vertex are left out."""
    vertices = np.asarray(mesh.vertices, dtype=float).reshape(-1, 3)
    faces = np.asarray(mesh.faces, dtype=np.int64).reshape(-1, 3)
    normals = mesh._cache.cache.get("vertex_normals")  # asking the mesh for them would make them up
    part = MeshPart(vertices, faces)
    inside = np.all((faces >= 0) & (faces < len(vertices)), axis=1)
    lost = normals is None or np.shape(normals) != vertices.shape or len(faces) > _MOST_SHADED
    if lost or not inside.all():
        return part.only(inside)
    corners = np.asarray(normals, dtype=float)[faces]
    lengths = np.linalg.norm(corners, axis=-1)
    good = np.isfinite(corners).all() and bool((lengths > 1e-6).all())
    return MeshPart(vertices, faces, corners / lengths[..., None]) if good else part


def _textured(plain: MeshPart, mesh: Any, kind: str) -> MeshPart:
    """Return a geometry with its material: a texture where it has one that can be shown, else a colour."""
    material, uv = mesh.visual.material, mesh.visual.uv
    image = decode_texture(getattr(material, "baseColorTexture", None) or getattr(material, "image", None))
    colour = np.asarray(material.main_color, dtype=float)[:4] / 255
    if kind in (".gltf", ".glb"):  # glTF's factors are amounts of light
        colour[:3] = np.where(colour[:3] <= 0.0031308, 12.92 * colour[:3], 1.055 * colour[:3] ** (1 / 2.4) - 0.055)
    opacity = getattr(material, "kwargs", {}) or {}
    try:  # MTL: d is the opacity, Tr is what lacks to it
        alpha = float(opacity["d"][0]) if "d" in opacity else 1 - float(opacity["tr"][0]) if "tr" in opacity else None
    except (ValueError, IndexError, TypeError):
        alpha = None
    rgba = _rgba([*colour[:3], colour[3] if alpha is None else alpha])
    if image is not None and uv is not None and len(uv) == len(mesh.vertices) and len(plain.faces) == len(mesh.faces):
        corners = np.asarray(uv, dtype=float)[plain.faces][..., :2]
        if np.isfinite(corners).all():
            return MeshPart(plain.vertices, plain.faces, plain.normals, corners, image=image)
    return MeshPart(plain.vertices, plain.faces, plain.normals, rgba=rgba)


def _coloured(plain: MeshPart, colours: Any, notes: list[str]) -> Iterator[MeshPart]:
    """Yield a part for each colour of the faces, or one with their mean where they are many."""
    if len(plain.faces) != len(colours):
        yield plain
        return
    distinct, which = np.unique(np.asarray(colours), axis=0, return_inverse=True)
    if len(distinct) > _MOST_COLOURS:
        notes.append(
            message(
                "importer.colours_become_mean", "{count} colours of its vertices become their mean", count=len(distinct)
            )
        )
        distinct, which = np.mean(colours, axis=0, keepdims=True), np.zeros(len(colours), dtype=int)
    for index, colour in enumerate(distinct):
        part = plain.only(which.reshape(-1) == index)
        yield MeshPart(part.vertices, part.faces, part.normals, rgba=_rgba(np.asarray(colour) / 255))


def _rgba(colour: Any) -> Rgba:
    """Return a colour with figures from 0 to 1; one that nobody could see is opaque instead."""
    values: Vector = np.nan_to_num(np.clip(np.asarray(colour, dtype=float), 0, 1), nan=1.0).round(4)
    red, green, blue, alpha = values.tolist()
    return red, green, blue, alpha if alpha > 0.01 else 1.0
