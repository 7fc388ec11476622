"""Importers of extensions on the command line: their options, and what is shown of their results."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, Literal

from rich.text import Text

from simrob_drake.base.errors import Unsuitable
from simrob_drake.base.extension import classes_of_extensions, code_of_extension
from simrob_drake.base.yaml_files import YAML_SUFFIXES
from simrob_drake.cli import ExitCode
from simrob_drake.cli.arguments import refuse_import
from simrob_drake.cli.options import ChosenOptions, with_groups
from simrob_drake.cli.screen import console, errors, say, table
from simrob_drake.cli.tables import report_table
from simrob_drake.importer.importer import FileImporter, ImportOutcome, ImportRequest, find_importer
from simrob_drake.robots.imports import REPORT_FILE, ImportOptions

_SHOWN_LOSSES = 5  # losses that are shown on the screen; the report contains all
_SHOWN_PLACES = 4  # places of use that are shown of a name that a file does not define


_Group = Literal["options_class", "reading_class"]  # of an importer: options for an import, or only to read a file


def with_importer_options(
    group: _Group,
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Make a decorator that gives a command the options of all importers, which it takes as ``importer_options``.

    Args:
        group: attribute of the importers with the class of the options.
    """
    importers = dict.fromkeys(classes_of_extensions("importers", FileImporter).values())  # each class once
    groups = {f"it belongs to {importer.title}": getattr(importer, group) for importer in importers}
    return with_groups(groups, "importer_options")


def other_importer(file: Path | str) -> FileImporter | None:
    """Find the importer that makes files of a folder from a file itself. Returns None for other files, and for names.

    Raises:
        BrokenExtension: the importer cannot be used.
        MissingExtension: an extension of this project imports such files, and it is missing.
    """
    suffix = Path(file).suffix.lower()
    importer = None if suffix in ("", *YAML_SUFFIXES) else find_importer(file)
    return importer if isinstance(importer, FileImporter) else None


def importer_request(
    importer: FileImporter,
    group: _Group,
    chosen: ChosenOptions,
    robot_options: ImportOptions | None,
    settings: list[str] | None,
    *,
    out: Path | None = None,
    force: bool = False,
) -> ImportRequest:
    """Make the request for an import from the options of a command.

    Args:
        importer: the importer.
        group: attribute of the importer with the class of its options.
        chosen: values of the options of all importers.
        robot_options: values of the options that imports of robots have.
        settings: texts ``NAME=VALUE``.
        out: file or folder for the result, if the user names one.
        force: whether to replace what is there.

    Raises:
        InvalidParameter: an option is given that the importer does not take.
    """
    all_robot_options = robot_options or ImportOptions()
    own = {name: getattr(ImportOptions(), name) for name in importer.robot_options}
    refuse_import(f"it has no effect on {importer.title}", all_robot_options.model_copy(update=own))
    if settings and not importer.takes_settings:
        raise Unsuitable("--set", f"it has no effect on {importer.title}")
    own_options = getattr(importer, group)
    chosen.refuse_all_but([own_options])
    return ImportRequest(
        options=chosen.of(own_options),
        robot_options=all_robot_options,
        settings=tuple(settings or ()),
        out=out,
        force=force,
    )


def import_with(importer: FileImporter, file: Path, request: ImportRequest, *, allow_losses: bool) -> ExitCode:
    """Import a file and show what became of it. Losses give the exit code 4, unless they are allowed."""
    with errors.status(Text(f"importing {file}")), _code_of(importer, file):
        outcome = importer.import_file(file, request)
    _show(outcome)
    for loss in outcome.losses[:_SHOWN_LOSSES]:
        errors.print(Text(f"lost: {loss}"), soft_wrap=True)
    if outcome.losses and not allow_losses:
        count = len(outcome.losses) - _SHOWN_LOSSES
        more = f"{count} more in {REPORT_FILE}; " if count > 0 else ""
        errors.print(f"{more}the station moves otherwise; --allow-losses takes it as it is", highlight=False)
        return ExitCode.BEYOND
    return ExitCode.DONE


def examine_with(importer: FileImporter, file: Path, request: ImportRequest) -> None:
    """Show the result that an import of a file would have, without writing anything.

    Raises:
        SimrobError: nothing can be made of the file; the message says why.
    """
    with errors.status(Text(f"reading {file}")), _code_of(importer, file):
        outcome = importer.examine(file, request)
    _show(outcome)
    if outcome.problem is not None:
        raise outcome.problem


def _code_of(importer: FileImporter, file: Path) -> AbstractContextManager[None]:
    """Context manager around code of an importer, which blames its package for errors that no user causes."""
    return code_of_extension(importer.owner, f"the importer of {file.suffix}")


def _show(outcome: ImportOutcome) -> None:
    """Show the headline, names that are not defined, the report and the lines of an import."""
    if outcome.headline:
        say(outcome.headline)
    if outcome.unknowns:
        rows = []
        for name, places in outcome.unknowns.items():
            shown = "; ".join(places[:_SHOWN_PLACES])
            rows.append((Text(name), Text(shown + (" …" if len(places) > _SHOWN_PLACES else ""))))
        console.print(table(("name that the file does not define", "where it is used"), *rows, numbers=False))
    if outcome.report is not None:
        console.print(report_table(outcome.report))
    for line in outcome.lines:
        say(line)
