"""Find the files of a robot's meshes, in the folders from which files may be read.

A URDF names a mesh by a path, or by a URI such as ``package://arms/meshes/link1.stl``. Published robots often name
meshes wrongly: with the folders of their author, in other capital letters, or with a package that was renamed. The
search therefore tries the end of such a path in the robot's folders, too. The border is the set of folders from which
files may be read: the robot's own package and those that the user allows.
"""

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

# Unlike the methods of Path, these functions are false for names that no file can have.
from os.path import exists, isfile
from pathlib import Path, PurePosixPath
from typing import NamedTuple
from urllib.parse import unquote

from simrob_drake.base.errors import shorten
from simrob_drake.base.messages import compound, message
from simrob_drake.base.packages import Border, OutsideBorder, resolve_path, sorted_entries
from simrob_drake.importer.meshes.checks import references
from simrob_drake.robots.imports import ImportOptions

_NETWORK = ("http", "https", "ftp")
"""Schemes of URIs whose files would have to be downloaded."""

_MOST_TRIED_PARTS = 12
"""Largest count of folders and names at the end of a wrong path with which files are searched."""


class MeshMissing(Exception):
    """Raised when no file has the name of a mesh. The text of the error contains the reason."""


class FoundFile(NamedTuple):
    """A file that was found.

    Attributes:
        path: its path without symbolic links.
        note: a sentence for the user if the file has another name than the robot gives; else empty.
    """

    path: Path
    note: str = ""


class _ExistingFile(NamedTuple):
    """A file that exists.

    Attributes:
        path: its path without symbolic links.
        is_exact: whether its name has the same capital letters as the path that was searched.
    """

    path: Path
    is_exact: bool


class _ParsedName(NamedTuple):
    """The components of a mesh's name.

    Attributes:
        package: name of the package in which the file is; empty if the name contains none.
        path: the path in the package, or the whole path.
        scheme: the beginning of a URI, such as ``package`` or ``file``; empty for a plain path.
    """

    package: str
    path: str
    scheme: str


@dataclass
class MeshPlaces:
    """Finds the mesh files of one robot.

    Attributes:
        source: absolute path of the robot's URDF.
        mesh_path: further folders that the user allows.
        named_packages: folders of packages, by their names, that the user gives.
        border: the folders from which files may be read.
    """

    source: Path
    mesh_path: tuple[Path, ...] = ()
    named_packages: Mapping[str, Path] = field(default_factory=dict)
    _found: dict[str, FoundFile] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        self.border = Border(self.source, self.mesh_path, self.named_packages)

    def find(self, uri: str) -> FoundFile:
        """Find the file of a mesh.

        Names begin with ``package://``, ``model://``, ``file://`` or nothing, and may contain backslashes, ``%20`` and
        wrong capital letters. If no file has the whole path, files with the end of the path are searched.

        Args:
            uri: name of the mesh, as it stands in the URDF.

        Raises:
            MeshMissing: no file has this name, or it is the address of a file on the network.
            OutsideBorder: the file is outside of the folders from which files may be read.
        """
        # The search may try hundreds of paths, and each mesh is named at least twice: as visual and as collision.
        if uri in self._found:
            return self._found[uri]
        name = _parse_name(uri)
        if name.scheme in _NETWORK:
            raise MeshMissing(
                message(
                    "importer.on_the_network",
                    "is on the network, from which nothing is read; download it into the folder of the URDF",
                )
            )
        # A name without a package is relative to the URDF.
        folder = self.border.package(name.package) if name.package else self.source.parent
        exact_paths = [] if folder is None else [folder / name.path]
        self._found[uri] = self._first_readable(uri, name, exact_paths, self._paths_by_end(name))
        return self._found[uri]

    def needed_by(self, path: Path) -> tuple[dict[str, Path], list[str]]:
        """Find the files to which a mesh refers, such as material libraries and textures.

        Args:
            path: the mesh, or a material library.

        Returns:
            the files by their names in the mesh, and the names of files that are missing.

        Raises:
            OutsideBorder: a file is outside of the folders from which files may be read.
            OSError: the mesh cannot be read.
        """
        found: dict[str, Path] = {}
        missing: list[str] = []
        for name in references(path):
            # Options may stand before the file, as in "-s 1 1 1 wood.png".
            has_options = re.match(r"-[a-z]", name)
            file_name = name.rsplit(maxsplit=1)[-1] if has_options else name
            try:
                # A missing texture is no error: the mesh has its shape without it.
                found[name] = self._find_near(path, file_name).path
            except MeshMissing:
                missing.append(name)
                continue
            # The material libraries of an OBJ refer to textures.
            is_library = path.suffix.lower() == ".obj" and found[name].suffix.lower() != ".obj"
            if is_library:
                textures, missing_textures = self.needed_by(found[name])
                found |= textures
                missing += missing_textures
        return found, missing

    def _find_near(self, owner: Path, name: str) -> FoundFile:
        """Find a file to which a mesh refers: by its path from the folder of the mesh, or directly in this folder.

        A name that contains a package is searched as by :meth:`find`.

        Args:
            owner: the mesh.
            name: name of the file in the mesh.

        Raises:
            MeshMissing: no file has this name, or it is the address of a file on the network.
            OutsideBorder: the file is outside of the folders from which files may be read.
        """
        parsed = _parse_name(name)
        last = PurePosixPath(parsed.path).name
        if parsed.scheme in _NETWORK or not last:
            raise MeshMissing(
                message("importer.no_file_beside_mesh", "is not a file next to the mesh")
            )
        if parsed.package:
            return self.find(name)
        # Authors often leave their own folders in the name; the file itself is delivered with the mesh.
        return self._first_readable(
            name, parsed, [owner.parent / parsed.path], [owner.parent / last]
        )

    def _first_readable(
        self,
        uri: str,
        name: _ParsedName,
        exact_paths: Iterable[Path],
        other_paths: Iterable[Path],
    ) -> FoundFile:
        """Find the first path of a file that exists and may be read.

        Args:
            uri: name of the file, for errors.
            name: the components of the name.
            exact_paths: paths that follow from the name.
            other_paths: paths that are tried afterwards. A file found there gets a note.

        Raises:
            MeshMissing: there is no such file.
            OutsideBorder: there are such files, but none may be read.
        """
        candidates = [(path, True) for path in exact_paths]
        candidates += [(path, False) for path in other_paths]
        outside: OutsideBorder | None = None
        for candidate, is_from_name in candidates:
            existing = _existing_file(candidate)
            if existing is None:
                continue
            try:
                self.border.readable(existing.path)
            except OutsideBorder as problem:
                # Another path may be allowed. The first refusal is kept for the error.
                outside = outside or problem
                continue
            # Only a file with exactly the given name needs no note in the report.
            if is_from_name and existing.is_exact:
                return FoundFile(existing.path)
            shown = self._relative_to_package(existing.path)
            return FoundFile(
                existing.path, message("importer.found_as", "found as {shown}", shown=shown)
            )

        # A file that exists and may not be read is the better explanation: the user can allow its folder.
        if outside is not None:
            raise OutsideBorder(
                message(
                    "importer.mesh_outside",
                    "mesh '{uri}': {outside}",
                    uri=shorten(uri),
                    outside=outside,
                )
            )
        hint = ""
        if name.package and self.border.package(name.package) is None:
            hint = compound("; {unknown_package}", unknown_package=unknown_package(name.package))
        raise MeshMissing(
            message("importer.no_such_file", "there is no such file{hint}", hint=hint)
        )

    def _relative_to_package(self, path: Path) -> Path:
        """Shorten a path to the part below the robot's package. A path outside of the package stays."""
        root = resolve_path(self.border.root)
        return path.relative_to(root) if path.is_relative_to(root) else path

    def _paths_by_end(self, name: _ParsedName) -> Iterator[Path]:
        """Yield paths that end like a name, in the folders of the robot and of the user, the longest end first."""
        path = PurePosixPath(name.package, name.path)
        # Steps upwards would lead out of the folders in which the end is searched.
        parts = [part for part in path.parts if part not in ("/", "..", ".")]
        last_parts = parts[-_MOST_TRIED_PARTS:]
        # Each folder once: the URDF may be in the root of its package.
        folders = list(
            dict.fromkeys((self.border.root, self.source.parent, *self.border.mesh_path))
        )
        for start in range(len(last_parts)):
            for folder in folders:
                yield folder.joinpath(*last_parts[start:])


def mesh_files(robot: ET.Element, *, source: Path, options: ImportOptions) -> list[Path]:
    """Find all files from which a robot's meshes are read, in order.

    A mesh is left out, with the files to which it refers, if it is missing or if one of these files may not be read. A
    missing texture is left out alone.

    Args:
        robot: the ``robot`` element.
        source: absolute path of the robot's URDF.
        options: options of the import, with the folders that the user allows.
    """
    places = MeshPlaces(source, options.mesh_path, options.package_folders)
    names = dict.fromkeys(mesh.get("filename", "") for mesh in robot.iter("mesh"))
    files: list[Path] = []
    for name in names:
        # A mesh that cannot be found is reported by the import itself.
        try:
            path = places.find(name).path
            needed, _ = places.needed_by(path)
        except (MeshMissing, OutsideBorder, OSError):
            continue
        files += [path, *needed.values()]
    return list(dict.fromkeys(files))


def _parse_name(uri: str) -> _ParsedName:
    """Take the name of a mesh apart. The drive of a Windows path, such as ``C:``, is left out."""
    # ROS 1 also has the form $(find arms)/meshes/link1.stl.
    text = re.sub(r"^\$\(find ([\w.-]+)\)/*", r"package://\1/", uri.strip().replace("\\", "/"))
    scheme, separator, rest = text.partition("://")
    scheme = scheme.lower()
    if not separator:
        return _ParsedName(package="", path=re.sub(r"^[A-Za-z]:/", "/", text), scheme="")
    if scheme in ("package", "model"):
        package, _, path = rest.partition("/")
        return _ParsedName(unquote(package), path.lstrip("/"), scheme)
    return _ParsedName(package="", path=re.sub(r"^/[A-Za-z]:/", "/", rest), scheme=scheme)


def _existing_file(path: Path) -> _ExistingFile | None:
    """Find a file by its path, also with wrong capital letters or characters written like ``%20``.

    Returns None if there is no such file.
    """
    # The unchanged path comes first, because the name of a file may contain %20 itself.
    for name in dict.fromkeys((str(path), unquote(str(path)))):
        if isfile(Path(name)):
            return _ExistingFile(resolve_path(Path(name)), is_exact=True)
        found = in_any_case(Path(name))
        if found is not None:
            return _ExistingFile(resolve_path(found), is_exact=False)
    return None


def in_any_case(path: Path) -> Path | None:
    """Find the file whose path equals a given absolute one up to capital letters.

    In each folder on the way, the exact name is taken if it exists, else the first one in order that differs in capital
    letters only. Returns None if this way leads to no file.
    """
    folder = Path(path.anchor)
    # Folder by folder from the root, as any of them may have other capital letters.
    for part in path.parts[1:]:
        exact = folder / part
        # A folder with the exact name is preferred. Its neighbour may differ in capital letters only.
        if part == ".." or exists(exact):
            folder = exact
            continue
        matching = (name for name in sorted_entries(folder) if name.lower() == part.lower())
        entry = next(matching, None)
        if entry is None:
            return None
        folder = folder / entry
    return folder if isfile(folder) else None


def unknown_package(name: str) -> str:
    """Sentence for a package that is not found, with the option that would give its folder."""
    return message(
        "importer.package_not_found",
        "package '{name}' is not found; give its folder with --mesh-path DIR",
        name=name,
    )
