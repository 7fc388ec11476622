"""Importers of extensions on the command line: their options, and what is shown of their results.

An *importer* is a class of an extension that makes files of this toolbox from the file of another tool, such as a
Simulink model. The suffix of the file decides which importer is used, or for XML and YAML files their content. An
importer has up to two dataclasses of options: one for an import (`options_class`), and one for only reading the file,
as `simrob check` does (`reading_class`).

Parts of a file that have no counterpart here, and without which the result behaves differently, are *losses*.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, Literal

from rich.table import Table

from simrob_drake.base.errors import Unsuitable
from simrob_drake.base.extension import classes_of_extensions, code_of_extension
from simrob_drake.base.messages import compound, join_texts, message
from simrob_drake.cli import ExitCode
from simrob_drake.cli.arguments import refuse_import
from simrob_drake.cli.options import ChosenOptions, OptionGroup, with_groups
from simrob_drake.cli.screen import console, errors, progress_note, say_text, table
from simrob_drake.cli.tables import report_table
from simrob_drake.importer.importer import FileImporter, ImportOutcome, ImportRequest, find_importer
from simrob_drake.robots.imports import REPORT_FILE, ImportOptions

_SHOWN_LOSSES = 5
"""Largest count of losses on the screen. The report in the folder of the result contains all of them."""

_SHOWN_PLACES = 4
"""Largest count of places, on the screen, at which a file uses a name that it does not define."""

_ClassAttribute = Literal["options_class", "reading_class"]
"""Attribute of an importer with a dataclass of options: those for an import, or those for only reading a file."""


def with_importer_options(
    attribute: _ClassAttribute,
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Make a decorator that gives a command the options of importers, which it takes as ``importer_options``.

    These are the importers of class `FileImporter`. Those that cannot be used are left out, so that their options are
    unknown. Their use raises the reason.

    Args:
        attribute: attribute of the importers with the dataclass of the options.
    """
    # A class may be announced under several suffixes. It gives its options once.
    importers = dict.fromkeys(classes_of_extensions("importers", FileImporter).values())
    groups = list[OptionGroup]()
    for importer in importers:
        groups.append(OptionGroup(owner=importer.title, options_class=getattr(importer, attribute)))
    return with_groups(groups, "importer_options")


def other_importer(file: Path | str) -> FileImporter | None:
    """Find the importer of an extension that writes files of this toolbox from another tool's file.

    Returns None for all other arguments of a command: names, stations, programs, and files of robots, which the core
    imports itself.

    Args:
        file: argument of the command, which may be no file.

    Raises:
        BrokenExtension: the importer cannot be used.
        MissingExtension: an extension of this project imports such files, and it is missing.
    """
    # A name without a suffix, as of a station, needs no search in the extensions, which takes time.
    importer = find_importer(file) if Path(file).suffix else None
    # Importers of programs are of another class, see `program_importer` in the module `programs`.
    return importer if isinstance(importer, FileImporter) else None


def importer_request(
    importer: FileImporter,
    attribute: _ClassAttribute,
    chosen: ChosenOptions,
    robot_options: ImportOptions | None,
    settings: list[str] | None,
    *,
    out: Path | None = None,
    force: bool = False,
) -> ImportRequest:
    """Make the request for an import from the options of a command, and refuse options that the importer does not take.

    Args:
        importer: the importer.
        attribute: attribute of the importer with the dataclass of its options.
        chosen: values of the options of all importers.
        robot_options: values of the options that imports of robots have. None if the user gives none of them.
        settings: texts ``NAME=VALUE`` of the option ``--set``. None if it is not given.
        out: file or folder for the result. None for the importer's own choice.
        force: whether to replace what is there.

    Raises:
        Unsuitable: an option is given that the importer does not take.
    """
    no_effect = message(
        "cli.no_effect_on", "the option has no effect on {title}", title=importer.title
    )
    all_robot_options = robot_options or ImportOptions()
    # The options that the importer takes are set back to their defaults, so that only the others are refused.
    defaults = {name: getattr(ImportOptions(), name) for name in importer.robot_options}
    refuse_import(no_effect, all_robot_options.model_copy(update=defaults))
    if settings and not importer.takes_settings:
        raise Unsuitable("--set", no_effect)
    options_class = getattr(importer, attribute)
    chosen.refuse_all_but([options_class])
    return ImportRequest(
        options=chosen.of(options_class),
        robot_options=all_robot_options,
        settings=tuple(settings or ()),
        out=out,
        force=force,
    )


def import_with(
    importer: FileImporter, file: Path, request: ImportRequest, *, allow_losses: bool
) -> ExitCode:
    """Import a file, and show the outcome and its losses.

    Args:
        importer: the importer.
        file: the file.
        request: request of the user, see :func:`importer_request`.
        allow_losses: whether the user accepts that parts of the file are lost.

    Returns:
        BEYOND (4) if parts are lost and this is not allowed, otherwise DONE (0).

    Raises:
        SimrobError: the file cannot be imported.
    """
    with (
        progress_note(message("cli.importing", "importing {file}", file=file)),
        _code_of(importer, file),
    ):
        outcome = importer.import_file(file, request)
    _show_outcome(outcome)
    # Losses are shown even if they are allowed: the user should know about them.
    for loss in outcome.losses[:_SHOWN_LOSSES]:
        say_text(message("cli.lost", "lost: {loss}", loss=loss), target=errors)
    # A station with losses is written as well: the exit code keeps a script from running it unnoticed.
    if not outcome.losses or allow_losses:
        return ExitCode.DONE
    # Only a user who has not accepted the losses needs to know their count.
    hidden_count = len(outcome.losses) - _SHOWN_LOSSES
    if hidden_count > 0:
        rest = message(
            "cli.more_losses",
            "lost: {count} more, see {file}",
            count=hidden_count,
            file=REPORT_FILE,
        )
        say_text(rest, target=errors)
    consequence = message(
        "cli.moves_differently",
        "the station moves differently from the original; --allow-losses accepts that",
    )
    say_text(consequence, target=errors)
    return ExitCode.BEYOND


def examine_with(importer: FileImporter, file: Path, request: ImportRequest) -> None:
    """Show the outcome that an import of a file would have, without writing anything.

    Args:
        importer: the importer.
        file: the file.
        request: request of the user, with options of the importer's `reading_class`.

    Raises:
        SimrobError: nothing can be made of the file; the message says why. The rest of the outcome is shown before.
    """
    with (
        progress_note(message("cli.reading", "reading {file}", file=file)),
        _code_of(importer, file),
    ):
        # Code of an extension: an error that no user causes is reported with the name of its package.
        outcome = importer.examine(file, request)
    # The report explains the problem, so it is shown before the error.
    _show_outcome(outcome)
    if outcome.problem is not None:
        raise outcome.problem


def _code_of(importer: FileImporter, file: Path) -> AbstractContextManager[None]:
    """Context manager around code of an importer, which blames its package for errors that no user causes."""
    name = message("cli.the_importer", "the importer of {suffix}", suffix=file.suffix)
    return code_of_extension(importer.owner, name)


def _show_outcome(outcome: ImportOutcome) -> None:
    """Show the outcome of an import: headline, names that the file does not define, report and lines.

    Losses and the problem are shown by the callers.
    """
    if outcome.headline:
        say_text(outcome.headline)
    if outcome.unknowns:
        console.print(_unknowns_table(outcome.unknowns))
    if outcome.report is not None:
        console.print(report_table(outcome.report))
    for line in outcome.lines:
        say_text(line)


def _unknowns_table(unknowns: Mapping[str, Sequence[str]]) -> Table:
    """Make the table of the names that a file uses and does not define, such as variables of a Simulink model.

    Args:
        unknowns: the places at which the file uses each name, by the name.
    """
    rows = list[tuple[str, str]]()
    for name, places in unknowns.items():
        # A variable of a large model may be used at hundreds of places.
        first_places = join_texts(places[:_SHOWN_PLACES], "; ")
        rest = " …" if len(places) > _SHOWN_PLACES else ""
        rows.append((name, compound("{places}{rest}", places=first_places, rest=rest)))
    headings = (
        message("cli.undefined_name", "name that the file does not define"),
        message("cli.where_used", "where it is used"),
    )
    return table(headings, *rows, numbers=False)
