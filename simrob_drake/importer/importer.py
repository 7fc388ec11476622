"""Importers of extensions: how files of other tools become robots, stations and programs of this toolbox.

An extension announces an importer at the extension point ``importers`` by a suffix such as ``.slx``. Many formats share
the suffix ``.xml``, so an importer of XML files is announced by their outermost element, such as ``<mujoco>``. An
importer of YAML files is announced by a key whose value is a list, such as ``directives:``. The core itself reads
robots from URDF, xacro and SDF files.
"""

import xml.etree.ElementTree as ET
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar
from xml.parsers import expat

from simrob_drake.base.errors import InvalidConfig, SimrobError
from simrob_drake.base.extension import additions, load_addition_class, register_core_names
from simrob_drake.base.files import NotRead, open_regular
from simrob_drake.base.known_extensions import check_provided, known_names
from simrob_drake.base.messages import message
from simrob_drake.base.yaml_files import is_yaml_name, keys_of_lists
from simrob_drake.robots.imports import ImportOptions, ImportReport

CORE_SUFFIXES = (".urdf", ".xacro", ".xml", ".sdf", ".world")
"""Suffixes of files that the core reads as robots."""

_CORE_NAMES = (*CORE_SUFFIXES, "<robot>", "<sdf>")
"""Names at the extension point that no extension can announce, because the core reads such files itself."""

# A licence in a comment before the element may be long. Not the whole file: it may be a mesh of gigabytes.
_BEGINNING = 65536
"""Count of bytes of a file in which its outermost element is expected."""

register_core_names("importers", lambda: _CORE_NAMES)


@dataclass(frozen=True)
class NoOptions:
    """Options of an importer or exporter that has none."""


class Importer:
    """Base class of all importers.

    Derive from :class:`RobotImporter`, :class:`FileImporter`, or
    :class:`simrob_drake.programs.program_importer.ProgramImporter`.

    Attributes:
        title: what the files are, with an article, such as ``a Simulink model``.
        owner: package and extension of the importer, for messages. It is set when the importer is loaded.
    """

    title: ClassVar[str] = message("importer.file_of_other_tool", "a file of another tool")
    owner: str = ""


class RobotImporter(Importer, ABC):
    """Reads a robot from an XML file. The core then repairs it, and writes the robot's folder and the report.

    The robot can be used wherever a URDF can: in ``simrob import``, ``check``, ``view`` and as ``robot.urdf`` of a
    station.
    """

    @abstractmethod
    def robot_element(
        self, root: ET.Element, path: Path, options: ImportOptions, report: ImportReport
    ) -> ET.Element:
        """Translate the file into the element ``robot`` of a URDF.

        Args:
            root: outermost element of the file, which may be changed.
            path: absolute path of the file.
            options: the user's choices for the import.
            report: record of all that is changed or lost.

        Raises:
            InvalidModel: the file holds no robot that can be read, see `ImportReport.refusal`.
        """


@dataclass(frozen=True)
class ImportRequest:
    """Request of a user for an import.

    Attributes:
        options: an object of the importer's `options_class`.
        robot_options: the options of all imports that the importer takes, see `FileImporter.robot_options`.
        settings: texts ``NAME=VALUE`` of the option ``--set``.
        out: file or folder for the result; None for the importer's own choice.
        force: whether to replace what is there.
    """

    options: Any
    robot_options: ImportOptions
    settings: tuple[str, ...] = ()
    out: Path | None = None
    force: bool = False


@dataclass(frozen=True)
class ImportOutcome:
    """Result of an import, for the screen.

    Attributes:
        headline: the most important thing about the result, shown first; empty if there is none.
        lines: what was written, and the command to go on with; one line each.
        report: all that was changed or lost, shown as a table before the lines; None if there is no report.
        losses: parts of the file without which the result behaves differently; one line each.
        unknowns: names that the file uses and does not define, each with the places of their use.
        problem: error because of which nothing can be made of the file, raised after the rest is shown; None if there
            is none.
    """

    lines: tuple[str, ...]
    headline: str = ""
    report: ImportReport | None = None
    losses: tuple[str, ...] = ()
    unknowns: Mapping[str, Sequence[str]] = field(default_factory=dict)
    problem: SimrobError | None = None


@dataclass(frozen=True)
class SceneRequest:
    """Options of the user for a scene of another tool that is run as a station.

    Attributes:
        packages: folders of packages that the user names, by the name of the package.
        mesh_path: further folders from which files, meshes and packages may be read.
        scenario: name of one scene of a file with several. Empty for a file with one scene.
    """

    packages: Mapping[str, Path] = field(default_factory=dict)
    mesh_path: tuple[Path, ...] = ()
    scenario: str = ""


class FileImporter(Importer, ABC):
    """Makes files of this toolbox from a file of another tool: a folder of robots, a station or a program.

    Attributes:
        options_class: dataclass whose fields are options of ``simrob import``, as annotated types of typer.
        reading_class: dataclass with those of the options that `examine` takes.
        robot_options: names of the fields of :class:`ImportOptions` that the importer takes.
        takes_settings: whether the importer takes ``--set NAME=VALUE``.
        has_scenes: whether the files are scenes in YAML: ``simrob run`` runs such a file as it is, and stations can add
            its robots and pieces with ``add_directives``. The importer then implements `station_sections`.
    """

    options_class: ClassVar[type[Any]] = NoOptions
    reading_class: ClassVar[type[Any]] = NoOptions
    robot_options: ClassVar[tuple[str, ...]] = ()
    takes_settings: ClassVar[bool] = False
    has_scenes: ClassVar[bool] = False

    @abstractmethod
    def import_file(self, file: Path, request: ImportRequest) -> ImportOutcome:
        """Read a file of another tool, and write the files of this toolbox that are made from it.

        Args:
            file: the file.
            request: request of the user, with options of `options_class`.

        Raises:
            SimrobError: the file cannot be read, or the result cannot be written; the message names file and line.
        """

    def examine(self, file: Path, request: ImportRequest) -> ImportOutcome:
        """Find the outcome of an import without writing anything, for ``simrob check FILE``.

        An importer that does not implement this method always raises InvalidConfig.

        Args:
            file: the file.
            request: request of the user, with options of `reading_class`.

        Raises:
            SimrobError: the file cannot be read, or the importer does not implement this method.
        """
        raise InvalidConfig(
            file,
            "",
            message(
                "importer.import_reads_it",
                "is {title}, which `simrob check` cannot read; use `simrob import`",
                title=self.title,
            ),
        )

    def station_sections(self, file: Path, request: SceneRequest) -> dict[str, Any]:
        """Make the sections of a station from a scene. The files of its robots and pieces are in the cache.

        An importer that does not implement this method always raises InvalidConfig.

        Args:
            file: the file.
            request: packages and folders that may be read, and the scene that is meant.

        Returns:
            content of a station's file with absolute paths, with ``robots`` in place of ``robot``.

        Raises:
            SimrobError: the file cannot be read, or no station can be made of it.
        """
        raise InvalidConfig(
            file,
            "",
            message(
                "importer.is_no_scene",
                "is {title}, which `simrob run` cannot simulate; use `simrob import`",
                title=self.title,
            ),
        )


def find_station_importer(file: Path | str) -> FileImporter | None:
    """Find the importer of an extension for a YAML file that is a scene of another tool.

    Returns None if the file is no YAML file, cannot be read, or is no such scene.

    Raises:
        BrokenExtension: the importer cannot be used.
        MissingExtension: an extension of this project imports such files, and it is missing.
    """
    if not is_yaml_name(file):
        return None
    importer = find_importer(file)
    return importer if isinstance(importer, FileImporter) and importer.has_scenes else None


def find_importer(file: Path | str) -> Importer | None:
    """Find the importer of an extension for a file.

    The suffix of the file decides, the outermost element of an XML file, or a list under a certain key of a YAML file.

    Returns None if the core itself reads the file, if nothing reads such files, or if the element or the key of an XML
    or YAML file is needed and the file cannot be read.

    Args:
        file: path of the file. It need not exist if its suffix decides.

    Raises:
        BrokenExtension: the importer cannot be used.
        MissingExtension: an extension of this project imports such files, and it is missing.
    """
    path = Path(file)
    suffix = path.suffix.lower()
    if is_yaml_name(path):
        key = _announced_list(path)
        return load_importer(key, path) if key else None
    if suffix not in CORE_SUFFIXES:
        return load_importer(suffix, path) if suffix else None
    # The suffixes of the core are those of XML files, which other tools use, too: the outermost element decides. For
    # the elements that the core reads, load_importer() returns None.
    element = outermost_element(path)
    return load_importer(f"<{element}>", path) if element else None


def _announced_list(path: Path) -> str:
    """Find a key of a YAML file by which an extension announces an importer, such as ``directives:``.

    The value of the key must be a list. Returns an empty text if the file has no such key or cannot be read.
    """
    # Extensions of this project that are not installed count, so that the user can be told to install them.
    names = dict.fromkeys((*additions("importers"), *known_names("importers")))
    announced = [name for name in names if name.endswith(":")]
    lists = keys_of_lists(path, [name.removesuffix(":") for name in announced])
    return next((name for name in announced if name.removesuffix(":") in lists), "")


def load_importer(key: str, file: Path | None = None) -> Importer | None:
    """Load the importer that an extension announces by a suffix, an element or a key.

    Returns None if no extension announces one, or if the core itself reads such files.

    Args:
        key: the suffix in lower case, the element as ``<element>``, or the key of a list as ``key:``.
        file: file that is to be imported, for the message. None if the caller names the file in the message.

    Raises:
        BrokenExtension: the importer cannot be used.
        MissingExtension: an extension of this project has such an importer, and it is missing.
    """
    if key in _CORE_NAMES:
        return None
    addition = additions("importers").get(key)
    # If an extension of this project has the importer, the error says which one to install.
    if addition is None:
        check_provided(
            "importers",
            key,
            message("importer.file_with", "a file with {key}", key=key)
            if file is None
            else str(file),
        )
        return None
    # The code of an extension is imported here, and not before a file needs it.
    importer: Importer = load_addition_class(addition, Importer)()
    importer.owner = addition.owner
    return importer


def outermost_element(path: Path) -> str:
    """Read the name of the outermost element of an XML file.

    The name is empty if the file cannot be read, or if no element begins within the first 64 KiB, or before the first
    fault of the XML.
    """
    try:
        with open_regular(path) as file:
            beginning = file.read(_BEGINNING)
    except (OSError, NotRead):
        return ""
    found = list[str]()
    parser = expat.ParserCreate()
    # The beginning of a file is no complete XML, so that a tree cannot be made of it.
    parser.StartElementHandler = lambda name, _: found.append(name)
    with suppress(expat.ExpatError, ValueError):  # an element before a fault of the file counts
        parser.Parse(beginning, False)
    return found[0] if found else ""
