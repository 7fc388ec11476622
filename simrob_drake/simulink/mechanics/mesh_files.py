"""The mesh files that File Solids name: found in given folders, weighed, and written as OBJ."""

from collections.abc import Iterable
from pathlib import Path, PureWindowsPath
from typing import Any

import numpy as np

from simrob_drake.simulink.mechanics.shapes import Mesh, Weight
from simrob_drake.simulink.model.nodes import Node
from simrob_drake.simulink.values.units import UnknownUnit, factor

READ = (".stl", ".obj", ".dae", ".ply", ".glb", ".gltf")
_LARGEST = 200 * 2**20  # bytes


class MeshFiles:
    """Finds meshes below given folders only."""

    def __init__(self, folders: Iterable[Path]) -> None:
        """Take the folders: the model's own and those of ``--mesh-path``."""
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
        if file.stat().st_size > _LARGEST:
            report.add("dropped", node.path, f"the mesh {name} is larger than {_LARGEST // 2**20} MB")
            return None, 1.0
        try:
            return file, factor(node.text("ExtGeomFileUnits", "m"), "m")
        except UnknownUnit as problem:
            raise node.refusal(f"ExtGeomFileUnits: {problem}") from problem

    def weight(self, node: Node, file: Path | None, scale: float) -> Weight:
        """Return the weight of a mesh filled with 1 kg/m³.

        Raises:
            InvalidModel: there is no mesh, or one that encloses nothing.
        """
        if file is None:
            raise node.refusal(f"its weight follows from the mesh {node.text('ExtGeomFileName')}, which cannot be read")
        mesh = load_mesh(file)
        if mesh is None:
            raise node.refusal(f"its weight follows from the mesh {file.name}, which is damaged")
        properties = mesh.mass_properties
        volume = float(properties.volume) * scale**3
        if not volume > 0:
            raise node.refusal(f"its weight follows from the mesh {file.name}, which encloses no volume")
        com = np.asarray(properties.center_mass, dtype=float) * scale
        return Weight(volume, com, np.asarray(properties.inertia, dtype=float) / properties.density * scale**5)

    def _find(self, name: str) -> Path | None:
        """Return the file in any folder: by its relative path, or by its name alone, in any case of letters."""
        parts = [part for part in PureWindowsPath(name).parts if part not in ("..", "\\", "/") and ":" not in part]
        for folder in self._folders:
            for start in range(len(parts)):
                found = _without_case(folder, parts[start:])
                if found is not None and found.resolve().is_relative_to(folder):
                    return found
        return None


def _without_case(folder: Path, parts: list[str]) -> Path | None:
    for part in parts:
        if not folder.is_dir():
            return None
        exact = folder / part
        if not exact.exists():
            fitting = [child for child in folder.iterdir() if child.name.lower() == part.lower()]
            if not fitting:
                return None
            exact = fitting[0]
        folder = exact
    return folder if folder.is_file() else None


def load_mesh(file: Path) -> Any:
    """Return a mesh as one body of triangles, or None where it cannot be read."""
    import trimesh

    try:
        loaded = trimesh.load(file, force="mesh")
    except Exception:  # readers of damaged files raise whatever they like
        return None
    return loaded if len(getattr(loaded, "faces", ())) else None


def write_obj(mesh: Mesh, target: Path) -> None:
    """Write triangles as OBJ."""
    lines = ["v {:.9g} {:.9g} {:.9g}".format(*corner) for corner in mesh.corners]
    lines += ["f {} {} {}".format(*(face + 1)) for face in mesh.faces]
    target.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")
