"""Files of a user's own: kept beside what is taught, and the one among them that is to be opened."""

import re
import zipfile
from collections.abc import Mapping, Sequence
from hashlib import sha256
from io import BytesIO
from pathlib import Path, PurePosixPath

from simrob_drake.errors import InvalidParameter, SimrobError
from simrob_drake.folders import writing
from simrob_drake.importer.options import REPORT_FILE
from simrob_drake.importer.packages import ROBOT_SUFFIXES
from simrob_drake.yaml_files import YAML_SUFFIXES, read_yaml

FOLDER = "own"  # of what is taught, for these files; each set of them has a folder there
MOST = 200_000_000  # bytes of a set of files, unpacked
_LINES = 8  # of what an import did that are told at once
_ORDER = (*YAML_SUFFIXES, *ROBOT_SUFFIXES)  # a station or a program names its robots' files


def keep(files: Mapping[str, bytes], folder: Path) -> Path:
    """Keep files in a folder of what is taught, those of a ZIP archive unpacked; return the one to be opened.

    That is a program or a station, else the robot that lies highest. The same files are kept once. Raises
    InvalidParameter: nothing among them can be opened, an archive is damaged, or all are too large; OutputError: the
    folder cannot be written.
    """
    found = {path: content for name, content in files.items() for path, content in _unpacked(name, content).items()}
    if sum(map(len, found.values())) > MOST:
        raise InvalidParameter("files", "too large", f"at most {MOST / 1e6:g} MB")
    subject = _subject(list(found))
    marks = sha256(b"".join(path.as_posix().encode() + content for path, content in sorted(found.items())))
    home = folder / FOLDER / f"{subject.stem}-{marks.hexdigest()[:8]}"
    if not (home / subject).is_file():
        with writing(home):
            for path in sorted(found, key=lambda path: path == subject):  # which says that all are there
                (home / path).parent.mkdir(parents=True, exist_ok=True)
                (home / path).write_bytes(found[path])
    return home / subject


def _unpacked(name: str, content: bytes) -> dict[Path, bytes]:
    """Return the files of an archive by their paths, or the file itself; no path leads out of its folder."""
    if not name.lower().endswith(".zip"):
        return {_inside(name): content}
    try:
        with zipfile.ZipFile(BytesIO(content)) as archive:
            entries = [entry for entry in archive.infolist() if not entry.is_dir()]
            if sum(entry.file_size for entry in entries) > MOST:
                raise InvalidParameter(name, "too large", f"at most {MOST / 1e6:g} MB unpacked")
            return {_inside(entry.filename): archive.read(entry) for entry in entries}
    except (zipfile.BadZipFile, RuntimeError, NotImplementedError, EOFError) as problem:
        raise InvalidParameter(name, str(problem), "a whole ZIP archive without a password") from problem


def _inside(name: str) -> Path:
    """Return a path below a folder that a name of somewhere else stands for."""
    parts = [part for part in PurePosixPath(name.replace("\\", "/")).parts if part.strip("./ ")]
    return Path(*(re.sub(r'[<>:"|?*\x00-\x1f]', "_", part) for part in parts or ["file"]))


def _subject(paths: Sequence[Path]) -> Path:
    can = [path for path in paths if path.suffix.lower() in _ORDER]
    if not can:
        names = ", ".join(path.name for path in paths[:_LINES]) or "nothing"
        raise InvalidParameter("files", names, f"one that ends in {', '.join(_ORDER)}, or a ZIP archive with one")
    return min(can, key=lambda path: (len(path.parts), _ORDER.index(path.suffix.lower()), path.as_posix()))


def report_of(urdf: Path) -> str:
    """Return what the import that made a robot's file ``urdf`` did, in lines; nothing if it was not imported."""
    try:
        report = read_yaml(urdf.with_name(REPORT_FILE))  # JSON is YAML
    except SimrobError:
        return ""
    entries = [entry for entry in report.get("entries", ()) if entry["kind"] != "read"]
    lines = [": ".join(filter(None, (one["kind"], one["element"], one["text"]))) for one in entries[:_LINES]]
    more = [f"... {len(entries) - _LINES} more in {REPORT_FILE}"] if len(entries) > _LINES else []
    return "\n".join([f"{Path(report['source']).name}: {report['summary']}", *lines, *more])
