"""Which other files a mesh file is made of: material libraries, textures and buffers.

They are found in the text, without loading the mesh, for two reasons: each is checked against the folders that may be
read before a mesh library sees its name, and a cached import must know quickly which files it was made of.
"""

from __future__ import annotations

import json
import re
import struct
from pathlib import Path
from typing import Any
from xml.sax.saxutils import unescape

MESH_FORMATS = (".stl", ".dae", ".obj", ".gltf", ".glb", ".ply", ".off")
LARGEST_FILE = 100_000_000
"""Larger files are not read [bytes]: the largest mesh of a robot that is worth simulating has a tenth of it."""


def references(path: Path) -> list[str]:
    """Return the names of the files that a mesh file, or a material library, asks for, as they are written.

    Raises:
        OSError: the file cannot be read.
    """
    scan = {".obj": _libraries, ".mtl": _maps, ".dae": _images, ".gltf": _uris, ".glb": _uris}.get(path.suffix.lower())
    if scan is None or path.stat().st_size > LARGEST_FILE:
        return []
    return list(dict.fromkeys(name for name in scan(path.read_bytes()) if name and not name.startswith("data:")))


def gltf_header(data: bytes) -> Any:
    """Return the JSON of a glTF or GLB file; None if there is none."""
    if data[:4] == b"glTF":
        if len(data) < 20:
            return None
        data = data[20 : 20 + int(struct.unpack("<I", data[12:16])[0])]
    try:
        return json.loads(data.decode("utf-8-sig"))
    except (ValueError, RecursionError):
        return None


def _libraries(data: bytes) -> list[str]:
    return [_text(name) for name in re.findall(rb"^[ \t]*mtllib[ \t]+([^\r\n]+)", data, re.MULTILINE)]


def _maps(data: bytes) -> list[str]:
    """Return the colour textures of a material library; other maps change nothing that is shown."""
    return [_text(name) for name in re.findall(rb"^[ \t]*map_kd[ \t]+([^\r\n]+)", data, re.MULTILINE | re.IGNORECASE)]


def _images(data: bytes) -> list[str]:
    images = re.findall(rb"<image\b[^>]*>(.*?)</image>", data, re.DOTALL)  # elsewhere <init_from> names an image
    found = (re.search(rb"<init_from>\s*(?:<ref>)?\s*([^<>]+?)\s*<", image) for image in images)
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
