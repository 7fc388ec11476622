"""Modules near those of a program that declare what they name: tools of a CalibData, routines of a SYSMOD."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from simrob_drake.rapid.syntax import SUFFIXES, Module, RapidError, Remark, read_modules

_FOLDERS = ("PROGMOD", "SYSMOD")  # of a task, side by side, as a controller and RobotStudio keep modules
_MOST = 60  # files that are looked at


def neighbours(files: Sequence[Path], modules: Sequence[Module]) -> tuple[list[Module], list[Remark]]:
    """Return modules of files near those of a program that declare names which it lacks, and a remark on each.

    Another program, which has a main of its own, and what cannot be read are no such neighbours.
    """
    known = {name for module in modules for name in _declared(module)}
    wanting = {word.lower() for module in modules for word in _words(module)} - known
    found, remarks = list[Module](), list[Remark]()
    for file in _near(files):
        for module in _read(file):
            names = {name for name in _declared(module) if name in wanting}
            if names and "main" not in _declared(module):
                found.append(module)
                wanting -= names
                what = f"{file.name} near it is read, too, for {', '.join(sorted(names))}"
                remarks.append(Remark(modules[-1].file, 1, what, lost=False))
    return found, remarks


def _read(file: Path) -> list[Module]:
    try:
        return read_modules(file)
    except RapidError:
        return []


def _near(files: Sequence[Path]) -> Iterator[Path]:
    """Yield the modules' files in the folders of a program's files, and in those of the same task."""
    own = {file.resolve() for file in files}
    folders = dict.fromkeys(file.parent for file in own)
    for folder in [*folders]:
        if folder.name.upper() in _FOLDERS:
            others = (other for other in folder.parent.iterdir() if other.is_dir())
            folders |= dict.fromkeys(other for other in others if other.name.upper() in _FOLDERS)
    rows = [file for folder in folders for file in sorted(folder.iterdir()) if file.suffix.lower() in SUFFIXES]
    yield from [file for file in rows if file.resolve() not in own][:_MOST]


def _declared(module: Module) -> list[str]:
    """Return the names of a module's data and routines, in lower case."""
    found = list[str]()
    for node in module.declarations:
        if node.data == "data":
            found += [str(item.children[0]).lower() for item in node.children[3:]]
        elif node.data in ("routine", "function"):
            found.append(str(node.children[1 if node.data == "routine" else 2]).lower())
    return found


def _words(module: Module) -> Iterator[str]:
    """Yield all names in a module; without recursion, since expressions may be nested as deeply as they like."""
    left = [*module.declarations]
    while left:
        node = left.pop()
        if getattr(node, "type", "") == "NAME":
            yield str(node)
        left += getattr(node, "children", ())
