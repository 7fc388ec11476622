"""Files of robots by their names: files that are read as robots, and robots of ``robot_descriptions``.

Nothing is downloaded.
"""

import re
from importlib import import_module

# Unlike the methods of Path, these functions are false for names that no file can have.
from os.path import exists, isdir
from pathlib import Path
from typing import Any

from simrob_drake.base.arguments import as_path
from simrob_drake.base.errors import InvalidModel, UnknownName
from simrob_drake.base.extension import classes_of_extensions
from simrob_drake.base.messages import message
from simrob_drake.base.packages import descriptions_cache
from simrob_drake.base.yaml_files import YAML_SUFFIXES
from simrob_drake.importer.importer import CORE_SUFFIXES, RobotImporter, load_importer

_DESCRIPTION = re.compile(r"[a-z]\w*_description", re.ASCII)
"""Form of the names in ``robot_descriptions``, such as ``ur5e_description``."""

_MODULES = ("_cache", "_repositories", "_descriptions")
"""Modules of ``robot_descriptions`` that are used. They are not public: the public ones download."""

_PATHS = ("URDF_PATH", "MJCF_PATH", "XACRO_PATH")
"""Variables in the module of a description with the path of its main file; each module has one of them."""


def is_robot_file(text: str) -> bool:
    """Whether a text names a file that is read as a robot, or a robot of ``robot_descriptions``.

    Names of the package's robots and files of stations are neither. There need not be a file of this name.

    Raises:
        BrokenExtension: the importer of such files cannot be used.
        MissingExtension: an extension of this project imports such files, and it is missing.
    """
    path = Path(text)
    suffix = path.suffix.lower()
    if suffix in CORE_SUFFIXES or _is_description(path):
        return True
    # Only now extensions are asked. A path without a suffix is the name of a robot of the package.
    return suffix not in ("", *YAML_SUFFIXES) and isinstance(
        load_importer(suffix, path), RobotImporter
    )


def _is_description(path: Path) -> bool:
    """Whether a path is the name of a robot of ``robot_descriptions``: it has its form, and no such file exists.

    Only the last part of the path counts, since a station's file gives paths from its own folder. A folder of this name
    is a package of ROS.
    """
    return _DESCRIPTION.fullmatch(path.name) is not None and not exists(path)


def robot_suffixes() -> list[str]:
    """Suffixes of all files that are read as robots, those of the core first."""
    of_extensions = classes_of_extensions("importers", RobotImporter)
    return [*CORE_SUFFIXES, *(key for key in of_extensions if key.startswith("."))]


def robot_file(source: object, name: str) -> Path:
    """Find the file of a robot, which may be given by its name in ``robot_descriptions``.

    Args:
        source: path of the file, or the name.
        name: name of the parameter that `source` was given as, for errors.

    Returns:
        the absolute path. A path that does not exist, and does not have the form of such a name, is not an error here.

    Raises:
        InvalidParameter: the source is no path.
        UnknownName: there is no such file, and no such robot in ``robot_descriptions``.
        InvalidModel: the robot is not downloaded, or ``robot_descriptions`` is not installed.
    """
    path = as_path(source, name)
    # Symbolic links are resolved, as meshes are sought from the folder in which the file itself is.
    return _description_file(path.name) if _is_description(path) else path.resolve()


def _description_file(name: str) -> Path:
    """Find the main file of a robot in the cache of ``robot_descriptions``, without a download.

    Args:
        name: name of the robot there, such as ``ur5e_description``.

    Raises:
        UnknownName: there is no such robot in ``robot_descriptions``.
        InvalidModel: the robot is not downloaded, or ``robot_descriptions`` is not installed.
    """
    try:
        cache, repositories, descriptions = _description_modules()
    # The library is an optional dependency.
    except ImportError as problem:
        text = message(
            "importer.robot_descriptions_needed",
            "is not a file; for robots of robot_descriptions, run `pip install robot_descriptions`",
        )
        raise InvalidModel(Path(name), "", text) from problem
    if name not in descriptions.DESCRIPTIONS:
        raise UnknownName(
            message("importer.robot_of_robot_descriptions", "robot of robot_descriptions"),
            name,
            list(descriptions.DESCRIPTIONS),
        )

    def find_repository(repository: str, commit: str | None = None) -> str:
        """Find the folder of a repository in the cache, in place of ``clone_to_cache``, which would download it."""
        # The cache has a folder for each repository, and one more for each commit that a description asks for.
        folder_name = repositories.REPOSITORIES[repository].cache_path
        folder = descriptions_cache() / (
            f"{folder_name}-{commit}/{folder_name}" if commit else folder_name
        )
        # A download is left to the user, and the error has the command.
        if not isdir(folder):
            raise InvalidModel(
                Path(name),
                "",
                message(
                    "importer.not_downloaded",
                    "is not in {folder}; `robot_descriptions pull {name}` downloads it",
                    folder=folder,
                    name=name,
                ),
            )
        return str(folder)

    # The module of a description calls `clone_to_cache` while it is imported, and computes its paths from the folder.
    download = cache.clone_to_cache
    cache.clone_to_cache = find_repository
    try:
        module = import_module(f"robot_descriptions.{name}")
    finally:
        cache.clone_to_cache = download
    file = next(getattr(module, path) for path in _PATHS if hasattr(module, path))
    return Path(file).resolve()


def _description_modules() -> list[Any]:
    """Import the modules of ``robot_descriptions`` that are used.

    Raises:
        ImportError: ``robot_descriptions`` is not installed.
    """
    return [import_module(f"robot_descriptions.{module}") for module in _MODULES]
