"""Copies of the meshes that models name, with the materials and textures that belong to them."""

import shutil
from collections.abc import Callable
from pathlib import Path, PurePosixPath

from pydrake.geometry import Convex, Mesh

from simrob_drake.base.errors import SimrobError
from simrob_drake.base.messages import message
from simrob_drake.importer.meshes.places import MeshPlaces

MESHES = "meshes"
"""Name of the folder with the copies."""


def allow_any(path: Path) -> None:
    """Allow every mesh. It is the check for stations, whose files were checked when they were loaded."""


class MeshCopies:
    """The meshes of one folder."""

    def __init__(self, folder: Path, check: Callable[[Path], None] = allow_any) -> None:
        """Begin without meshes.

        Args:
            folder: folder that gets the folder ``meshes``, with one folder for each mesh.
            check: function that is called with the path of each mesh, and raises an error if it may not be read.
        """
        self._folder = folder
        self._check = check
        self._copies = dict[Path, Path]()  # by the path of the original

    def copy(self, shape: Mesh | Convex) -> Path:
        """Copy the file of a mesh, once, with its materials and textures.

        Args:
            shape: shape of Drake with the mesh.

        Returns:
            path of the copy, relative to the folder.

        Raises:
            SimrobError: the mesh has no file, may not be read, or names a file that may not be read.
        """
        source = shape.source()
        if not source.is_path():
            raise SimrobError(
                message(
                    "drake_scenes.mesh_in_memory",
                    "a mesh exists in memory only, and cannot be copied to a file",
                )
            )
        original = Path(str(source.path())).resolve()
        if original not in self._copies:
            self._check(original)
            self._copies[original] = self._copy_files(original)
        return self._copies[original]

    def _copy_files(self, original: Path) -> Path:
        """Copy a mesh and the files that it needs. Returns the path of the copy, relative to the folder."""
        # Two meshes of the same name may need different textures of the same name, so each has its own folder.
        names = {copy.parent.name for copy in self._copies.values()}
        stem = original.stem.replace(" ", "_")
        candidates = [stem, *(f"{stem}_{number}" for number in range(2, len(names) + 3))]
        place = Path(MESHES, next(name for name in candidates if name not in names))
        target = self._folder / place
        target.mkdir(parents=True)
        shutil.copyfile(original, target / original.name)
        needed, _ = MeshPlaces(original).needed_by(original)
        for name, file in needed.items():
            relative = PurePosixPath(name)
            # A name with a way up, or an absolute one, would leave the folder of the copies.
            is_inside = not relative.is_absolute() and ".." not in relative.parts
            copy = target / (relative if is_inside else file.name)
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, copy)
        return place / original.name
