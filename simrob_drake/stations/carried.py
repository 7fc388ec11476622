"""A station that runs from a folder alone: the files that it names are copied into it."""

import shutil
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from pathlib import Path

from simrob_drake.errors import SimrobError
from simrob_drake.files import ROBOT_FILE
from simrob_drake.importer.importing import robot_from_file
from simrob_drake.importer.meshes.places import MeshPlaces
from simrob_drake.importer.options import ImportOptions
from simrob_drake.importer.packages import resolved
from simrob_drake.robots.catalog import RobotModel, load_robot_file
from simrob_drake.robots.pieces import described_piece
from simrob_drake.robots.urdf import mesh_file
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.located import paths_in

FILES = "files"
"""The folder of the copies."""
_FILES = (ROBOT_FILE, "gaits.yaml", "walking.yaml")  # what is read of a robot beside its URDF


def carried(config: StationConfig, folder: Path) -> StationConfig:
    """Return a station that names copies of its files in a folder, by paths from there; robots as imported.

    Paths that are relative already stay, and so does what cannot be read any more.

    Raises:
        OSError: the disk does not take the copies.
    """
    content = config.model_dump(mode="json", exclude_none=True)
    for section, last, key in paths_in(content):
        if last in _FILES_OF and Path(section[last]).is_absolute():
            place = Path(FILES, *key.split(".")[:-1])
            with suppress(SimrobError):
                options = ImportOptions.model_validate(section.get("import_options") or {})
                main, files = _FILES_OF[last](Path(section[last]), key, options)
                _copy((main, *files), main.parent, folder / place)
                section[last] = str(place / main.name)
                section.pop("import_options", None)
    return StationConfig.model_validate(content)


def _copy(files: Iterable[Path], start: Path, target: Path) -> None:
    """Copy files below a folder to the same places below another."""
    for file in dict.fromkeys(files):
        if file.is_relative_to(start):
            copy = target / file.relative_to(start)
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, copy)


def _of_robot(model: RobotModel, main: Path) -> tuple[Path, list[Path]]:
    """Return a robot's main file, and what else is read of it."""
    folder = resolved(model.folder)
    files = [folder / name for name in (*_FILES, *([model.urdf] if model.urdf else [])) if (folder / name).is_file()]
    names = [mesh.get("filename", "") for mesh in model.element.iter("mesh")] if model.urdf else []
    return folder / main.name, [*files, *_with_needed(mesh_file(name, folder) for name in dict.fromkeys(names))]


def _of_urdf(file: Path, _: str, options: ImportOptions) -> tuple[Path, list[Path]]:
    model = robot_from_file(file, options)
    return _of_robot(model, model.urdf_path)


def _of_description(file: Path, key: str, _: ImportOptions) -> tuple[Path, list[Path]]:
    """Return the files of a robot or a piece that a YAML file describes."""
    if not key.startswith("pieces."):
        return _of_robot(load_robot_file(file), file)
    piece, main = described_piece(file), resolved(file)
    return main, _with_needed(mesh_file(shape.mesh, main.parent) for shape in piece.shapes if shape.mesh)


def _of_mesh(file: Path, _: str, __: ImportOptions) -> tuple[Path, list[Path]]:
    return resolved(file), _with_needed([resolved(file)])


def _of_file(file: Path, _: str, __: ImportOptions) -> tuple[Path, list[Path]]:
    return resolved(file), []


_FILES_OF: Mapping[str, Callable[[Path, str, ImportOptions], tuple[Path, list[Path]]]] = {
    "urdf": _of_urdf,
    "model": _of_description,
    "mesh": _of_mesh,
    "network": _of_file,
    "file": _of_file,
    "start": _of_file,
}
"""By the last part of a key: the main file behind its path, and what else is read with it."""


def _with_needed(meshes: Iterable[Path]) -> list[Path]:
    """Return meshes, and the materials and textures that they name."""
    files = list[Path]()
    for mesh in meshes:
        files += [mesh, *MeshPlaces(mesh).needed_by(mesh)[0].values()]
    return files
