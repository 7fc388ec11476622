"""Extensions: installed packages that add parts, moves, gaits, commands and models to the toolbox.

A package announces an object of class :class:`Extension` under the entry-point group ``simrob_drake.extensions``. The
object names what the package adds as import strings ``package.module:Name``. Such a string is imported when a station,
a program or a command first uses the name, so an installed extension costs nothing until then.

An extension that cannot be used is left out, and everything else works: it fails to import, it works with other
versions of this package, or it takes a name of another extension. A name of the core always means the core's own thing.
``simrob extensions`` lists the reasons.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

from simrob_drake.base.errors import SimrobError, shortened

GROUP = "simrob_drake.extensions"
"""Group of entry points under which packages announce their extensions."""

Additions = Mapping[str, str]
"""Things of one kind by name, each as an import string ``package.module:Name``."""


@dataclass(frozen=True, kw_only=True)
class Extension:
    """Everything that one package adds to the toolbox.

    Every mapping has the names that users write and, for each, an import string ``package.module:Name``.

    Attributes:
        core: versions of simrob_drake that the extension works with, as a version specifier such as ``>=0.1,<0.3``.
        commands: functions that become commands ``simrob <name>``; their docstring is the help.
        sensors: sections of a station file under ``sensors``, subclasses of ``Sensor``.
        monitors: sections under ``monitors``, subclasses of ``MonitorSection``.
        references: sections under ``reference``, subclasses of ``ReferenceSection``.
        forces: sections under ``forces``, subclasses of ``ForceSection``.
        couplings: sections under ``couplings``, subclasses of ``CouplingSection``.
        controllers: sections under ``controllers``, subclasses of ``LoopSection``.
        moves: lines of a program, subclasses of ``Move``, by their ``key``.
        gaits: sections of a file ``gaits.yaml``, subclasses of ``Gait``, by their ``section``.
        inverse_kinematics: subclasses of ``Solver``, by the name that ``solver=`` takes.
        engines: sections ``solver`` by their kind, subclasses of ``OtherEngine``, in place of Drake's plant.
        importers: subclasses of ``Importer``, by a suffix of files such as ``.slx``, or for XML files of any suffix by
            the outermost element such as ``<mujoco>``.
        exporters: subclasses of ``StationExporter`` or ``ProgramExporter``, by the name of the format, which is an
            option of ``simrob export``.
        robots: folders with one folder for each robot (``robot.yaml``, URDF, meshes), by any name; here the string is
            ``package:folder``.
        pieces: folders with one folder for each piece (``piece.yaml``), likewise.
        stations: folders with one YAML file for each station, likewise.
    """

    core: str
    commands: Additions = field(default_factory=dict)
    sensors: Additions = field(default_factory=dict)
    monitors: Additions = field(default_factory=dict)
    references: Additions = field(default_factory=dict)
    forces: Additions = field(default_factory=dict)
    couplings: Additions = field(default_factory=dict)
    controllers: Additions = field(default_factory=dict)
    moves: Additions = field(default_factory=dict)
    gaits: Additions = field(default_factory=dict)
    inverse_kinematics: Additions = field(default_factory=dict)
    engines: Additions = field(default_factory=dict)
    importers: Additions = field(default_factory=dict)
    exporters: Additions = field(default_factory=dict)
    robots: Additions = field(default_factory=dict)
    pieces: Additions = field(default_factory=dict)
    stations: Additions = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check the types; raises TypeError if one is wrong. It is reported as a failure of the package's import."""
        if not isinstance(self.core, str):
            raise TypeError(f"core is {self.core!r}; it must be a version specifier such as '>=0.1,<0.3'")
        for point in POINTS:
            entries = getattr(self, point)
            if not isinstance(entries, Mapping):
                raise TypeError(f"{point} is {entries!r}; it must be a mapping of names to import strings")


POINTS = {
    "commands": "command",
    "sensors": "kind of sensor",
    "monitors": "kind of monitor",
    "references": "kind of reference",
    "forces": "kind of force",
    "couplings": "kind of coupling",
    "controllers": "kind of controller",
    "moves": "kind of move",
    "gaits": "kind of gait",
    "inverse_kinematics": "solver of inverse kinematics",
    "engines": "engine",
    "importers": "importer of",
    "exporters": "exporter to",
    "robots": "folder of robots",
    "pieces": "folder of pieces",
    "stations": "folder of stations",
}
"""The extension points: the field of :class:`Extension`, and the words for one of its entries."""

FOLDERS = ("robots", "pieces", "stations")
"""Extension points whose strings name folders of data instead of Python objects."""


class InstalledExtension(NamedTuple):
    """An extension that is installed, whether it can be used or not.

    Attributes:
        package: name of the distribution that announces it, such as ``simrob-thermal``.
        version: version of that distribution.
        extension: what it adds; None if it is left out.
        problem: why it is left out, in one line; empty if it is used.
    """

    package: str
    version: str
    extension: Extension | None
    problem: str


class Addition(NamedTuple):
    """One thing that an extension adds.

    Attributes:
        name: name by which users refer to it.
        package: name of the distribution that adds it.
        target: its import string ``package.module:Name``, or ``package:folder``.
    """

    name: str
    package: str
    target: str


class BrokenExtension(SimrobError):
    """Raised when something of an extension is used and cannot be imported."""


@cache
def installed_extensions() -> tuple[InstalledExtension, ...]:
    """Find all installed extensions, in the order of their packages' names."""
    found = [_load_extension(entry) for entry in sorted(entry_points(group=GROUP), key=_package_and_name)]
    return tuple(_without_conflicts(found))


def load_addition_class(addition: Addition, base: Any, named_by: str = "") -> Any:
    """Import a class that an extension adds, and check it.

    Args:
        addition: what to import.
        base: class that it must be derived from.
        named_by: attribute of the class that must be the announced name, such as the ``key`` of a move; none if empty.

    Raises:
        BrokenExtension: the class cannot be imported, has another base, or another name. The message names the package.
    """
    found = load_addition(addition)
    if not (isinstance(found, type) and issubclass(found, base)):
        expected = f"a subclass of {base.__module__}.{base.__name__}"
        raise BrokenExtension(f"package {addition.package}: {addition.target} is {found!r}; it must be {expected}")
    abstract = sorted(getattr(found, "__abstractmethods__", ()))
    if abstract:
        lacking = ", ".join(abstract)
        raise BrokenExtension(f"package {addition.package}: {addition.target} lacks {lacking}, see {base.__name__}")
    own_name = getattr(found, named_by, None) if named_by else addition.name
    if own_name != addition.name:
        problem = f"has the {named_by} {own_name!r}, and is announced as {addition.name!r}"
        raise BrokenExtension(f"package {addition.package}: {addition.target} {problem}")
    return found


def check_usable(point: str, name: str, base: Any, named_by: str = "") -> None:
    """Raise BrokenExtension if an extension adds a class of this name at a point, and the class cannot be used.

    Registries call it for a name that they do not know, so that the message gives the true cause.
    """
    addition = additions(point).get(name)
    if addition is not None:
        load_addition_class(addition, base, named_by)


def classes_of_extensions(point: str, base: Any, named_by: str = "") -> dict[str, Any]:
    """Import the classes that extensions add at an extension point (a key of POINTS), by name.

    Classes that cannot be used are left out: :func:`check_usable` raises the reason when one is used.
    """
    found = {}
    for name, addition in additions(point).items():
        try:
            found[name] = load_addition_class(addition, base, named_by)
        except BrokenExtension:
            continue
    return found


def additions(point: str) -> dict[str, Addition]:
    """Find what the extensions in use add at one extension point (a key of POINTS), by name.

    Names that the core has there are left out: they mean the core's own thing.
    """
    taken = core_names(point)
    found = {}
    for installed in installed_extensions():
        if installed.extension is None:
            continue
        entries: Additions = getattr(installed.extension, point)
        for name, target in entries.items():
            if name not in taken:
                found[name] = Addition(name=name, package=installed.package, target=target)
    return found


def load_addition(addition: Addition) -> Any:
    """Import the object that an extension adds.

    Raises:
        BrokenExtension: its module cannot be imported, or has no such name. The message names the package.
    """
    module_name, _, name = addition.target.partition(":")
    try:
        return getattr(import_module(module_name), name)
    except (Exception, SystemExit) as problem:  # a module of somebody else may raise anything
        reason = shortened(f"{type(problem).__name__}: {problem}", 200)
        raise BrokenExtension(
            f"package {addition.package}: {addition.target} cannot be imported ({reason})"
        ) from problem


def addition_folder(addition: Addition) -> Path | None:
    """Find the folder of data that an extension adds, without importing the package.

    Returns None if there is no such folder.
    """
    package, _, folder = addition.target.partition(":")
    try:
        spec = find_spec(package)
    except (ImportError, ValueError):  # of a package in a package that is missing, or of an empty name
        return None
    if spec is None or not spec.submodule_search_locations:
        return None
    path = Path(next(iter(spec.submodule_search_locations)), folder)
    return path if path.is_dir() else None


def check_addition(point: str, addition: Addition) -> None:
    """Check that a thing of an extension can be imported, or that its folder exists; raises BrokenExtension if not."""
    if point not in FOLDERS:
        load_addition(addition)
    elif addition_folder(addition) is None:
        raise BrokenExtension(f"package {addition.package}: there is no folder {addition.target}")


def addition_folders(point: str) -> list[Path]:
    """Find the folders that extensions add at one of the points ``robots``, ``pieces`` and ``stations``."""
    folders = [addition_folder(addition) for addition in additions(point).values()]
    return [folder for folder in folders if folder is not None]


def register_core_names(point: str, names: Callable[[], Iterable[str]]) -> None:
    """Declare the names that the core has at an extension point. The registry of that point calls this."""
    _core_names[point] = names


def core_names(point: str) -> set[str]:
    """Return the names that the core has at an extension point. It is empty until that point's registry is imported."""
    return set(_core_names[point]()) if point in _core_names else set()


_core_names: dict[str, Callable[[], Iterable[str]]] = {}


def _package_and_name(entry: EntryPoint) -> tuple[str, str]:
    """Sort key of an entry point: the name of its distribution, then its own name."""
    return (entry.dist.name if entry.dist else "", entry.name)


def _load_extension(entry: EntryPoint) -> InstalledExtension:
    """Import the :class:`Extension` of an entry point, and check it, without a look at other extensions.

    No error is raised: the result gives the problem, and is without the extension then.
    """
    package = entry.dist.name if entry.dist else entry.name
    package_version = entry.dist.version if entry.dist else ""
    try:
        extension = entry.load()
    except (Exception, SystemExit) as problem:  # a broken package of somebody else must not stop anything here
        reason = shortened(f"{entry.value} cannot be imported: {type(problem).__name__}: {problem}", 300)
        return InstalledExtension(package, package_version, None, reason)
    reason = _problem_of(extension, entry.value)
    return InstalledExtension(package, package_version, None if reason else extension, reason)


def _problem_of(extension: object, where: str) -> str:
    """Find the reason why an object cannot be used as an extension; empty if it can be used."""
    from packaging.specifiers import InvalidSpecifier, SpecifierSet  # 0.1 s, only where there is an extension

    from simrob_drake import __version__

    if not isinstance(extension, Extension):
        return f"{where} is of type {type(extension).__name__}; it must be a simrob_drake.Extension"
    try:
        fits = SpecifierSet(extension.core).contains(__version__, prereleases=True)
    except InvalidSpecifier:
        return f"core is {extension.core!r}; it must be a version specifier such as '>=0.1,<0.3'"
    if not fits:
        return f"it works with simrob_drake {extension.core}, and this is {__version__}"
    return _malformed_addition(extension)


def _malformed_addition(extension: Extension) -> str:
    """Describe the first entry of an extension that is no import string, in one line; empty if there is none."""
    for point, described in POINTS.items():
        for name, target in getattr(extension, point).items():
            module_name, _, attribute = str(target).partition(":")
            if not module_name or not attribute:
                return f"{described} {name!r} is {target!r}; it must be an import string 'package.module:Name'"
    return ""


def _without_conflicts(found: list[InstalledExtension]) -> Iterator[InstalledExtension]:
    """Yield all installed extensions.

    One that takes a name of an earlier extension is yielded as one that is left out, with this problem.
    """
    owners = dict[tuple[str, str], str]()  # by extension point and name, the package that adds it
    for installed in found:
        if installed.extension is None:  # left out already, so that it takes no names
            yield installed
            continue
        # Names of folders are the extension's own business: nobody refers to them.
        points = [point for point in POINTS if point not in FOLDERS]
        own = {(point, name) for point in points for name in getattr(installed.extension, point)}
        taken = sorted(own & owners.keys())
        if taken:
            point, name = taken[0]
            problem = f"the {POINTS[point]} {name!r} is also one of {owners[point, name]}"
            yield installed._replace(extension=None, problem=problem)
            continue
        owners |= dict.fromkeys(own, installed.package)
        yield installed
