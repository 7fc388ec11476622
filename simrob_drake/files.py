"""Read the files that a user names: regular ones, of a size that somebody may have meant, and no others."""

import os
import stat
from pathlib import Path

LARGEST_TEXT = 1_000_000
"""Of files that are written by hand [bytes]: a station's has some thousand."""


class NotRead(OSError):
    """A file that cannot or may not be read; the text says why, and is all that there is to say."""


class TooLarge(NotRead):
    """A file with more bytes than are read."""


def content_of(file: Path | str, largest: int = LARGEST_TEXT) -> bytes:
    """Return the bytes of a file. Devices and pipes, which may have no end, are not waited for.

    Raises:
        NotRead: it is not there, is no regular file, or no file can have its name.
        TooLarge: it has more bytes than ``largest``.
    """
    try:
        with open(file, "rb", opener=_at_once) as opened:
            size = os.fstat(opened.fileno()).st_size
            content = b"" if size > largest else opened.read(largest + 1) or b""  # None where reading would wait
    except NotRead:
        raise
    except OSError as problem:
        raise NotRead(problem.strerror or str(problem)) from problem
    except ValueError as problem:  # of a surrogate, or the character 0
        raise NotRead("no file can have this name") from problem
    if max(len(content), size) > largest:
        raise TooLarge(f"it is larger than {largest / 1e6:g} MB")
    return content


def _at_once(file: str, flags: int) -> int:
    """Open a regular file, and wait for no other."""
    descriptor = os.open(file, flags | os.O_NONBLOCK)
    kind = os.fstat(descriptor).st_mode
    if stat.S_ISREG(kind):
        return descriptor
    os.close(descriptor)
    raise NotRead("it is a folder" if stat.S_ISDIR(kind) else "it is no regular file")


def text_of(file: Path | str, largest: int = LARGEST_TEXT) -> str:
    """Return the text of a file in UTF-8, its lines ended by a line feed each; a byte order mark is left out.

    Raises:
        NotRead: as of :func:`content_of`, and where it is not UTF-8.
    """
    try:
        return content_of(file, largest).decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError as problem:
        raise NotRead(f"it is no text in UTF-8: {problem.reason} in byte {problem.start}") from problem
