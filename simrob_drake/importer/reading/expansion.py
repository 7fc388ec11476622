"""The expansion of a xacro file, in a process of its own that may compute and read, and nothing else.

Xacro evaluates Python expressions, and what it does to keep them harmless can be got around. So the process refuses
whatever it is not known to need: to write, to start programs, to open connections, to import, and to read outside of
the folders where meshes may be read. ``python -m simrob_drake.importer.reading.expansion FILE JSON`` prints the URDF,
or says in one line why not and exits with 1; JSON holds ``mesh_path`` and ``arguments``.
"""

import errno
import json
import os
import resource
import sys
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path

from simrob_drake.importer.packages import MANIFEST, find_package, package_root

_HARMLESS = ("builtins.id", "compile", "exec", "glob.glob", "os.listdir", "os.scandir")
_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
_MEMORY = 1_000_000_000  # bytes


def expand(source: Path, mesh_path: Iterable[Path], arguments: dict[str, str]) -> str:
    """Return the URDF that a xacro file stands for.

    From now on this process is held: it can hardly do anything else any more.

    Raises:
        Exception: whatever xacro, or what is evaluated by it, raises.
    """
    import encodings.latin_1  # noqa: F401  # what would be imported later
    import xml.dom.expatbuilder  # noqa: F401

    import xacro
    import yaml  # noqa: F401
    from xacro import substitution_args

    folders = [package_root(source), *mesh_path]

    def find(name: str) -> str:
        folder = find_package(name, root=folders[0], mesh_path=mesh_path)
        if folder is None:
            raise LookupError(f"package '{name}' is not found, name its folder with --mesh-path DIR")
        folders.append(folder)
        return str(folder)

    substitution_args._eval_find = substitution_args._eval_dict["find"] = find
    for kind, limit in ((resource.RLIMIT_AS, _MEMORY), (resource.RLIMIT_CORE, 0)):
        with suppress(ValueError, OSError):  # not every system has each of them
            resource.setrlimit(kind, (limit, limit))
    sys.addaudithook(_holder(folders))
    document = xacro.process_file(str(source), mappings=arguments)
    return str(document.documentElement.toxml())


def _holder(folders: list[Path]) -> Callable[[str, tuple[object, ...]], None]:
    """Return what refuses all that is neither harmless nor the reading of a file in the folders."""

    def hold(event: str, about: tuple[object, ...]) -> None:
        if event in _HARMLESS:
            return
        if event != "open" or not isinstance(about[0], str | bytes) or about[2] & _WRITING:  # type: ignore[operator]
            raise PermissionError(errno.EPERM, "a xacro file may compute and read, but not do this", event)
        path = Path(os.fsdecode(about[0])).resolve()
        if path.name != MANIFEST and not any(path.is_relative_to(folder.resolve()) for folder in folders):
            listed = ", ".join(map(str, folders))
            advice = f"lies outside of the allowed folders ({listed}); allow it with --mesh-path {path.parent}"
            raise PermissionError(errno.EACCES, advice, str(path))

    return hold


def _told(problem: Exception) -> str:
    """Return an error in one line: that of xacro, or what lies behind it where xacro only repeats that."""
    cause = getattr(problem, "exc", None) or problem
    if isinstance(cause, OSError):
        text = f"{cause.filename}: {cause.strerror}"
    else:
        text = str(cause if isinstance(cause, LookupError | SyntaxError) else problem)
    return " ".join(text.split()) or type(cause).__name__


if __name__ == "__main__":
    given = json.loads(sys.argv[2])
    try:
        urdf = expand(Path(sys.argv[1]), [Path(folder) for folder in given["mesh_path"]], given["arguments"])
    except Exception as problem:  # whatever an expression raises
        print(_told(problem), file=sys.stderr)
        sys.exit(1)
    print(urdf)
