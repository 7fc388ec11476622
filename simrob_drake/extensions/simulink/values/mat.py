"""Variables that MATLAB keeps in bytes: `.mat` files, and the workspace in a model file.

A `.mat` file of version 5 is a list of elements: matrices, of which cells and structures hold others, compressed or not
("MAT-File Format", The MathWorks). In a few bytes it can ask for more memory, or for a deeper nesting, than there is:
that is bounded before a library reads it.
"""

import io
import math
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.files import content_of
from simrob_drake.base.messages import message
from simrob_drake.extensions.simulink.values.evaluate import matrix
from simrob_drake.extensions.simulink.values.syntax import NotUnderstood

LARGEST = 200_000_000  # of a file, and of all that is packed in it [bytes]
_DEEPEST = 50  # matrices in cells and structures
_MOST_ELEMENTS = 500_000
_HEADER, _VERSION_5 = 128, (b"IM", b"MI")  # the mark of little-endian files, and of big-endian ones
_INT32, _MATRIX, _COMPRESSED = 5, 14, 15  # types of elements
_SPARSE = 5  # the class of a matrix that does not hold all its entries


class Files(Protocol):
    """The `.m` and `.mat` files that code may name."""

    def script(self, name: str) -> str:
        """Return the text of ``name.m``; empty where there is none."""

    def variables(self, name: str) -> dict[str, Any] | None:
        """Return what is in ``name.mat``; None where there is none."""


class UnboundedMat(Exception):
    """A file that asks for far more than it holds; the text says what."""


class _Scan:
    """One look through one file, to check that it asks for nothing beyond what it holds (raises UnboundedMat)."""

    def __init__(self, file: bytes) -> None:
        mark = file[_HEADER - 2 : _HEADER]
        self._order, self._room, self._elements = (
            "<" if mark == _VERSION_5[0] else ">",
            LARGEST,
            _MOST_ELEMENTS,
        )
        for kind, content in (
            self._elements_of(memoryview(file)[_HEADER:]) if mark in _VERSION_5 else ()
        ):
            packed = (
                self._elements_of(memoryview(self._inflated(content)))
                if kind == _COMPRESSED
                else ()
            )
            for inner, variable in packed or ((kind, content),):
                if inner == _MATRIX:
                    self._check_matrix(variable, 1)

    def _check_matrix(self, data: memoryview, depth: int) -> None:
        if depth > _DEEPEST:
            raise UnboundedMat(
                message(
                    "simulink.mat_too_deep",
                    "it nests cells or structures more than {deepest} deep",
                    deepest=_DEEPEST,
                )
            )
        sparse = False
        for place, (kind, content) in enumerate(self._elements_of(data)):
            if kind == _MATRIX:
                self._check_matrix(content, depth + 1)
            elif place == 0:
                sparse = bool(len(content)) and self._numbers(content[:4])[0] & 0xFF == _SPARSE
            elif place == 1 and kind == _INT32 and not sparse:
                sizes = self._numbers(content)
                if min(sizes, default=0) < 0 or math.prod(sizes) > len(data):
                    raise UnboundedMat(
                        message(
                            "simulink.mat_without_bytes",
                            "it counts {size} entries, and has no bytes for them",
                            size=" x ".join(map(str, sizes)),
                        )
                    )

    def _elements_of(self, data: memoryview) -> Iterator[tuple[int, memoryview]]:
        """Yield type and content of each element; one that is cut off is for the library to tell."""
        start = 0
        while start + 8 <= len(data):
            self._elements -= 1
            if self._elements < 0:
                raise UnboundedMat(
                    message(
                        "simulink.mat_too_large",
                        "it holds more than {most} elements",
                        most=_MOST_ELEMENTS,
                    )
                )
            kind, size = struct.unpack(f"{self._order}II", data[start : start + 8])
            if kind >> 16:  # a small one: its content stands in the second half of its own tag
                yield kind & 0xFFFF, data[start + 4 : start + 4 + (kind >> 16)]
                start += 8
                continue
            yield kind, data[start + 8 : start + 8 + size]
            start += 8 + (size if kind == _COMPRESSED else math.ceil(size / 8) * 8)

    def _numbers(self, content: memoryview) -> tuple[int, ...]:
        return struct.unpack(f"{self._order}{len(content) // 4}i", content[: len(content) // 4 * 4])

    def _inflated(self, content: memoryview) -> bytes:
        inflater = zlib.decompressobj()
        try:
            found = inflater.decompress(content, self._room)
        except zlib.error:  # for the library to tell
            return b""
        self._room -= len(found)
        if self._room <= 0:
            raise UnboundedMat(
                message(
                    "simulink.mat_unpacks",
                    "it unpacks to more than {megabytes} MB",
                    megabytes=LARGEST // 1_000_000,
                )
            )
        return found


def contents_of_mat(file: Path, option: str) -> dict[str, Any]:
    """Return what a file holds by name, as SciPy has it: matrices, records, and objects that it cannot read.

    Raises InvalidParameter: it cannot be read; the message names the option that asked for it.
    """
    try:
        return _contents(content_of(file, LARGEST))
    except NotImplementedError as problem:
        raise InvalidParameter(
            option,
            str(file),
            message("simulink.saved_with_v7", "saved with -v7: version 7.3 is not read"),
        ) from problem
    except Exception as problem:  # readers of damaged files raise whatever they like
        raise InvalidParameter(
            option, str(file), message("simulink.readable", "readable: {problem}", problem=problem)
        ) from problem


def _contents(data: bytes) -> dict[str, Any]:
    from scipy.io import loadmat

    _Scan(data)
    source: Any = io.BytesIO(data)  # which older stubs of scipy do not know of
    content = loadmat(source, squeeze_me=False, struct_as_record=True)
    return {name: value for name, value in content.items() if not name.startswith("__")}


def variables_of_mat(file: Path, option: str = "--variables") -> dict[str, Any]:
    """Return the variables of a file, by name; errors as of :func:`contents_of_mat`."""
    return {
        name: value
        for name, raw in contents_of_mat(file, option).items()
        if (value := _plain(raw)) is not None
    }


_UNNAMED, _NAMED = slice(48, 56), struct.pack("<HHI", 1, 1, ord("w"))
"""Where the name of the only structure stands, which has none, and a name of one letter in its place."""


def stored_workspace(content: bytes) -> dict[str, Any] | None:
    """Return the variables of a workspace that a model file holds: a structure, behind the end of a header alone.

    None where it is not in this form.
    """
    data = bytearray(content)
    data[_UNNAMED] = _NAMED
    try:
        held = _plain(_contents(b" " * 124 + bytes(data[:4]) + bytes(data[8:])).get("w"))
    except Exception:  # as above
        return None
    return (
        {name: value for name, value in held.items() if value is not None}
        if isinstance(held, dict)
        else None
    )


def _plain(raw: Any) -> Any:
    """Return a variable of a .mat file as a matrix, a text, or one or more structures; None for objects."""
    if isinstance(raw, np.ndarray) and raw.dtype.names:
        if "_ObjectMetadata" in raw.dtype.names:
            return None
        several = [
            {name: _plain(one[name]) for name in raw.dtype.names}
            for one in raw.reshape(-1, order="F")
        ]
        return several if len(several) > 1 else several[0] if several else {}
    if isinstance(raw, np.ndarray) and raw.dtype.kind in "US":
        return "".join(str(part) for part in raw.reshape(-1))
    try:
        return matrix(raw)
    except (NotUnderstood, TypeError, ValueError):
        return None
