"""Check the bytes of mesh files before a library parses them, and find the files to which they refer.

The libraries that parse meshes trust a file's own counts and references. A small, damaged or malicious file could
therefore fill the memory. The checks here refuse such files and repair small damage, format by format.
"""

import json
import math
import re
import struct
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, NoReturn
from xml.sax.saxutils import unescape

from simrob_drake.base.errors import shorten
from simrob_drake.base.files import content_of
from simrob_drake.base.messages import message

MESH_FORMATS = (".stl", ".dae", ".obj", ".gltf", ".glb", ".ply", ".off")
"""Formats of meshes that are read, for robots, for pieces and for Simulink models."""

FORMATS_WITHOUT_UNIT = (".stl", ".obj", ".ply", ".off")
"""Formats that do not define their length unit. COLLADA files contain it, and glTF is in metres."""

LARGEST_FILE = 100_000_000
"""Largest mesh file that is read [bytes]. The meshes of robots have at most a tenth of this size."""

_STL_HEADER = 84
"""Size of a binary STL's header: 80 bytes of text and the count of faces [bytes]."""

_STL_FACE = 50
"""Size of a face in a binary STL [bytes]."""

_MOST_NODES = 20_000
"""Largest count of nodes in a scene."""

_MOST_ITEMS = 30_000_000
"""Largest count of numbers or vectors in a glTF file."""

_MOST_BYTES = 300_000_000
"""Largest size of a glTF file's buffer views together [bytes]."""

_MOST_TAGS = 1_000_000
"""Largest count of opening and closing tags in a COLLADA file."""

_LARGEST_HEADER = 20_000_000
"""Largest size of a glTF file's JSON [bytes]."""

_MOST_NESTED = 200
"""Largest depth of nested nodes in a COLLADA scene."""


class UnreadableMesh(Exception):
    """Raised when a file contains no usable mesh. The text of the error is the reason."""


class CheckedMesh(NamedTuple):
    """The content of a mesh file that may be given to a library.

    Attributes:
        data: the bytes of the file, with small damage repaired.
        notes: sentences for the user about repairs and about content that is ignored.
    """

    data: bytes
    notes: list[str]


def references(path: Path) -> list[str]:
    """Find the names of the files to which a mesh or a material library refers.

    Raises:
        OSError: the file cannot be read.
    """
    find_names = _REFERENCE_FINDERS.get(path.suffix.lower())
    if find_names is None:
        return []
    names = find_names(content_of(path, LARGEST_FILE))
    # A data: URI contains its data and refers to no file.
    files = [name for name in names if name and not name.startswith("data:")]
    return list(dict.fromkeys(files))  # each name once, in their order


def gltf_header(data: bytes) -> Any:
    """Parse the JSON of a glTF or GLB file. Returns None if it is missing, damaged or too large."""
    if data[:4] == b"glTF":
        # The binary form of glTF. It begins with 12 bytes of header and 8 bytes that introduce the JSON, of which four
        # are its length.
        if len(data) < 20:
            return None
        length = int(struct.unpack("<I", data[12:16])[0])
        # The buffers with the triangles follow. They are not needed here.
        data = data[20 : 20 + length]
    # A parser of JSON takes many times the memory of the text.
    if len(data) > _LARGEST_HEADER:
        return None
    try:
        return json.loads(data.decode("utf-8-sig"))
    except (ValueError, RecursionError):
        return None


def decode(data: bytes) -> str:
    """Decode text in UTF-8, or else in Latin-1, in which every sequence of bytes is valid."""
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _decode_name(name: bytes) -> str:
    """Decode the name of a file, without white space around it."""
    return decode(name).strip()


def _obj_references(data: bytes) -> list[str]:
    """Names of the material libraries of an OBJ file."""
    return [_decode_name(name) for name in _MATERIAL_LIBRARY.findall(data)]


def _mtl_references(data: bytes) -> list[str]:
    """Names of the colour textures in a material library. Other textures do not change what is displayed."""
    return [_decode_name(name) for name in _COLOUR_MAP.findall(data)]


def _dae_references(data: bytes) -> list[str]:
    """Names of the images in a COLLADA file."""
    names = []
    for section in re.split(rb"<image\b", data)[1:]:
        # An <init_from> outside of an <image> refers to an image by its id, not to a file.
        image = section.partition(b"</image>")[0]
        # COLLADA 1.4 has the name in <init_from>, version 1.5 in a <ref> within it. The possessive \s*+ keeps the time
        # of the search proportional to the length of the text.
        found = re.search(rb"<init_from>\s*+(?:<ref>)?([^<>]+)<", image)
        if found:
            names.append(unescape(_decode_name(found.group(1))))
    return names


def _gltf_references(data: bytes) -> list[str]:
    """URIs of the buffers and images of a glTF or GLB file."""
    header = gltf_header(data)
    if not isinstance(header, dict):
        return []
    uris = []
    for key in ("buffers", "images"):
        entries = header.get(key)
        if not isinstance(entries, list):
            continue
        # The JSON is checked by no schema, so an entry may be of any type.
        for entry in entries:
            uri = entry.get("uri") if isinstance(entry, dict) else None
            if isinstance(uri, str):
                uris.append(uri)
    return uris


def check_mesh(data: bytes, suffix: str) -> CheckedMesh:
    """Check the content of a mesh file, and repair small damage.

    Args:
        data: the bytes of the file.
        suffix: the file's format, as the lower-case end of its name, such as ``.stl``.

    Raises:
        UnreadableMesh: the file is empty, cut off, damaged in a way that is seen here, or so large that parsing it
            could fill the memory; or a COLLADA file has a document type or an impossible unit of length.
    """
    if not data.strip(b"\0 \t\r\n"):
        raise UnreadableMesh(message("importer.is_empty", "is empty"))
    check = _CHECKS.get(suffix)
    return CheckedMesh(data, []) if check is None else check(data)


def _check_stl(data: bytes) -> CheckedMesh:
    """Check the count of faces of an STL file, and remove bytes after the last face of a binary one."""
    # Binary files may begin with "solid", too, but have zeros in their header.
    is_text = data.lstrip()[:5].lower() == b"solid" and b"\0" not in data[:1000]
    if is_text:
        return _check_obj(data)
    if len(data) < _STL_HEADER:
        raise UnreadableMesh(
            message(
                "importer.shorter_than_header",
                "is not readable as STL: {count} bytes are less than an STL header",
                count=len(data),
            )
        )

    (count,) = struct.unpack("<I", data[80:84])
    # A library would allocate memory for as many faces as the header declares.
    present = (len(data) - _STL_HEADER) // _STL_FACE
    if count > present:
        raise UnreadableMesh(
            message(
                "importer.faces_cut_off",
                "is cut off: it contains {there} of its {count} faces",
                count=count,
                there=present,
            )
        )
    if count == 0:
        raise UnreadableMesh(message("importer.no_triangles", "contains no triangles"))

    # Some programs append data of their own, which readers ignore. More whole faces mean that the count is wrong.
    end = _STL_HEADER + count * _STL_FACE
    rest = data[end:]
    has_more_faces = len(rest) % _STL_FACE == 0 and rest.strip(b"\0")
    if has_more_faces:
        raise UnreadableMesh(
            message(
                "importer.counts_faces",
                "declares {count} faces, but contains {there}",
                count=count,
                there=present,
            )
        )
    notes: list[str] = []
    if rest:
        notes.append(
            message(
                "importer.bytes_left_out",
                "has {count} bytes after its last face, which are ignored",
                count=len(rest),
            ),
        )
    return CheckedMesh(data[:end], notes)


def _check_obj(data: bytes) -> CheckedMesh:
    """Convert a mesh in text form to UTF-8. Its comments and names of materials are often in another encoding."""
    return CheckedMesh(decode(data).encode(), [])


def _check_dae(data: bytes) -> CheckedMesh:
    """Refuse COLLADA files with entities, too many elements or nodes, or a wrong unit; note an up axis other than Z."""
    # Counted in the text, before a parser builds an object for each element.
    if data.count(b"<") > _MOST_TAGS:
        raise UnreadableMesh(
            message(
                "importer.too_many_elements", "has more than {most} elements", most=_MOST_TAGS // 2
            )
        )
    try:
        root = ET.fromstring(data, ET.XMLParser(target=_BuilderWithoutDoctype()))
    # LookupError: the file declares an encoding that Python does not have.
    except (ET.ParseError, ValueError, LookupError) as problem:
        raise UnreadableMesh(
            message(
                "importer.not_readable_dae", "is not readable as DAE ({problem})", problem=problem
            )
        ) from problem
    if _node_count(root) > _MOST_NODES:
        raise UnreadableMesh(
            message(
                "importer.too_many_nodes",
                "has more than {most} nodes, or a node that contains itself",
                most=_MOST_NODES,
            )
        )

    unit = root.find("{*}asset/{*}unit")
    meter = "1" if unit is None else unit.get("meter", "1")
    # The file's unit as a length in metres. Text that is no number fails the comparison below, as NaN does.
    try:
        metres = float(meter)
    except ValueError:
        metres = math.nan
    if not 0 < metres < math.inf:
        raise UnreadableMesh(
            message(
                "importer.odd_unit",
                "has a length unit of {meter} m, which is not a positive number",
                meter=shorten(meter),
            )
        )

    notes: list[str] = []
    # A COLLADA file without an up axis has y up.
    up_axis = (root.findtext("{*}asset/{*}up_axis") or "Y_UP").strip()
    if up_axis != "Z_UP":
        notes.append(
            message(
                "importer.up_axis_ignored",
                "has the up axis {up}, which is ignored, as in ROS",
                up=up_axis,
            )
        )
    return CheckedMesh(data, notes)


class _BuilderWithoutDoctype(ET.TreeBuilder):
    """Builds the elements of an XML file, and refuses a document type.

    Entities can be defined in a document type only. Without one, no short text can expand to a huge one.
    """

    def doctype(self, *_: Any) -> NoReturn:
        """Refuse the document type, which the parser reports to this function."""
        raise UnreadableMesh(
            message(
                "importer.mesh_with_entities",
                "declares entities or a document type, which a mesh never needs",
            )
        )


def _node_count(root: ET.Element) -> int:
    """Count the nodes of a COLLADA file's largest scene, with a node counted for each of its instances, and the scene.

    Returns at most one more than the allowed count, also for a node that contains itself.
    """
    # A node may instantiate another one many times, so that few lines make a huge scene. Each node is counted once, and
    # its count is used for all of its instances.
    too_many = _MOST_NODES + 1
    node_of_url = {f"#{node.get('id')}": node for node in root.iter() if node.tag.endswith("}node")}
    counts: dict[int, int] = {}  # count of nodes by the identity of an element

    def count_below(element: ET.Element, depth: int) -> int:
        """Count an element and the nodes below it."""
        if id(element) in counts:
            return counts[id(element)]
        # Python ends with an error at a depth of about a thousand calls.
        if depth > _MOST_NESTED:
            return too_many
        # Until the count is known, an element that is reached from itself counts as too many.
        counts[id(element)] = too_many
        below = []
        for child in element:
            if child.tag.endswith("}node"):
                below.append(child)
            elif child.tag.endswith("}instance_node") and child.get("url", "") in node_of_url:
                below.append(node_of_url[child.get("url", "")])
        total = 1
        for node in below:
            total += count_below(node, depth + 1)
        # Bounded, so that products of counts do not get huge numbers.
        counts[id(element)] = min(too_many, total)
        return counts[id(element)]

    scenes = [element for element in root.iter() if element.tag.endswith("}visual_scene")]
    return max((count_below(scene, 0) for scene in scenes), default=0)


def _check_gltf(data: bytes) -> CheckedMesh:
    """Refuse glTF files whose JSON cannot be read, or declares more numbers, bytes or nodes than a mesh can have."""
    header = gltf_header(data)
    if not isinstance(header, dict):
        raise UnreadableMesh(message("importer.not_readable_gltf", "is not readable as glTF"))
    items = sum(_declared_values(header, "accessors", "count"))
    size = sum(_declared_values(header, "bufferViews", "byteLength"))
    # Only the count of entries matters here, whatever their meshes are. The parser reports invalid nodes.
    nodes = len(_declared_values(header, "nodes", "mesh"))
    if items > _MOST_ITEMS or size > _MOST_BYTES or nodes > _MOST_NODES:
        raise UnreadableMesh(
            message("importer.asks_too_many_numbers", "declares more data than a mesh has")
        )
    return CheckedMesh(data, [])


def _declared_values(header: dict[str, Any], key: str, name: str) -> list[int]:
    """Read one whole number from each entry of a list in a glTF file's JSON.

    Args:
        header: the JSON.
        key: key of the list.
        name: key of the number in each entry.

    Returns:
        the numbers, 0 for an entry without the number. Invalid content is not refused here: a number too large for any
        mesh stands for an invalid entry, and for a value of the key that is no list, so that a sum exceeds its limit.
    """
    invalid = _MOST_BYTES + 1
    entries = header.get(key, [])
    if not isinstance(entries, list):
        return [invalid]
    values: list[int] = []
    for entry in entries:
        value: Any = entry.get(name, 0) if isinstance(entry, dict) else None
        # The type is compared, because a bool is an int, too.
        is_count = type(value) is int and value >= 0
        values.append(value if is_count else invalid)
    return values


def _check_ply(data: bytes) -> CheckedMesh:
    """Refuse PLY files whose header counts more elements of one kind than the file has bytes."""
    # The header is text, also in a binary PLY. Data without an end of the header is no PLY, which the parser reports.
    end = data[:100_000].find(b"end_header")
    header = data[: end if end >= 0 else 10_000]
    counts = re.findall(rb"element\s+\w+\s+(\d{1,18})\b", header)
    # An element takes a byte at least.
    if any(int(count) > len(data) for count in counts):
        raise UnreadableMesh(
            message(
                "importer.header_counts_more",
                "is cut off: its header declares more elements than the file contains",
            )
        )
    return CheckedMesh(data, [])


_MATERIAL_LIBRARY = re.compile(rb"^[ \t]*mtllib[ \t]+([^\r\n]+)", re.MULTILINE)
_COLOUR_MAP = re.compile(rb"^[ \t]*map_kd[ \t]+([^\r\n]+)", re.MULTILINE | re.IGNORECASE)

_REFERENCE_FINDERS: dict[str, Callable[[bytes], list[str]]] = {
    ".obj": _obj_references,
    ".mtl": _mtl_references,
    ".dae": _dae_references,
    ".gltf": _gltf_references,
    ".glb": _gltf_references,
}
"""Functions that find the names of other files, by the format of the file."""

_CHECKS: dict[str, Callable[[bytes], CheckedMesh]] = {
    ".stl": _check_stl,
    ".obj": _check_obj,
    ".dae": _check_dae,
    ".gltf": _check_gltf,
    ".glb": _check_gltf,
    ".ply": _check_ply,
}
"""Functions that check the content of a mesh file, by its format."""
