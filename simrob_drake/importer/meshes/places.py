"""Find the file behind the name of a mesh, and only where meshes may be read from."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from os.path import exists, isfile  # which are false for names that no file can have
from pathlib import Path, PurePosixPath
from typing import NamedTuple
from urllib.parse import unquote

from simrob_drake.base.errors import shortened
from simrob_drake.base.messages import compound, message
from simrob_drake.base.packages import Border, OutsideBorder, resolved, sorted_entries
from simrob_drake.importer.meshes.checks import references
from simrob_drake.robots.imports import ImportOptions

_NETWORK = ("http", "https", "ftp")
_ENDS = 12  # how many parts of a path that is wrong at its beginning are tried


class MeshMissing(Exception):
    """No file is behind a name; the text says what was looked for."""


class Place(NamedTuple):
    """Where a file lies, without symbolic links; ``note`` is what had to be mended in its name, if anything."""

    path: Path
    note: str = ""


class _Name(NamedTuple):
    """A name taken apart: in which package it is, and the path from there."""

    package: str
    path: str
    scheme: str


@dataclass
class MeshPlaces:
    """Where the meshes of one robot may lie."""

    source: Path  # the URDF, an absolute path
    mesh_path: tuple[Path, ...] = ()  # further folders that the user allows
    named_packages: Mapping[str, Path] = field(default_factory=dict)  # folders of packages that the user names
    _found: dict[str, Place] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        self.border = Border(self.source, self.mesh_path, self.named_packages)

    def find(self, uri: str) -> Place:
        """Return the file of a mesh.

        Names begin with ``package://``, ``model://``, ``file://`` or nothing, and may hold backslashes, %20 and letters
        in the wrong case. A path that is not there as a whole is tried by its end: authors leave their own folders in,
        and rename packages. Raises MeshMissing: it is nowhere; OutsideBorder: it lies outside of the folders that may
        be read.
        """
        if uri not in self._found:
            parsed = _named(uri)
            if parsed.scheme in _NETWORK:
                raise MeshMissing(
                    message(
                        "importer.on_the_network",
                        "is on the network, where nothing is read from; download it beside the URDF",
                    )
                )
            folder = self.border.package(parsed.package) if parsed.package else self.source.parent
            exact = [] if folder is None else [folder / parsed.path]
            self._found[uri] = self._first(uri, parsed, exact, self._by_end(parsed))
        return self._found[uri]

    def needed_by(self, path: Path) -> tuple[dict[str, Path], list[str]]:
        """Return the files that a mesh asks for, such as textures, by its names for them, and the missing names.

        Raises OutsideBorder: one lies outside of the folders that may be read; OSError: the mesh cannot be read.
        """
        found: dict[str, Path] = {}
        missing: list[str] = []
        for name in references(path):
            file = name.rsplit(maxsplit=1)[-1] if re.match(r"-[a-z]", name) else name  # behind options as -s 1 1 1
            try:
                found[name] = self._near_owner(path, file).path
            except MeshMissing:
                missing.append(name)
                continue
            if path.suffix.lower() == ".obj" != found[name].suffix.lower():  # its libraries name textures
                inner, lost = self.needed_by(found[name])
                found |= inner
                missing += lost
        return found, missing

    def _near_owner(self, owner: Path, name: str) -> Place:
        parsed = _named(name)
        last = PurePosixPath(parsed.path).name
        if parsed.scheme in _NETWORK or not last:
            raise MeshMissing(message("importer.no_file_beside_mesh", "is no file beside the mesh"))
        if parsed.package:
            return self.find(name)
        return self._first(name, parsed, [owner.parent / parsed.path], [owner.parent / last])

    def _first(self, uri: str, parsed: _Name, exact: Iterable[Path], other: Iterable[Path]) -> Place:
        """Return the first candidate that is a file and may be read, by its exact name or in another case."""
        outside: OutsideBorder | None = None
        for candidate, right in (*((path, True) for path in exact), *((path, False) for path in other)):
            path, same = _existing(candidate)
            if path is None:
                continue
            try:
                self.border.readable(path)
            except OutsideBorder as problem:
                outside = outside or problem
            else:
                root = resolved(self.border.root)
                shown = path.relative_to(root) if path.is_relative_to(root) else path
                return Place(
                    path, "" if right and same else message("importer.found_as", "found as {shown}", shown=shown)
                )
        if outside is not None:
            raise OutsideBorder(
                message("importer.mesh_outside", "mesh '{uri}': {outside}", uri=shortened(uri), outside=outside)
            )
        unknown = parsed.package and self.border.package(parsed.package) is None
        raise MeshMissing(
            message(
                "importer.no_such_file",
                "there is no such file{hint}",
                hint=compound("; {unknown_package}", unknown_package=unknown_package(parsed.package))
                if unknown
                else "",
            )
        )

    def _by_end(self, parsed: _Name) -> Iterator[Path]:
        """Yield where the file may be if the beginning of its path is wrong, the longest end first."""
        path = PurePosixPath(parsed.package, parsed.path)
        parts = [part for part in path.parts if part not in ("/", "..", ".")][-_ENDS:]
        for start in range(len(parts)):
            for folder in dict.fromkeys((self.border.root, self.source.parent, *self.border.mesh_path)):
                yield folder.joinpath(*parts[start:])


def mesh_files(robot: ET.Element, *, source: Path, options: ImportOptions) -> list[Path]:
    """Return every file that a robot's meshes are read from, as far as it exists and may be read, in order."""
    places, found = MeshPlaces(source, options.mesh_path, options.package_folders), dict[Path, None]()
    for name in dict.fromkeys(mesh.get("filename", "") for mesh in robot.iter("mesh")):
        try:
            path = places.find(name).path
            found |= dict.fromkeys((path, *places.needed_by(path)[0].values()))
        except (MeshMissing, OutsideBorder, OSError):
            continue
    return list(found)


def _named(uri: str) -> _Name:
    text = re.sub(r"^\$\(find ([\w.-]+)\)/*", r"package://\1/", uri.strip().replace("\\", "/"))
    scheme, found, rest = text.partition("://")
    scheme = scheme.lower()
    if not found:
        return _Name("", re.sub(r"^[A-Za-z]:/", "/", text), "")
    if scheme in ("package", "model"):
        package, _, path = rest.partition("/")
        return _Name(unquote(package), path.lstrip("/"), scheme)
    return _Name("", re.sub(r"^/[A-Za-z]:/", "/", rest), scheme)


def _existing(path: Path) -> tuple[Path | None, bool]:
    """Return the file with this path, without symbolic links in it, and whether its letters are in the same case."""
    for name in dict.fromkeys((str(path), unquote(str(path)))):  # a name may well hold %20 itself
        if isfile(Path(name)):
            return resolved(Path(name)), True
        found = in_any_case(Path(name))
        if found is not None:
            return resolved(found), False
    return None, False


def in_any_case(path: Path) -> Path | None:
    """Return the file whose path differs in the case of letters only; the first of several in order."""
    folder = Path(path.anchor)
    for part in path.parts[1:]:
        exact = folder / part
        if part == ".." or exists(exact):
            folder = exact
            continue
        close = next((name for name in sorted_entries(folder) if name.lower() == part.lower()), None)
        if close is None:
            return None
        folder = folder / close
    return folder if isfile(folder) else None


def unknown_package(name: str) -> str:
    """Say that a package is not found, and how it would be."""
    return message(
        "importer.package_not_found", "package '{name}' is not found, name its folder with --mesh-path DIR", name=name
    )
