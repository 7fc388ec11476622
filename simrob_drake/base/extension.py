"""Extensions: installed packages that add parts, moves, gaits, commands and models to the toolbox.

A package announces an object of class :class:`Extension` under the entry-point group ``simrob_drake.extensions``. The
object names what the package adds as import strings ``package.module:Name``. Such a string is imported when a station,
a program or a command first uses the name, so an installed extension costs nothing until then.

The extensions of this package are announced in the same way; the core works without them.

An extension that cannot be used is left out, and everything else works: it fails to import, it works with other
versions of this package, it needs an extension that is missing, or it takes a name of another extension. A name of the
core always means the core's own thing. ``simrob extensions`` lists the reasons.
"""

import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

from simrob_drake.base.errors import SimrobError, shorten
from simrob_drake.base.extras import DISTRIBUTION
from simrob_drake.base.messages import compound, core_packages, message, register_catalogues

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
        needs: names of extensions without which this one cannot be used: it is left out where one of them is missing.
        uses: names of extensions that only some functions need; see :func:`needed_extension`.
        title: title under which ``simrob --help`` lists the commands.
        commands: functions that become commands ``simrob <name>``; their docstring is the help. A name of two words
            such as ``course check`` is a command below the command of the first word.
        sensors: sections of a station file under ``sensors``, subclasses of ``Sensor``.
        monitors: sections under ``monitors``, subclasses of ``MonitorSection``.
        references: sections under ``reference``, subclasses of ``ReferenceSection``.
        forces: sections under ``forces``, subclasses of ``ForceSection``.
        couplings: sections under ``couplings``, subclasses of ``CouplingSection``.
        controllers: sections under ``controllers``, subclasses of ``LoopSection``.
        moves: lines of a program, subclasses of ``Move``, by their ``key``.
        gaits: sections of a file ``gaits.yaml``, subclasses of ``Gait``, by their ``section``.
        inverse_kinematics: subclasses of ``Solver``, by the name that ``solver=`` takes.
        plots: functions that draw a run, by the stem of the file in the result's folder ``plots``. A function takes the
            run, a :class:`~simrob_drake.results.record.run.RecordedRun`, and returns a matplotlib figure, or None if
            the run has nothing for it.
        measures: instances of :class:`~simrob_drake.results.verdict.verdict.Criterion`, by their ``name``. The verdict
            on each run has them, and the section ``verdict`` of a station file takes their bounds.
        panels: tabs of the pendant's page, instances of its class ``PendantPanel``, by any name.
        engines: sections ``solver`` by their kind, subclasses of ``OtherEngine``, in place of Drake's plant.
        importers: subclasses of ``Importer``, by a suffix of files such as ``.slx``, for XML files of any suffix by the
            outermost element such as ``<mujoco>``, or for YAML files by a key whose value is a list, such as
            ``directives:``.
        exporters: subclasses of ``StationExporter`` or ``ProgramExporter``, by the name of the format, which is an
            option of ``simrob export``.
        robots: folders with one folder for each robot (``robot.yaml``, URDF, meshes), by any name; here the string is
            ``package:folder``.
        pieces: folders with one folder for each piece (``piece.yaml``), likewise.
        stations: folders with one YAML file for each station, likewise.
        other_files: YAML files that say what files and folders are which are no stations, and which command takes them,
            as ``cli/others.yaml`` does; likewise ``package:file.yaml``.
        messages: folders with the messages of the package in other languages, one file such as ``es.yaml`` for each, by
            the first word of the messages' ids; likewise ``package:folder``. See :mod:`simrob_drake.base.messages`.
    """

    core: str
    needs: Sequence[str] = ()
    uses: Sequence[str] = ()
    title: str = message("base.title_of_extensions", "Commands of extensions")
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
    plots: Additions = field(default_factory=dict)
    measures: Additions = field(default_factory=dict)
    panels: Additions = field(default_factory=dict)
    engines: Additions = field(default_factory=dict)
    importers: Additions = field(default_factory=dict)
    exporters: Additions = field(default_factory=dict)
    robots: Additions = field(default_factory=dict)
    pieces: Additions = field(default_factory=dict)
    stations: Additions = field(default_factory=dict)
    other_files: Additions = field(default_factory=dict)
    messages: Additions = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check the types; raises TypeError if one is wrong. It is reported as a failure of the package's import."""
        if not isinstance(self.core, str):
            raise TypeError(
                message(
                    "base.no_version_specifier",
                    "core is {core}; it must be a version specifier such as '>=0.1,<0.3'",
                    core=repr(self.core),
                )
            )
        if not isinstance(self.title, str):
            raise TypeError(f"title is {self.title!r}; it must be a text")
        # A text is a sequence of texts, too: needs="linear" would be read as six names of one letter.
        for key in ("needs", "uses"):
            names = getattr(self, key)
            if not isinstance(names, list | tuple) or not all(
                isinstance(name, str) for name in names
            ):
                raise TypeError(f"{key} is {names!r}; it must be a list of names of extensions")
        for point in POINTS:
            entries = getattr(self, point)
            if not isinstance(entries, Mapping):
                raise TypeError(
                    f"{point} is {entries!r}; it must be a mapping of names to import strings"
                )


POINTS = {
    "commands": message("base.command", "command"),
    "sensors": message("base.kind_of_sensor", "kind of sensor"),
    "monitors": message("base.kind_of_monitor", "kind of monitor"),
    "references": message("base.kind_of_reference", "kind of reference"),
    "forces": message("base.kind_of_force", "kind of force"),
    "couplings": message("base.kind_of_coupling", "kind of coupling"),
    "controllers": message("base.kind_of_controller", "kind of controller"),
    "moves": message("base.kind_of_move", "kind of move"),
    "gaits": message("base.kind_of_gait", "kind of gait"),
    "inverse_kinematics": message(
        "base.solver_of_inverse_kinematics", "solver of inverse kinematics"
    ),
    "plots": message("base.plot", "plot"),
    "measures": message("base.measure_of_verdict", "measure of the verdict"),
    "panels": message("base.panel_of_pendant", "panel of the pendant"),
    "engines": message("base.engine", "engine"),
    "importers": message("base.importer_of", "importer of"),
    "exporters": message("base.exporter_to", "exporter to"),
    "robots": message("base.folder_of_robots", "folder of robots"),
    "pieces": message("base.folder_of_pieces", "folder of pieces"),
    "stations": message("base.folder_of_stations", "folder of stations"),
    "other_files": message("base.file_about_other_files", "file about other files"),
    "messages": message("base.folder_of_messages", "folder of messages"),
}
"""The extension points: the field of :class:`Extension`, and the words for one of its entries."""

MODELS = ("robots", "pieces", "stations")
"""Extension points whose strings name folders of models."""

FOLDERS = (*MODELS, "messages")
"""Extension points whose strings name folders of data."""

DATA = (*FOLDERS, "other_files")
"""Extension points whose strings name folders and files of data instead of Python objects."""


class InstalledExtension(NamedTuple):
    """An extension that is installed, whether it can be used or not.

    Attributes:
        name: name of its entry point. One package may announce several extensions.
        package: name of the distribution that announces it, such as ``simrob-thermal``.
        version: version of that distribution.
        extension: what it adds; None if it is left out.
        problem: why it is left out, in one line; empty if it is used.
    """

    name: str
    package: str
    version: str
    extension: Extension | None
    problem: str

    def with_problem(self, problem: str) -> "InstalledExtension":
        """Return this extension as one that is left out because of a problem."""
        return self._replace(extension=None, problem=problem)

    def additions_at(self, point: str) -> "list[Addition]":
        """List what the extension adds at an extension point (a key of POINTS). Empty if the extension is left out."""
        entries: Additions = getattr(self.extension, point) if self.extension is not None else {}
        return [
            Addition(name=name, package=self.package, target=target, extension=self.name)
            for name, target in entries.items()
        ]


class Addition(NamedTuple):
    """One thing that an extension adds.

    Attributes:
        name: name by which users refer to it.
        package: name of the distribution that adds it.
        target: its import string ``package.module:Name``, or ``package:folder``.
        extension: name of the extension, of which the package may have several.
    """

    name: str
    package: str
    target: str
    extension: str

    @property
    def owner(self) -> str:
        """Package and extension, as messages name them."""
        return message(
            "base.package_and_extension",
            "package {package}, extension {extension}",
            package=self.package,
            extension=self.extension,
        )


class BrokenExtension(SimrobError):
    """Raised when something of an extension is used and cannot be imported."""


class MissingExtension(SimrobError):
    """Raised when something needs an extension that is not installed or is left out."""


class ExtensionWarning(UserWarning):
    """Warning that a plot, a measure or a panel of an extension is left out.

    They are used in every run or page without being named in a file, so there is no error that gives the reason.
    """


@cache
def installed_extensions() -> tuple[InstalledExtension, ...]:
    """Find all installed extensions: those of this package first, then in the order of their packages' names.

    The extensions of this package come first so that no other package can take their names.
    """
    # The order decides which of two extensions with the same name is used, so it must not depend on the file system.
    found = [
        _load_extension(entry) for entry in sorted(entry_points(group=GROUP), key=_order_of_entry)
    ]
    # The needs are checked before the names, since an extension that is left out takes no names from others. They are
    # checked once more at the end, since an extension that was left out because of its names may be needed by others.
    without_conflicts = list(_without_conflicts(_without_missing_needs(found)))
    return tuple(_without_missing_needs(without_conflicts))


def find_extension(name: str) -> InstalledExtension | None:
    """Find an installed extension by its name. Returns None if there is none."""
    return next((installed for installed in installed_extensions() if installed.name == name), None)


@contextmanager
def needed_extension(name: str, purpose: str) -> Iterator[None]:
    """Context manager around the import of another extension, which only one function of an extension needs.

    Args:
        name: name of the other extension, one of ``uses``.
        purpose: what needs it, the subject of the message, such as ``simrob legged --tune``.

    Raises:
        MissingExtension: the other extension is not installed, or is left out. The message says why.
    """
    installed = find_extension(name)
    if installed is None:
        raise MissingExtension(
            message(
                "base.extension_not_installed",
                "{purpose} needs the extension {name}, which is not installed",
                purpose=purpose,
                name=name,
            )
        )
    if installed.extension is None:
        raise MissingExtension(
            message(
                "base.extension_left_out",
                "{purpose} needs the extension {name}, which is left out: {problem}",
                purpose=purpose,
                name=name,
                problem=installed.problem,
            )
        )
    yield


def load_addition_class(addition: Addition, base: Any, named_by: str = "") -> Any:
    """Import a class that an extension adds, and check it.

    Args:
        addition: what to import.
        base: class that it must be derived from.
        named_by: attribute of the class that must be the announced name, such as the ``key`` of a move; none if empty.

    Raises:
        BrokenExtension: the class cannot be imported, is not derived from the base, lacks a method that the base
            requires, or has another name. The message names the package.
    """
    found = load_addition(addition)
    # issubclass would raise a TypeError for an object that is no class, such as a function.
    if not (isinstance(found, type) and issubclass(found, base)):
        expected = message(
            "base.a_subclass_of",
            "a subclass of {module}.{name}",
            module=base.__module__,
            name=base.__name__,
        )
        raise BrokenExtension(
            message(
                "base.addition_of_wrong_type",
                "{owner}: {target} is {found}; it must be {expected}",
                owner=addition.owner,
                target=addition.target,
                found=repr(found),
                expected=expected,
            )
        )
    # Python reports missing methods only when an object is made, which would be in the middle of a run.
    abstract = sorted(getattr(found, "__abstractmethods__", ()))
    if abstract:
        lacking = ", ".join(abstract)
        raise BrokenExtension(
            message(
                "base.class_lacks_methods",
                "{owner}: {target} lacks {lacking}, which {name} requires",
                owner=addition.owner,
                target=addition.target,
                lacking=lacking,
                name=base.__name__,
            )
        )
    if named_by:
        _check_name(addition, found, named_by)
    return found


def check_usable(point: str, name: str, base: Any, named_by: str = "") -> None:
    """Raise BrokenExtension if an extension adds a class of this name at a point, and the class cannot be used.

    Registries call it for a name that they do not know, so that the message gives the true cause.
    """
    # The name is not in the registry either because no extension adds it, or because its class was left out there.
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
        # One broken class must not hide the others: only a user of its name needs the reason.
        except BrokenExtension:
            continue
    return found


def usable_objects(point: str, base: Any, named_by: str = "") -> dict[str, Any]:
    """Import all plots, measures or panels that extensions add, by name.

    An object that cannot be used is left out with an :class:`ExtensionWarning`.

    Args:
        point: the extension point, a key of POINTS.
        base: class that the objects must be instances of.
        named_by: attribute of an object that must be the announced name. Nothing is checked if it is empty.
    """
    found = {}
    for name, addition in additions(point).items():
        try:
            found[name] = _load_addition_object(addition, base, named_by)
        except BrokenExtension as problem:
            warnings.warn(
                message("base.is_left_out", "{problem}; it is left out", problem=problem),
                ExtensionWarning,
                stacklevel=2,
            )
    return found


def _load_addition_object(addition: Addition, base: Any, named_by: str) -> Any:
    """Import an object that an extension adds, and check it.

    Args:
        addition: the extension's announcement of the object.
        base: class that the object must be an instance of.
        named_by: attribute of the object that must be the announced name. Nothing is checked if it is empty.

    Raises:
        BrokenExtension: the object cannot be imported, has another class, or another name.
    """
    found = load_addition(addition)
    if not isinstance(found, base):
        expected = message(
            "base.an_instance_of",
            "an instance of {module}.{name}",
            module=base.__module__,
            name=base.__name__,
        )
        raise BrokenExtension(
            message(
                "base.addition_of_wrong_type",
                "{owner}: {target} is {found}; it must be {expected}",
                owner=addition.owner,
                target=addition.target,
                found=repr(found),
                expected=expected,
            )
        )
    if named_by:
        _check_name(addition, found, named_by)
    return found


def _check_name(addition: Addition, found: Any, named_by: str) -> None:
    """Check that the name that a class or object has for itself is the announced one.

    Args:
        addition: the extension's announcement.
        found: the imported class or object.
        named_by: attribute of the class or object with its own name, such as ``key``.

    Raises:
        BrokenExtension: the names differ.
    """
    # Files and results contain the object's own name, which must find the same object again through the announced name.
    own_name = getattr(found, named_by, None)
    if own_name != addition.name:
        problem = message(
            "base.announced_under_other_name",
            "has the {named_by} {own_name}, but is announced as {announced_name}; both must be equal",
            named_by=named_by,
            own_name=repr(own_name),
            announced_name=repr(addition.name),
        )
        raise BrokenExtension(
            message(
                "base.addition_problem",
                "{owner}: {target} {problem}",
                owner=addition.owner,
                target=addition.target,
                problem=problem,
            )
        )


def additions(point: str) -> dict[str, Addition]:
    """Find what the extensions in use add at one extension point (a key of POINTS), by name.

    Names that the core has there are left out: they mean the core's own thing. The names of the core are known once the
    module with its own entries at this point is imported.
    """
    taken = core_names(point)
    found = {}
    for installed in installed_extensions():
        for addition in installed.additions_at(point):
            # A command "course check" is below a command "course", which the core may have. Other names are one word.
            if addition.name not in taken and addition.name.partition(" ")[0] not in taken:
                found[addition.name] = addition
    return found


def load_addition(addition: Addition) -> Any:
    """Import the object that an extension adds.

    Raises:
        BrokenExtension: its module cannot be imported, or has no such name. The message names the package.
    """
    module_name, _, name = addition.target.partition(":")
    try:
        return getattr(import_module(module_name), name)
    # Code of an extension may raise anything, and a script may end with sys.exit when it is imported.
    except (Exception, SystemExit) as problem:
        reason = shorten(
            compound("{name}: {problem}", name=type(problem).__name__, problem=problem), 200
        )
        raise BrokenExtension(
            message(
                "base.addition_not_importable",
                "{owner}: {target} cannot be imported ({reason})",
                owner=addition.owner,
                target=addition.target,
                reason=reason,
            )
        ) from problem


@contextmanager
def code_of_extension(owner: str, name: str) -> Iterator[None]:
    """Context manager around code of an extension, which blames the extension for errors that no user causes.

    Args:
        owner: package and extension, see `Addition.owner`.
        name: what the code is, such as ``the exporter csv``.

    Raises:
        SimrobError: the code raises a SimrobError, which is passed on.
        BrokenExtension: the code raises anything else, or ends the process. The message names the package.
    """
    try:
        yield
    # An error of the user's input, such as a wrong file, is no fault of the extension.
    except SimrobError:
        raise
    # Interrupts by the user are neither of these classes, and pass.
    except (Exception, SystemExit) as problem:
        reason = shorten(
            compound("{name}: {problem}", name=type(problem).__name__, problem=problem), 200
        )
        raise BrokenExtension(
            message(
                "base.extension_fails",
                "{owner}: {name} fails ({reason})",
                owner=owner,
                name=name,
                reason=reason,
            )
        ) from problem


def addition_path(addition: Addition) -> Path | None:
    """Find the folder or file of data that an extension adds, without importing the package.

    Returns None if there is no such folder or file.
    """
    package, _, name = addition.target.partition(":")
    try:
        spec = find_spec(package)
    # ImportError: the package above this one is missing. ValueError: the name is empty.
    except (ImportError, ValueError):
        return None
    # A module that is a single file has no locations, and no folder of data.
    if spec is None or not spec.submodule_search_locations:
        return None
    # A namespace package may have several folders, the first of which Python searches first.
    path = Path(next(iter(spec.submodule_search_locations)), name)
    return path if path.exists() else None


_FOLDER = message("base.folder", "folder")
_FILE = message("base.file", "file")


def check_addition(point: str, addition: Addition) -> None:
    """Check that a Python object of an extension can be imported, or that its folder or file of data exists.

    Args:
        point: the extension point, a key of POINTS.
        addition: the extension's announcement of the object or the data.

    Raises:
        BrokenExtension: the object cannot be imported, there is no such folder or file, or there is a file in place of
            a folder, or the other way round.
    """
    if point not in DATA:
        load_addition(addition)
        return
    expected = _FOLDER if point in FOLDERS else _FILE
    path = addition_path(addition)
    if path is None:
        raise BrokenExtension(
            message(
                "base.addition_missing",
                "{owner}: the {expected} {target} does not exist",
                owner=addition.owner,
                expected=expected,
                target=addition.target,
            )
        )
    found = _FOLDER if path.is_dir() else _FILE
    if found != expected:
        raise BrokenExtension(
            message(
                "base.addition_is_no_folder",
                "{owner}: {target} is a {found}; it must be a {expected}",
                owner=addition.owner,
                target=addition.target,
                found=found,
                expected=expected,
            )
        )


def addition_folders(point: str) -> list[Path]:
    """Find the folders that extensions add at one of the points ``robots``, ``pieces`` and ``stations``."""
    paths = [addition_path(addition) for addition in additions(point).values()]
    return [path for path in paths if path is not None and path.is_dir()]


def addition_files(point: str) -> list[Path]:
    """Find the files of data that extensions add at an extension point such as ``other_files``."""
    paths = [addition_path(addition) for addition in additions(point).values()]
    return [path for path in paths if path is not None and path.is_file()]


def _message_folder(package: str) -> Path | None:
    """Find the folder with the messages of an extension by the first word of their ids. None if there is none."""
    addition = additions("messages").get(package)
    return addition_path(addition) if addition is not None else None


def register_core_names(point: str, names: Callable[[], Iterable[str]]) -> None:
    """Declare the names that the core has at an extension point. The registry of that point calls this."""
    _core_names[point] = names


def core_names(point: str) -> set[str]:
    """Return the names that the core has at an extension point. It is empty until that point's registry is imported."""
    # The registries are imported late, since most of them load Drake.
    return set(_core_names[point]()) if point in _core_names else set()


_core_names: dict[str, Callable[[], Iterable[str]]] = {}


def _order_of_entry(entry: EntryPoint) -> tuple[bool, str, str]:
    """Sort key of an entry point: those of this package first, then by the names of distribution and entry point."""
    package = entry.dist.name if entry.dist else ""
    # False comes before True.
    return (package != DISTRIBUTION, package, entry.name)


def _load_extension(entry: EntryPoint) -> InstalledExtension:
    """Import the :class:`Extension` of an entry point, and check it without regard to other extensions.

    No error is raised. If the extension cannot be used, the result has the problem, and ``extension`` is None.
    """
    found = InstalledExtension(
        name=entry.name,
        package=entry.dist.name if entry.dist else entry.name,
        version=entry.dist.version if entry.dist else "",
        extension=None,
        problem="",
    )
    try:
        extension = entry.load()
    # A broken package of somebody else must not stop a command that does not use it.
    except (Exception, SystemExit) as error:
        return found.with_problem(_import_problem(entry, error))
    # The extensions of this package have its version, so there is nothing to compare.
    is_own = found.package == DISTRIBUTION
    problem = _problem_of(extension, entry.value, checks_version=not is_own)
    return found.with_problem(problem) if problem else found._replace(extension=extension)


def _import_problem(entry: EntryPoint, error: BaseException) -> str:
    """Describe in one line why the object of an entry point cannot be imported.

    Args:
        entry: the entry point.
        error: error that the import raised.
    """
    missing = error.name if isinstance(error, ModuleNotFoundError) else None
    # The extension's own module, or a package above it, is missing, and not a module that the extension imports.
    if missing and f"{entry.module}.".startswith(f"{missing}."):
        return message(
            "base.module_not_installed", "its module {module} is not installed", module=entry.module
        )
    return shorten(
        message(
            "base.entry_not_importable",
            "{entry} cannot be imported: {kind}: {error}",
            entry=entry.value,
            kind=type(error).__name__,
            error=error,
        ),
        300,
    )


def _problem_of(extension: object, where: str, *, checks_version: bool) -> str:
    """Describe in one line why an imported object cannot be used as an extension. Empty if it can be used.

    Args:
        extension: the imported object, of any type.
        where: import string of the object, for the message.
        checks_version: whether the extension must fit the version of simrob_drake.
    """
    if not isinstance(extension, Extension):
        return message(
            "base.no_extension_object",
            "{where} is of type {kind}; it must be a simrob_drake.Extension",
            where=where,
            kind=type(extension).__name__,
        )
    version_problem = _version_problem(extension.core) if checks_version else ""
    return version_problem or _malformed_addition(extension)


def _version_problem(core: str) -> str:
    """Describe in one line why a version specifier does not fit this version of simrob_drake. Empty if it fits.

    Args:
        core: the specifier, such as ``>=0.1,<0.3``.
    """
    # The import takes 0.1 s. It is needed for extensions of other packages only.
    from packaging.specifiers import InvalidSpecifier, SpecifierSet

    from simrob_drake import __version__

    try:
        # A specifier such as >=0.1 would otherwise refuse the development version 0.2.dev1.
        fits = SpecifierSet(core).contains(__version__, prereleases=True)
    except InvalidSpecifier:
        return message(
            "base.no_version_specifier",
            "core is {core}; it must be a version specifier such as '>=0.1,<0.3'",
            core=repr(core),
        )
    return (
        ""
        if fits
        else message(
            "base.other_version_needed",
            "it needs simrob_drake {core}, but version {version} is installed",
            core=core,
            version=__version__,
        )
    )


def _malformed_addition(extension: Extension) -> str:
    """Describe the first malformed addition of an extension, in one line. Empty if all are well formed.

    The target of an addition must be an import string. A command of two words, such as ``course check``, also needs the
    command of its first word in the same extension. Nothing is imported.
    """
    for point, described in POINTS.items():
        for name, target in getattr(extension, point).items():
            module_name, _, attribute = str(target).partition(":")
            if not module_name or not attribute:
                return message(
                    "base.no_import_string",
                    "{described} {name} is {target}; it must be an import string 'package.module:Name'",
                    described=described,
                    name=repr(name),
                    target=repr(target),
                )
    # The help of a command lists the commands below it, so a command of two words needs the one above.
    for name in extension.commands:
        above, is_below, _ = name.partition(" ")
        if is_below and above not in extension.commands:
            return message(
                "base.no_command_above",
                "the command {name} needs the command {above}, which the extension does not have",
                above=repr(above),
                name=repr(name),
            )
    return ""


def _without_missing_needs(found: list[InstalledExtension]) -> list[InstalledExtension]:
    """Leave out the extensions that need another extension which is not installed or is itself left out.

    Returns:
        all extensions in the same order. Those that are left out have the problem.
    """
    usable = {installed.name for installed in found if installed.extension is not None}
    checked = []
    for installed in found:
        needs = installed.extension.needs if installed.extension is not None else ()
        missing = next((name for name in needs if name not in usable), None)
        if missing is None:
            checked.append(installed)
            continue
        # The two cases need different remedies: to install the other extension, or to repair it.
        is_installed = any(other.name == missing for other in found)
        state = (
            message("base.not_used", "is left out")
            if is_installed
            else message("base.not_installed", "is not installed")
        )
        checked.append(
            installed.with_problem(
                message(
                    "base.needs_extension",
                    "it needs the extension {missing}, which {state}",
                    missing=missing,
                    state=state,
                )
            )
        )
    # An extension that has just been left out may be needed by another one, so the check is repeated.
    return checked if checked == found else _without_missing_needs(checked)


def _without_conflicts(found: list[InstalledExtension]) -> Iterator[InstalledExtension]:
    """Yield each extension, as left out with this problem if a name of it belongs to an earlier extension."""
    # Package of each extension, by the name of the extension.
    packages = dict[str, str]()
    # Extension that has taken a name, by extension point and name.
    owners = dict[tuple[str, str], Addition]()
    # Names of data are the extension's own business: nobody refers to them. Only the ids of messages begin with theirs.
    points = [point for point in POINTS if point not in DATA or point == "messages"]
    for installed in found:
        # It was left out before, so it takes no names.
        if installed.extension is None:
            yield installed
            continue
        if installed.name in packages:
            yield installed.with_problem(
                message(
                    "base.extension_name_taken",
                    "package {package} already has an extension of this name",
                    package=packages[installed.name],
                )
            )
            continue
        own = {
            (point, addition.name): addition
            for point in points
            for addition in installed.additions_at(point)
        }
        # An extension is used as a whole or not at all: half of it would give errors that nobody understands.
        taken = sorted(own.keys() & owners.keys())
        if taken:
            point, name = taken[0]
            yield installed.with_problem(
                message(
                    "base.addition_name_taken",
                    "the {point} {name} already belongs to {owner}",
                    point=POINTS[point],
                    name=repr(name),
                    owner=owners[point, name].owner,
                )
            )
            continue
        packages[installed.name] = installed.package
        owners |= own
        yield installed


register_core_names("messages", core_packages)
register_catalogues(_message_folder)
