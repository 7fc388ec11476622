"""Cache of values that are made from files: a value is used again as long as these files are unchanged.

While a cache makes a value, it records the state of each file that is read or looked for. `file_state` reports a file
to the caches; `simrob_drake.base.files` calls it for every file that it opens.
"""

import os
import stat
from collections import OrderedDict
from collections.abc import Callable, Hashable
from contextvars import ContextVar
from pathlib import Path
from threading import Lock
from typing import Generic, NamedTuple, TypeVar

Value = TypeVar("Value")


class FileState(NamedTuple):
    """Identity, time of the last change and size of a file. Equal states mean that the content is the same."""

    device: int
    inode: int
    changed: int  # time of the last change [ns]
    size: int  # [bytes]


FileStates = dict[str, FileState | None]
"""States of files by their absolute paths. None stands for a file that did not exist."""

# The records of all values that are being made. A value may be made while another one is, so there can be several.
_open_records: ContextVar[tuple[FileStates, ...]] = ContextVar("open_records", default=())


def file_state(file: Path | str) -> FileState | None:
    """Return the state of a regular file, or None if there is no such file.

    The caches that are making a value record the state: they make the value again once the state is another one.
    """
    state = _state_on_disk(file)
    records = _open_records.get()
    if records:
        path = os.path.abspath(file)
        for record in records:
            record[path] = state
    return state


def _state_on_disk(file: Path | str) -> FileState | None:
    """Read the state of a regular file from the file system. Returns None if there is no such file."""
    try:
        status = os.stat(file)
    except (OSError, ValueError):  # ValueError: a name that no file can have
        return None
    if not stat.S_ISREG(status.st_mode):
        return None
    return FileState(status.st_dev, status.st_ino, status.st_mtime_ns, status.st_size)


class FileCache(Generic[Value]):
    """Values by key, each with the states of the files that it was made from."""

    def __init__(self, size: int) -> None:
        """Make an empty cache.

        Args:
            size: count of values that are kept. If there are more, the one that was made first is dropped.
        """
        self._size = size
        self._entries: OrderedDict[Hashable, tuple[Value, FileStates]] = OrderedDict()
        self._lock = Lock()

    def value(self, key: Hashable, make: Callable[[], Value]) -> Value:
        """Return the value of a key. It is made if there is none yet, or if one of its files has changed.

        Args:
            key: identifies the value.
            make: makes the value. If it raises an error, nothing is kept.
        """
        with self._lock:
            entry = self._entries.get(key)
        if entry is not None and _are_current(entry[1]):
            return entry[0]

        states: FileStates = {}
        token = _open_records.set((*_open_records.get(), states))
        try:
            value = make()
        finally:
            _open_records.reset(token)

        with self._lock:
            self._entries[key] = (value, states)
            while len(self._entries) > self._size:
                self._entries.popitem(last=False)
        return value


def _are_current(states: FileStates) -> bool:
    """Whether all files still have these states.

    Every file is looked at through `file_state`, so that the caches around this one record the files, too.
    """
    current = [file_state(path) == state for path, state in states.items()]
    return all(current)
