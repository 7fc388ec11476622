"""Files of robots by their names: files that are read as robots, and robots of ``robot_descriptions``.

Nothing is downloaded.
"""

import re
from importlib import import_module
from os.path import exists, isdir  # which are false for names that no file can have
from pathlib import Path
from typing import Any

from simrob_drake.base.arguments import as_path
from simrob_drake.base.errors import InvalidModel, UnknownName
from simrob_drake.base.extension import classes_of_extensions
from simrob_drake.base.packages import descriptions_cache
from simrob_drake.base.yaml_files import YAML_SUFFIXES
from simrob_drake.importer.importer import CORE_SUFFIXES, RobotImporter, load_importer

_DESCRIPTION = re.compile(r"[a-z]\w*_description", re.ASCII)
_PARTS = ("_cache", "_repositories", "_descriptions")
_PATHS = ("URDF_PATH", "MJCF_PATH", "XACRO_PATH")


def is_robot_file(text: str) -> bool:
    """Whether a text names a file of a robot, or a robot of ``robot_descriptions``: no other robot, and no station."""
    suffix = Path(text).suffix.lower()
    if suffix in CORE_SUFFIXES or _DESCRIPTION.fullmatch(text) is not None:
        return True
    return suffix not in ("", *YAML_SUFFIXES) and isinstance(load_importer(suffix, Path(text)), RobotImporter)


def robot_suffixes() -> list[str]:
    """Suffixes of all files that are read as robots, those of the core first."""
    of_extensions = classes_of_extensions("importers", RobotImporter)
    return [*CORE_SUFFIXES, *(key for key in of_extensions if key.startswith("."))]


def robot_file(source: object, name: str) -> Path:
    """Return the absolute path of a robot's file, which may be named as in ``robot_descriptions``.

    ``name`` is what the parameter is called that it was given as. Raises InvalidParameter: no path; UnknownName: no
    file, and no such description; InvalidModel: a description that was not downloaded, or ``robot_descriptions`` is not
    installed.
    """
    path = as_path(source, name)
    if exists(path) or not _DESCRIPTION.fullmatch(path.name):
        return path.resolve()
    return _downloaded(path.name)


def _downloaded(name: str) -> Path:
    """Return the main file of a description in the cache of ``robot_descriptions``."""

    def cached(repository: str, commit: str | None = None) -> str:
        own = repositories[repository].cache_path
        folder = descriptions_cache() / (f"{own}-{commit}/{own}" if commit else own)
        if not isdir(folder):
            raise InvalidModel(Path(name), "", f"is not in {folder}; `robot_descriptions pull {name}` downloads it")
        return str(folder)

    try:
        parts: list[Any] = [import_module(f"robot_descriptions.{part}") for part in _PARTS]
    except ImportError as problem:
        message = "is no file; as a name of robot_descriptions it needs that: pip install robot_descriptions"
        raise InvalidModel(Path(name), "", message) from problem
    cache, repositories, descriptions = parts[0], parts[1].REPOSITORIES, parts[2].DESCRIPTIONS
    if name not in descriptions:
        raise UnknownName("robot of robot_descriptions", name, list(descriptions))
    download, cache.clone_to_cache = cache.clone_to_cache, cached
    try:
        module = import_module(f"robot_descriptions.{name}")
    finally:
        cache.clone_to_cache = download
    return Path(next(getattr(module, path) for path in _PATHS if hasattr(module, path))).resolve()
