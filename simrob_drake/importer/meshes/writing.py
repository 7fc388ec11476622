"""Write the meshes of an import as OBJ files, each content once, under names of our own."""

import hashlib
import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from simrob_drake.frames import Vector
from simrob_drake.importer.meshes.mending import distinct, shaded
from simrob_drake.importer.meshes.parts import MeshPart, as_png

FOLDER = "meshes"
_MATERIAL = "texture"
_KEYWORDS = {b"v", b"vn", b"vt", b"f", b"o", b"g", b"s", b"usemtl", b"mtllib"}
"""Lines of an OBJ file that every reader understands."""


@dataclass
class MeshWriter:
    """The mesh files of one import.

    Attributes:
        folder: the output folder; None writes nothing, but names are given all the same.
    """

    folder: Path | None
    _written: dict[tuple[str, str], str] = field(default_factory=dict, init=False)

    def write(self, part: MeshPart, *, role: str, stem: str, original: bytes | None = None) -> str:
        """Write a part, unless the same was written before, and return the file's name relative to the folder.

        ``role`` is ``visual`` or ``collision``, each with files of its own; ``stem`` is the file's name without its
        ending, ``original`` the OBJ file that the part was read from, if that is to be kept as it is.
        """
        library = f"{stem}.mtl"
        kept = None if original is None else _relabelled(original, library if part.image else "")
        text = kept if kept is not None else obj_text(part, library)
        png = b"" if part.image is None else as_png(part.image)
        content = hashlib.sha256(text.replace(library.encode(), b"") + b"\0" + png).hexdigest()
        name = self._written.setdefault((role, content), f"{FOLDER}/{stem}.obj")
        if name == f"{FOLDER}/{stem}.obj":
            self._save(f"{stem}.obj", text)
            if part.image is not None:
                self._save(library, f"newmtl {_MATERIAL}\nKd 1 1 1\nmap_Kd {stem}.png\n".encode())
                self._save(f"{stem}.png", png)
        return name

    def _save(self, name: str, data: bytes) -> None:
        if self.folder is not None:
            (self.folder / FOLDER).mkdir(exist_ok=True)
            (self.folder / FOLDER / name).write_bytes(data)


def may_stay(data: bytes) -> bool:
    """Return whether an OBJ file holds nothing but what every reader understands."""
    lines = (line.split() for line in data.splitlines() if line.strip() and not line.lstrip().startswith(b"#"))
    return all(words[0] in _KEYWORDS and (words[0] != b"v" or len(words) == 4) for words in lines)


def _relabelled(data: bytes, library: str) -> bytes:
    """Return an OBJ file that names its material library by our name, or none."""
    data = re.sub(rb"^[ \t]*mtllib\b.*$", f"mtllib {library}".encode(), data, flags=re.MULTILINE) if library else data
    if library:
        return re.sub(rb"^[ \t]*usemtl\b.*$", f"usemtl {_MATERIAL}".encode(), data, flags=re.MULTILINE)
    return re.sub(rb"^[ \t]*(mtllib|usemtl)\b[^\n]*\n?", b"", data, flags=re.MULTILINE)


def obj_text(part: MeshPart, library: str = "") -> bytes:
    """Return a part as an OBJ file; the library is named only if there is a texture."""
    lit = shaded(part)
    assert lit.normals is not None
    blocks = [f"mtllib {library}\nusemtl {_MATERIAL}\n"] if part.image is not None else []
    blocks.append(_rows("v", lit.vertices))
    normals, normal_index = distinct(lit.normals.reshape(-1, 3).round(4))
    blocks.append(_rows("vn", normals))
    columns = [lit.faces.reshape(-1), normal_index]
    corner = "%d//%d"
    if part.image is not None and lit.uv is not None:
        uv, uv_index = distinct(lit.uv.reshape(-1, 2).round(6))
        blocks.append(_rows("vt", uv))
        columns.insert(1, uv_index)
        corner = "%d/%d/%d"
    indices = (np.stack(columns, axis=1) + 1).reshape(-1).tolist()
    blocks.append((f"f {corner} {corner} {corner}\n" * len(lit.faces)) % tuple(indices))
    return "".join(blocks).encode()


def _rows(keyword: str, values: Vector) -> str:
    row = f"{keyword}{' %r' * values.shape[1]}\n"
    return (row * len(values)) % tuple(values.reshape(-1).tolist())
