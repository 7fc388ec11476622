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

    # Device and inode together identify a file. They change when another file takes its name, as editors do.
    device: int
    inode: int
    changed: int
    """Time of the last change [ns]."""
    size: int
    """Size [bytes]. It shows a change within the resolution of the time."""


FileStates = dict[str, FileState | None]
"""States of files by their absolute paths. None stands for a file that did not exist."""

# The records of all values that are being made. A value may be made while another one is, so there can be several.
_open_records: ContextVar[tuple[FileStates, ...]] = ContextVar("open_records", default=())


def file_state(file: Path | str) -> FileState | None:
    """Read the state of a regular file. Returns None if there is no such file.

    Each cache that is making a value at this time records the state. It makes the value again when the state of the
    file has become another one.

    Args:
        file: path of the file.
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
            size: largest count of values that are kept. If there are more, the value that was made the longest time
                ago is dropped.
        """
        self._size = size
        self._entries: OrderedDict[Hashable, tuple[Value, FileStates]] = OrderedDict()
        self._lock = Lock()

    def value(self, key: Hashable, make: Callable[[], Value]) -> Value:
        """Return the value of a key. It is made if there is none yet, or if one of its files has changed.

        Two threads that ask for the same key at the same time may both make the value: the later one is kept.

        Args:
            key: identifies the value.
            make: function that makes the value. If it raises an error, the error is passed on, and nothing is kept.
        """
        with self._lock:
            entry = self._entries.get(key)
        if entry is not None:
            value, states = entry
            if _are_current(states):
                return value

        # The lock is not held meanwhile: `make` may take long, and may ask this cache for other values.
        states = {}
        token = _open_records.set((*_open_records.get(), states))
        try:
            value = make()
        finally:
            _open_records.reset(token)

        with self._lock:
            self._entries[key] = (value, states)
            # A value that is made again would keep its former place in the order, and be dropped too early.
            self._entries.move_to_end(key)
            while len(self._entries) > self._size:
                self._entries.popitem(last=False)
        return value


def _are_current(states: FileStates) -> bool:
    """Whether all files still have these states."""
    # `file_state` is called for every file, even after one that differs: if another cache is making a value that
    # depends on this one, it must record all of these files, too.
    current = [file_state(path) == state for path, state in states.items()]
    return all(current)
