"""Look into the bytes of a mesh file before a library does: what it asks for, and that nothing grows beyond it."""

import json
import math
import re
import struct
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn
from xml.sax.saxutils import unescape

from simrob_drake.base.errors import shortened
from simrob_drake.base.files import content_of
from simrob_drake.base.messages import message

MESH_FORMATS = (".stl", ".dae", ".obj", ".gltf", ".glb", ".ply", ".off")
"""Formats of meshes that are read, for robots, for pieces and for Simulink models."""
FORMATS_WITHOUT_UNIT = (".stl", ".obj", ".ply", ".off")
"""Formats that do not say in which unit they are; COLLADA does, and glTF is in metres."""
LARGEST_FILE = 100_000_000
"""Larger files are not read [bytes]: the largest mesh of a robot that is worth simulating has a tenth of it."""

_STL_HEADER, _STL_FACE = 84, 50  # bytes
_MOST_NODES = 20_000
_MOST_ITEMS = 30_000_000
_MOST_BYTES = 300_000_000
_MOST_TAGS = 1_000_000
_LARGEST_HEADER = 20_000_000  # bytes of JSON


def references(path: Path) -> list[str]:
    """Return the names, as written, of the files that a mesh or material library asks for; raises OSError: not read."""
    scan = _SCANS.get(path.suffix.lower())
    if scan is None:
        return []
    return list(
        dict.fromkeys(name for name in scan(content_of(path, LARGEST_FILE)) if name and not name.startswith("data:"))
    )


def gltf_header(data: bytes) -> Any:
    """Return the JSON of a glTF or GLB file; None if there is none."""
    if data[:4] == b"glTF":
        if len(data) < 20:
            return None
        data = data[20 : 20 + int(struct.unpack("<I", data[12:16])[0])]
    if len(data) > _LARGEST_HEADER:
        return None
    try:
        return json.loads(data.decode("utf-8-sig"))
    except (ValueError, RecursionError):
        return None


def _images(data: bytes) -> list[str]:
    images = (part.partition(b"</image>")[0] for part in re.split(rb"<image\b", data)[1:])
    found = (re.search(rb"<init_from>\s*+(?:<ref>)?([^<>]+)<", image) for image in images)  # elsewhere it names one
    return [unescape(_text(match.group(1))) for match in found if match]


def _uris(data: bytes) -> list[str]:
    header = gltf_header(data)
    if not isinstance(header, dict):
        return []
    listed = [header.get(key) for key in ("buffers", "images")]
    entries = [entry for entries in listed if isinstance(entries, list) for entry in entries if isinstance(entry, dict)]
    return [entry["uri"] for entry in entries if isinstance(entry.get("uri"), str)]


def decoded(data: bytes) -> str:
    """Return bytes as text: UTF-8, or else the encoding in which every byte is a letter."""
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _text(name: bytes) -> str:
    return decoded(name).strip()


class UnreadableMesh(Exception):
    """No mesh can be had from a file; the text says why."""


def checked(data: bytes, kind: str) -> tuple[bytes, list[str]]:
    """Return the bytes for a mesh library, and what was mended; raises UnreadableMesh: cut off, empty, too large."""
    if not data.strip(b"\0 \t\r\n"):
        raise UnreadableMesh(message("importer.is_empty", "is empty"))
    check: Callable[[bytes], tuple[bytes, list[str]]] | None = _CHECKS.get(kind)
    return (data, []) if check is None else check(data)


def _stl(data: bytes) -> tuple[bytes, list[str]]:
    """Cut what follows the last face of a binary STL off; one that has less than it says is no mesh."""
    if data.lstrip()[:5].lower() == b"solid" and b"\0" not in data[:1000]:  # binary ones may begin so, too
        return _obj(data)
    if len(data) < _STL_HEADER:
        raise UnreadableMesh(
            message(
                "importer.shorter_than_header",
                "is not readable as STL: {count} bytes are less than its header",
                count=len(data),
            )
        )
    (count,) = struct.unpack("<I", data[80:84])
    there = (len(data) - _STL_HEADER) // _STL_FACE
    if count > there:
        raise UnreadableMesh(
            message(
                "importer.faces_cut_off", "is cut off: of its {count} faces {there} are there", count=count, there=there
            )
        )
    if count == 0:
        raise UnreadableMesh(message("importer.no_triangles", "holds no triangles"))
    end = _STL_HEADER + count * _STL_FACE
    beyond = data[end:]
    if len(beyond) % _STL_FACE == 0 and beyond.strip(b"\0"):
        raise UnreadableMesh(
            message("importer.counts_faces", "counts {count} faces, and {there} are there", count=count, there=there)
        )
    return data[:end], [
        message("importer.bytes_left_out", "{count} bytes after its last face left out", count=len(beyond))
    ] if beyond else []


def _obj(data: bytes) -> tuple[bytes, list[str]]:
    """Write a text in UTF-8: comments and names of materials are often in another encoding."""
    return decoded(data).encode(), []


def _dae(data: bytes) -> tuple[bytes, list[str]]:
    """Refuse document types, entities, archives, and nodes that multiply; tell the up axis."""
    if data.count(b"<") > _MOST_TAGS:
        raise UnreadableMesh(
            message("importer.too_many_elements", "has more than {most} elements", most=_MOST_TAGS // 2)
        )
    try:
        root = ET.fromstring(data, ET.XMLParser(target=_Builder()))
    except (ET.ParseError, ValueError, LookupError) as problem:
        raise UnreadableMesh(
            message("importer.not_readable_dae", "is not readable as DAE ({problem})", problem=problem)
        ) from problem
    if _node_count(root) > _MOST_NODES:
        raise UnreadableMesh(
            message(
                "importer.too_many_nodes", "has more than {most} nodes, or nodes within themselves", most=_MOST_NODES
            )
        )
    unit = root.find("{*}asset/{*}unit")
    meter = "1" if unit is None else unit.get("meter", "1")
    try:
        metres = float(meter)
    except ValueError:
        metres = math.nan
    if not 0 < metres < math.inf:
        raise UnreadableMesh(message("importer.odd_unit", "has a unit of {meter} m", meter=shortened(meter)))
    up = (root.findtext("{*}asset/{*}up_axis") or "Y_UP").strip()
    return data, [] if up == "Z_UP" else [
        message("importer.up_axis_ignored", "its up axis {up} is ignored, as ROS does", up=up)
    ]


class _Builder(ET.TreeBuilder):
    """Builds elements, but of no file with a document type: before it nothing can be defined that grows."""

    def doctype(self, *_: Any) -> NoReturn:
        raise UnreadableMesh(
            message("importer.mesh_with_entities", "declares entities or a document type, which a mesh never needs")
        )


def _node_count(root: ET.Element) -> int:
    """Return how many nodes a COLLADA scene has once its instances are put in; too many for a circle."""
    named = {f"#{node.get('id')}": node for node in root.iter() if node.tag.endswith("}node")}
    counts: dict[int, int] = {}

    def count(node: ET.Element, depth: int) -> int:
        if id(node) not in counts:
            if depth > 200:
                return _MOST_NODES + 1
            counts[id(node)] = _MOST_NODES + 1  # until it is known: a node within itself
            targets = (named.get(child.get("url", "")) for child in node if child.tag.endswith("}instance_node"))
            inner = [child for child in node if child.tag.endswith("}node")]
            below = (count(child, depth + 1) for child in (*inner, *(t for t in targets if t is not None)))
            counts[id(node)] = min(_MOST_NODES + 1, 1 + sum(below))
        return counts[id(node)]

    return max((count(scene, 0) for scene in root.iter() if scene.tag.endswith("}visual_scene")), default=0)


def _gltf(data: bytes) -> tuple[bytes, list[str]]:
    """Refuse files whose numbers and slices are larger than any mesh's."""
    header = gltf_header(data)
    if not isinstance(header, dict):
        raise UnreadableMesh(message("importer.not_readable_gltf", "is not readable as glTF"))
    items = sum(_numbers(header, "accessors", "count"))
    sliced = sum(_numbers(header, "bufferViews", "byteLength"))
    if items > _MOST_ITEMS or sliced > _MOST_BYTES or len(_numbers(header, "nodes", "mesh")) > _MOST_NODES:
        raise UnreadableMesh(message("importer.asks_too_many_numbers", "asks for more numbers than a mesh has"))
    return data, []


def _numbers(header: dict[str, Any], key: str, name: str) -> list[int]:
    """Return one figure of each entry of a list; 0 where there is none, too many where it is none."""
    entries = header.get(key, [])
    if not isinstance(entries, list):
        return [_MOST_BYTES + 1]
    values = [entry.get(name, 0) if isinstance(entry, dict) else None for entry in entries]
    return [value if type(value) is int and value >= 0 else _MOST_BYTES + 1 for value in values]


def _counted(data: bytes) -> tuple[bytes, list[str]]:
    """Refuse a PLY whose header counts more than the file has bytes."""
    head = data[: data.find(b"end_header")] if b"end_header" in data[:100_000] else data[:10_000]
    if any(int(count) > len(data) for count in re.findall(rb"element\s+\w+\s+(\d{1,18})\b", head)):
        raise UnreadableMesh(message("importer.header_counts_more", "is cut off: its header counts more than is there"))
    return data, []


_LIBRARY = re.compile(rb"^[ \t]*mtllib[ \t]+([^\r\n]+)", re.MULTILINE)
_COLOUR_MAP = re.compile(rb"^[ \t]*map_kd[ \t]+([^\r\n]+)", re.MULTILINE | re.IGNORECASE)
_SCANS: dict[str, Callable[[bytes], list[str]]] = {
    ".obj": lambda data: [_text(name) for name in _LIBRARY.findall(data)],
    ".mtl": lambda data: [_text(name) for name in _COLOUR_MAP.findall(data)],  # other maps change nothing that is shown
    ".dae": _images,
    ".gltf": _uris,
    ".glb": _uris,
}
_CHECKS: dict[str, Callable[[bytes], tuple[bytes, list[str]]]] = {
    ".stl": _stl,
    ".obj": _obj,
    ".dae": _dae,
    ".gltf": _gltf,
    ".glb": _gltf,
    ".ply": _counted,
}
