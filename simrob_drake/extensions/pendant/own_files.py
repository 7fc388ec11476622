"""Files of a user's own: kept beside what is taught, and the one among them that is to be opened."""

import lzma
import re
import struct
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from hashlib import sha256
from io import BytesIO
from pathlib import Path, PurePosixPath

from simrob_drake.base.errors import InvalidParameter, SimrobError, format_value
from simrob_drake.base.folders import writing
from simrob_drake.base.messages import Message, compound, join_texts, message
from simrob_drake.base.remarks import Remark, Severity
from simrob_drake.base.yaml_files import YAML_SUFFIXES
from simrob_drake.extensions.pendant.pages.words import Notice
from simrob_drake.importer.robot_files import robot_suffixes
from simrob_drake.robots.imports import CHANGE, REPORT_FILE, Entry, read_report

FOLDER = "own"  # of what is taught, for these files; each set of them has a folder there
MOST = 200_000_000  # bytes of a set of files, unpacked
_MOST_FILES = 10_000
"""Largest count of files in an archive. A robot's package has some hundreds; this many are unpacked in about 2 s."""
_MOST_FOLDERS = 50
"""Largest count of folders, one within the other, in which a file may be."""
_LONGEST_NAME = 200
"""Longest name of a file or folder [bytes]. File systems allow 255, of which an import needs some."""
_LONGEST_PATH = 1000
"""Longest path of a file in an archive [bytes]. Linux allows 4096, with the folder in which the archive is unpacked."""
_ENTRY_MARK = b"PK\x01\x02"
"""Bytes with which each entry in a ZIP archive's table of contents begins."""
_ZIP_ERRORS = (
    *(zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error),
    *(RuntimeError, NotImplementedError, EOFError, OSError, ValueError),
)
"""Errors that Python's zipfile raises for damaged archives, and for archives with a password."""
_LINES = 8  # of what an import did that are told at once


def keep(files: Mapping[str, bytes], folder: Path) -> Path:
    """Write a user's files into a folder, those of a ZIP archive unpacked, and find the one to be opened.

    That is a program or a station, or else a robot; of several, the one in the fewest folders. Equal files are written
    only once: the name of their folder contains a hash of their content.

    Args:
        files: contents of the files, by name.
        folder: the folder with all that a user teaches; the files get a folder within it.

    Returns:
        path of the file to be opened.

    Raises:
        InvalidParameter: no file can be opened, an archive is damaged or has too many files, a name is too long, or all
            files together are too large.
        OutputError: the folder cannot be written.
    """
    contents = dict[Path, bytes]()
    for name, content in files.items():
        contents.update(_unpack(name, content))
    total_size = sum(len(content) for content in contents.values())
    if total_size > MOST:
        raise InvalidParameter(
            "files",
            message("pendant.too_large", "too large"),
            message("pendant.at_most_megabytes", "at most {most:g} MB", most=MOST / 1e6),
        )
    subject = _subject(list(contents))
    content_hash = sha256(
        b"".join(path.as_posix().encode() + content for path, content in sorted(contents.items()))
    )
    home = folder / FOLDER / f"{subject.stem}-{content_hash.hexdigest()[:8]}"
    if not (home / subject).is_file():
        others = [path for path in contents if path != subject]
        with writing(home):
            # The file to be opened is written last: if it exists, all the others do.
            for path in (*others, subject):
                (home / path).parent.mkdir(parents=True, exist_ok=True)
                (home / path).write_bytes(contents[path])
    return home / subject


def _unpack(name: str, content: bytes) -> dict[Path, bytes]:
    """Read the files of a ZIP archive, or another file as it is.

    Args:
        name: name of the file; a ZIP archive has the suffix ``.zip``.
        content: content of the file.

    Returns:
        contents by paths, none of which leads out of the folder that the paths begin at.

    Raises:
        InvalidParameter: the archive is damaged, has a password, or too many or too large files; a name is too long.
    """
    if not name.lower().endswith(".zip"):
        return {_safe_path(name): content}
    # Python reads the whole table of contents at once, so its entries are counted before.
    if content.count(_ENTRY_MARK) > _MOST_FILES:
        raise InvalidParameter(
            name,
            message("pendant.too_many_files", "too many files"),
            message(
                "pendant.archive_of_at_most", "an archive of at most {most} files", most=_MOST_FILES
            ),
        )
    try:
        with zipfile.ZipFile(BytesIO(content)) as archive:
            entries = {
                _safe_path(entry.filename): entry
                for entry in archive.infolist()
                if not entry.is_dir()
            }
            total_size = sum(entry.file_size for entry in entries.values())
            if total_size > MOST:
                raise InvalidParameter(
                    name,
                    message("pendant.too_large", "too large"),
                    message(
                        "pendant.megabytes_unpacked",
                        "at most {most:g} MB unpacked",
                        most=MOST / 1e6,
                    ),
                )
            return {path: archive.read(entry) for path, entry in entries.items()}
    except SimrobError:  # a ValueError, as some errors of zipfile are
        raise
    except _ZIP_ERRORS as problem:
        detail = format_value(str(problem)) or type(problem).__name__
        raise InvalidParameter(
            name, detail, message("pendant.whole_archive", "a whole ZIP archive without a password")
        ) from problem


def _safe_path(name: str) -> Path:
    """Make a relative path that stays within its folder from a name in an archive, which may lead anywhere.

    Raises:
        InvalidParameter: no file can have the name: it is too long, in too many folders, or no Unicode text.
    """
    # Parts such as "..", and the "/" of an absolute path, are left out. If nothing is left, the file is called "file".
    parts = [
        part for part in PurePosixPath(name.replace("\\", "/")).parts if part.strip("./ ")
    ] or ["file"]
    try:
        lengths = [len(part.encode()) for part in parts]
    except UnicodeEncodeError as problem:
        raise InvalidParameter(
            message("pendant.name_of_file", "the name of a file"),
            repr(format_value(name)),
            message("pendant.whole_characters", "a text of whole characters"),
        ) from problem
    if len(parts) > _MOST_FOLDERS + 1:
        expected = message(
            "pendant.folders_at_most", "in at most {most} folders", most=_MOST_FOLDERS
        )
        raise InvalidParameter(
            message("pendant.the_file", "the file '{name}'", name=format_value(name)),
            message("pendant.in_folders", "in {count} folders", count=len(parts) - 1),
            expected,
        )
    if max(lengths) > _LONGEST_NAME or sum(lengths) > _LONGEST_PATH:
        expected = message(
            "pendant.bytes_of_names",
            "at most {longest_name} bytes each, {longest_path} together",
            longest_name=_LONGEST_NAME,
            longest_path=_LONGEST_PATH,
        )
        raise InvalidParameter(
            message("pendant.names_of_file", "names of a file and its folders"),
            compound("'{name}'", name=format_value(name)),
            expected,
        )
    # Characters that Windows does not allow in names.
    return Path(*(re.sub(r'[<>:"|?*\x00-\x1f]', "_", part) for part in parts))


def _subject(paths: Sequence[Path]) -> Path:
    order = [*YAML_SUFFIXES, *robot_suffixes()]  # a station or a program names its robots' files
    can = [path for path in paths if path.suffix.lower() in order]
    if not can:
        names = ", ".join(path.name for path in paths[:_LINES]) or "nothing"
        raise InvalidParameter(
            "files",
            names,
            message(
                "pendant.file_ending_in",
                "one that ends in {endings}, or a ZIP archive with one",
                endings=", ".join(order),
            ),
        )
    return min(
        can, key=lambda path: (len(path.parts), order.index(path.suffix.lower()), path.as_posix())
    )


def report_of(urdf: Path) -> Notice | None:
    """Make the notice that lists the changes of an import: each default, repair and loss.

    Args:
        urdf: the robot's file, which the import has made.

    Returns:
        the notice; None if the robot was not imported.
    """
    report = read_report(urdf.parent)
    if report is None:
        return None
    changes = [entry for entry in report.entries if entry.kind != "read"]
    remarks = [Remark(_severity_of(entry), _text_of(entry)) for entry in changes[:_LINES]]
    if len(changes) > _LINES:
        hidden = len(changes) - _LINES
        further = message(
            "pendant.more_entries", "... {count} more in {file}", count=hidden, file=REPORT_FILE
        )
        remarks.append(Remark("note", further))
    file = {"file": report.source.name}
    return (
        Notice("imported_with_changes", file, remarks=tuple(remarks))
        if changes
        else Notice("imported", file)
    )


def _severity_of(entry: Entry) -> Severity:
    """Severity of what an import did: a warning if the robot lacks something then."""
    return "warning" if entry.kind in ("dropped", "open", "lost", "refused") else "note"


def _text_of(entry: Entry) -> Message:
    """Text of an entry of a report: the change, the element that is changed, and the details."""
    return join_texts(
        [text for text in (CHANGE[entry.kind], entry.element, entry.text) if text], ": "
    )
