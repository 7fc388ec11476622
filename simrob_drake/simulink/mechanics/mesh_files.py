"""The mesh files that File Solids name: found in given folders, weighed, and written as OBJ."""

import sys
from collections.abc import Iterable
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path, PureWindowsPath
from subprocess import SubprocessError, run
from tempfile import TemporaryDirectory

import numpy as np

from simrob_drake.extras import lacking
from simrob_drake.importer.meshes.checks import UnreadableMesh
from simrob_drake.importer.meshes.parts import MeshPart, mend, plain
from simrob_drake.importer.meshes.places import in_any_case
from simrob_drake.importer.meshes.reading import read_mesh
from simrob_drake.simulink.mechanics.shapes import Weight
from simrob_drake.simulink.model.nodes import Node

STEP = (".step", ".stp")
READ = (".stl", ".obj", ".dae", ".ply", ".glb", ".gltf", *STEP)
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
        report = node.findings.report
        if not name:
            return None, 1.0
        file = self._find(name)
        if file is None:
            report.add("dropped", node.path, f"the mesh {name} is not below the model's folder; give --mesh-path DIR")
            return None, 1.0
        if file.suffix.lower() not in READ:
            report.add("dropped", node.path, f"the mesh {name}: {file.suffix} is not read; convert it to STL")
            return None, 1.0
        if file.suffix.lower() in STEP:  # it has units of its own
            return file, 1.0
        return file, node.in_si(node.text("ExtGeomFileUnits", "m"), "ExtGeomFileUnits", "m")

    def weight(self, node: Node, file: Path | None, scale: float) -> Weight:
        """Return the weight of a mesh filled with 1 kg/m³.

        Raises:
            InvalidModel: there is no mesh, or one that encloses nothing.
        """
        if file is None:
            raise node.refusal(f"its weight follows from the mesh {node.text('ExtGeomFileName')}, which cannot be read")
        try:
            mesh = load_mesh(file)
        except UnreadableMesh as problem:
            raise node.refusal(f"its weight follows from the mesh {file.name}, which {problem}") from problem
        from trimesh.triangles import mass_properties

        properties = mass_properties((mesh.vertices * scale)[mesh.faces])
        if not properties.volume > 0:
            raise node.refusal(f"its weight follows from the mesh {file.name}, which encloses no volume")
        return Weight(float(properties.volume), np.asarray(properties.center_mass), np.asarray(properties.inertia))

    def _find(self, name: str) -> Path | None:
        """Return the file in any folder: by its relative path, or by its name alone, in any case of letters."""
        parts = [part for part in PureWindowsPath(name).parts if part not in ("..", "\\", "/") and ":" not in part]
        for folder in self._folders:
            for start in range(len(parts)):
                found = in_any_case(folder.joinpath(*parts[start:]))
                if found is not None and found.resolve().is_relative_to(folder):
                    return found
        return None


def load_mesh(file: Path) -> MeshPart:
    """Return the triangles of a mesh; no file is read but this one.

    Raises:
        UnreadableMesh: it is too large, garbage, or holds no triangles; the text says what.
    """
    if file.suffix.lower() in STEP:
        return _from_step(file, file.stat().st_mtime_ns)
    parts = [part for part in map(mend, read_mesh(file, {}).parts) if len(part.faces)]
    if not parts:
        raise UnreadableMesh("holds no triangle with an area")
    return plain(parts)


@lru_cache(maxsize=8)  # a part is weighed, and then written
def _from_step(file: Path, _changed: int) -> MeshPart:
    """Return the faces of a STEP file [m], made by a process of its own, which a damaged file may end."""
    if find_spec("cascadio") is None:
        raise UnreadableMesh(lacking("is STEP, which", "step"))
    with TemporaryDirectory() as folder:
        target = Path(folder) / "part.glb"
        try:
            command = [sys.executable, "-c", _CONVERT, str(file.resolve()), str(target)]
            run(command, check=True, capture_output=True, timeout=_LONGEST)
            mesh = load_mesh(target)
        except (OSError, SubprocessError, UnreadableMesh) as problem:
            raise UnreadableMesh("holds no solid that can be read from STEP") from problem
    return MeshPart(mesh.vertices @ _UPRIGHT.T, mesh.faces)


def write_obj(mesh: MeshPart, target: Path) -> None:
    """Write triangles as OBJ."""
    lines = ["v {:.9g} {:.9g} {:.9g}".format(*corner) for corner in mesh.vertices]
    lines += ["f {} {} {}".format(*(face + 1)) for face in mesh.faces]
    target.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")
