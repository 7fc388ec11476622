"""The commands about installed extensions: `simrob extensions` lists them, `simrob schema` prints the stations' schema.

An *extension* is announced by an installed package. It adds Python objects, or folders and files of data, at *extension
points*: a sensor at ``sensors``, a folder of robots at ``robots``. An extension that cannot be used is left out.
"""

import json
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.text import Text

from simrob_drake.base.errors import SimrobError
from simrob_drake.base.extension import (
    MODELS,
    POINTS,
    Extension,
    InstalledExtension,
    addition_path,
    check_addition,
    core_names,
    installed_extensions,
)
from simrob_drake.base.files import hidden_models
from simrob_drake.base.messages import message, translate
from simrob_drake.cli import ExitCode
from simrob_drake.cli.other_files import read_descriptions
from simrob_drake.cli.screen import console, say_text, table

_REGISTRIES = {
    "commands": "simrob_drake.cli.command_table",
    "sensors": "simrob_drake.parts.sensors",
    "monitors": "simrob_drake.parts.monitors",
    "references": "simrob_drake.parts.references",
    "forces": "simrob_drake.parts.forces",
    "couplings": "simrob_drake.parts.couplings",
    "controllers": "simrob_drake.parts.controllers",
    "moves": "simrob_drake.programs.moves.kinds",
    "gaits": "simrob_drake.programs.gaits.registry",
    "inverse_kinematics": "simrob_drake.kinematics.registry",
    "measures": "simrob_drake.results.verdict.judge",
    "engines": "simrob_drake.stations.solver_config",
    "importers": "simrob_drake.importer.importer",
    "exporters": "simrob_drake.programs.exporter",
    "messages": "simrob_drake.base.extension",
}
"""Modules that register the core's names at the extension points. They are imported only if an extension uses them."""


_TITLES_OF_POINTS = {
    "commands": message("cli.point_commands", "commands"),
    "sensors": message("cli.point_sensors", "sensors"),
    "monitors": message("cli.point_monitors", "monitors"),
    "references": message("cli.point_references", "references"),
    "forces": message("cli.point_forces", "forces"),
    "couplings": message("cli.point_couplings", "couplings"),
    "controllers": message("cli.point_controllers", "controllers"),
    "moves": message("cli.point_moves", "moves"),
    "gaits": message("cli.point_gaits", "gaits"),
    "inverse_kinematics": message("cli.point_inverse_kinematics", "inverse kinematics"),
    "plots": message("cli.point_plots", "plots"),
    "measures": message("cli.point_measures", "measures"),
    "panels": message("cli.point_panels", "panels"),
    "engines": message("cli.point_engines", "engines"),
    "importers": message("cli.point_importers", "importers"),
    "exporters": message("cli.point_exporters", "exporters"),
    "robots": message("cli.point_robots", "robots"),
    "pieces": message("cli.point_pieces", "pieces"),
    "stations": message("cli.point_stations", "stations"),
    "other_files": message("cli.point_other_files", "other files"),
    "messages": message("cli.point_messages", "messages"),
}
"""What an extension adds at each extension point, in front of the names."""


def extensions(
    check: Annotated[
        bool,
        typer.Option(
            "--check",
            help=message(
                "cli.help_extensions_check",
                "Import everything that the extensions add, and report failures.",
            ),
        ),
    ] = False,
) -> ExitCode:
    """List the installed extensions, what each adds, and why one is left out."""
    installed = installed_extensions()
    if not installed:
        say_text(message("cli.no_extensions", "no extensions are installed"))
        return ExitCode.DONE
    # A list in the order of the extensions: one package may announce several of them.
    problems = [_problems(entry, is_thorough=check) for entry in installed]
    rows = [
        _row(entry, own_problems) for entry, own_problems in zip(installed, problems, strict=True)
    ]
    headings = (
        message("cli.extension", "extension"),
        message("cli.package", "package"),
        message("cli.version", "version"),
        message("cli.adds", "adds"),
    )
    console.print(table(headings, *rows, numbers=False))
    # Without --check problems are only shown: the other extensions work in spite of them.
    return ExitCode.BAD_INPUT if check and any(problems) else ExitCode.DONE


def schema() -> None:
    """Print the JSON Schema of station files, with the parts that installed extensions add."""
    from simrob_drake.stations.schema import station_schema

    # Not through the console, which would break long lines.
    # The output is the input of an editor or of another tool.
    print(json.dumps(station_schema(), indent=1))


def _problems(entry: InstalledExtension, *, is_thorough: bool) -> list[str]:
    """Find the reasons why an extension, or a part of it, cannot be used.

    Args:
        entry: the extension.
        is_thorough: whether all parts are imported, which takes long and finds problems in their code.

    Returns:
        one sentence for each problem; empty if the extension works.
    """
    # An extension that is left out has no parts to check.
    if entry.extension is None:
        return [entry.problem]
    problems = _shadowed_names(entry.extension) + _hidden_models(entry)
    if not is_thorough:
        return problems
    for point in POINTS:
        for addition in entry.additions_at(point):
            try:
                check_addition(point, addition)
                # Such a file describes files of other tools, so that the core can refuse them with a reason.
                if point == "other_files":
                    read_descriptions(Path(str(addition_path(addition))))
            except SimrobError as problem:
                problems.append(problem.message)
    return problems


def _shadowed_names(extension: Extension) -> list[str]:
    """Find the names of an extension that the core has, too. Such a name in a file means the part of the core.

    Returns:
        one sentence for each name.
    """
    problems = list[str]()
    for point, described in POINTS.items():
        names = getattr(extension, point)
        # The core has no names at points for folders of models, which are not in _REGISTRIES.
        if not names or point not in _REGISTRIES:
            continue
        # A module of the core registers its names when it is imported.
        import_module(_REGISTRIES[point])
        for name in sorted(core_names(point) & set(names)):
            problem = message(
                "cli.name_of_core",
                "the {described} {name} already exists in simrob-drake; choose another name",
                described=described,
                name=repr(name),
            )
            problems.append(problem)
    return problems


def _hidden_models(entry: InstalledExtension) -> list[str]:
    """Find the robots, pieces and stations of an extension that cannot be used, since others have their names.

    Returns:
        one sentence for each of them.
    """
    problems = list[str]()
    for point in MODELS:
        for addition in entry.additions_at(point):
            folder = addition_path(addition)
            # A missing folder is a problem of its own, which only `simrob extensions --check` looks for.
            if folder is None or not folder.is_dir():
                continue
            for model in hidden_models(point, folder):
                problem = message(
                    "cli.hidden_model",
                    "{model} of its {point} cannot be used: another one has this name",
                    model=repr(model),
                    point=_TITLES_OF_POINTS[point],
                )
                problems.append(problem)
    return problems


def _row(entry: InstalledExtension, problems: list[str]) -> tuple[str, str, str, Text]:
    """Make the row of an extension: name, package, version, and what it adds, with its problems in red below."""
    lines = [] if entry.extension is None else _added_lines(entry.extension)
    added = Text("\n".join(lines))
    for problem in problems:
        # An extension that is left out adds nothing, so its problem is the first line.
        if added:
            added.append("\n")
        if entry.extension is None:
            sentence = message("cli.extension_left_out", "left out: {problem}", problem=problem)
        else:
            sentence = message("cli.extension_broken", "broken: {problem}", problem=problem)
        added.append(translate(sentence), style="red")
    return entry.name, entry.package, entry.version, added


def _added_lines(extension: Extension) -> list[str]:
    """Describe what an extension adds, one line for each extension point that it uses."""
    lines = []
    for point in POINTS:
        names = getattr(extension, point)
        if names:
            lines.append(f"{translate(_TITLES_OF_POINTS[point])}: {', '.join(names)}")
    return lines


COMMANDS: dict[str, Callable[..., Any]] = {"extensions": extensions, "schema": schema}
