"""Exporters of extensions: how stations and programs are written for other tools.

An extension announces an exporter at the extension point ``exporters`` by the name of the format. The name becomes an
option of ``simrob export``: a format ``csv`` is written with ``simrob export STATION --csv FILE.csv``.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from simrob_drake.base.errors import InvalidParameter, SimrobError
from simrob_drake.base.extension import (
    BrokenExtension,
    MissingExtension,
    additions,
    load_addition_class,
    register_core_names,
)
from simrob_drake.base.known_extensions import check_provided, known_names
from simrob_drake.base.messages import message
from simrob_drake.importer.importer import NoOptions
from simrob_drake.programs.program import Program
from simrob_drake.stations.config import StationConfig

COMMAND_OPTIONS = ("set", "force", "mesh_path", "help")
"""Options of ``simrob export`` itself, which no format can be named as."""

register_core_names("exporters", lambda: COMMAND_OPTIONS)


class Exporter:
    """Base class of all exporters. Derive from :class:`StationExporter` or :class:`ProgramExporter`.

    Attributes:
        help: what is written, in a sentence, for the help of ``simrob export``.
        suffix: suffix that the file must have, such as ``.xml``; empty if it may have any.
        options_class: dataclass whose fields are further options of ``simrob export``, as annotated types of typer.
        owner: package and extension of the exporter, for messages. It is set when the exporter is loaded.
    """

    help: ClassVar[str] = ""
    suffix: ClassVar[str] = ""
    options_class: ClassVar[type[Any]] = NoOptions
    owner: str = ""


class StationExporter(Exporter, ABC):
    """Writes a station for another tool."""

    @abstractmethod
    def export_station(
        self, config: StationConfig, file: Path, options: Any, *, force: bool
    ) -> list[Path]:
        """Write a station.

        Args:
            config: the station.
            file: the file to write, with the exporter's suffix. Further files may be written next to it.
            options: an object of `options_class`.
            force: whether to replace what is there.

        Returns:
            the files and folders that were written.

        Raises:
            SimrobError: the format cannot express the station, or a file cannot be written.
        """


@dataclass(frozen=True)
class ExportedTexts:
    """A program in the format of another tool.

    Attributes:
        texts: content of each file that is to be written, the program itself first.
        remarks: what the format cannot express, one line each.
    """

    texts: Mapping[Path, str]
    remarks: tuple[str, ...] = ()


class ProgramExporter(Exporter, ABC):
    """Translates a program for another tool."""

    @abstractmethod
    def program_texts(
        self, program: Program, config: StationConfig, file: Path, options: Any, *, source: str
    ) -> ExportedTexts:
        """Translate a program.

        Args:
            program: the program.
            config: the station on which it is done.
            file: the file that will be written, with the exporter's suffix.
            options: an object of `options_class`.
            source: path of the program's own file, as the user typed it, for messages.

        Returns:
            the texts of the files to write, and remarks. The caller writes the files.

        Raises:
            SimrobError: the program cannot be done, or the format cannot express it; the message names the move.
        """


def all_exporters() -> dict[str, Exporter | SimrobError]:
    """Find all exporters by the name of their format.

    All exporters are loaded. One that cannot be used is replaced by the error with the reason, which is not raised.
    This includes the formats of this project's own extensions if such an extension is missing.
    """
    found: dict[str, Exporter | SimrobError] = {}
    # Names of this project's own formats are listed even if their extension is not installed: the help then has the
    # reason.
    for name in dict.fromkeys((*additions("exporters"), *known_names("exporters"))):
        try:
            found[name] = load_exporter(name)
        except (BrokenExtension, MissingExtension) as problem:
            found[name] = problem
    return found


def load_exporter(name: str) -> Exporter:
    """Load an exporter by the name of its format: import the extension that announces it, and make an object of it.

    Raises:
        BrokenExtension: the class cannot be used, or the name of the format is no Python identifier.
        MissingExtension: an extension of this project writes the format, and it is missing.
        InvalidParameter: there is no such format.
    """
    addition = additions("exporters").get(name)
    if addition is None:
        # A format of this project whose extension is missing has its own error, with the command that installs it.
        check_provided(
            "exporters", name, message("programs.the_format", "the format {name}", name=name)
        )
        known = ", ".join(additions("exporters"))
        expected = message(
            "programs.no_format", "a format of an installed extension, and none is installed"
        )
        if known:
            expected = message("programs.one_of", "one of: {known}", known=known)
        raise InvalidParameter("format", name, expected)
    # The extension's module is imported only now, when a user asks for its format.
    exporter_class: type[Exporter] = load_addition_class(addition, Exporter)
    # The common base class has no method that exports.
    if not issubclass(exporter_class, StationExporter | ProgramExporter):
        expected_class = message(
            "programs.an_exporter_class", "a subclass of StationExporter or ProgramExporter"
        )
        raise BrokenExtension(
            message(
                "programs.addition_must_be",
                "{owner}: {target} must be {expected}",
                owner=addition.owner,
                target=addition.target,
                expected=expected_class,
            )
        )
    # The option of the command becomes a keyword argument in Python, which `my-csv` could not be.
    if not name.isidentifier():
        raise BrokenExtension(
            message(
                "programs.format_must_be_word",
                "{owner}: the format {name} must be a Python identifier, because it becomes an option",
                owner=addition.owner,
                name=repr(name),
            )
        )
    exporter = exporter_class()
    exporter.owner = addition.owner
    return exporter
