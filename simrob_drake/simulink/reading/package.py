"""The parts of a model file: `.slx`, a zip of XML, or the text package that newer `.mdl` files are.

Parts are read into memory within limits, by name; nothing is unpacked to disk, so no name can lead outside.
"""

import io
import re
import zipfile
import zlib
from pathlib import Path

from simrob_drake.errors import InvalidModel
from simrob_drake.files import NotRead, content_of

MOST_PARTS = 20_000
LARGEST_PART = 64 * 2**20  # bytes
LARGEST_MODEL = 256 * 2**20  # bytes of all parts that are read

_TEXT_PACKAGE = b"__MWOPC_PACKAGE_BEGIN__"
_TEXT_PART = re.compile(rb"^__MWOPC_PART_BEGIN__ (\S.*?)\s*$\n", re.MULTILINE)
_DAMAGE = (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, OSError, ValueError)


class Package:
    """The parts of a model file by name, such as ``simulink/blockdiagram.xml``.

    Attributes:
        path: the file.
        parts: the XML parts; empty for the old `.mdl` text without parts, which ``text`` then holds.
        text: the whole of an old `.mdl` file.
    """

    def __init__(self, path: Path) -> None:
        """Read a file.

        Raises:
            InvalidModel: it is missing, protected, damaged or too large.
        """
        self.path = path
        self.parts: dict[str, bytes] = {}
        self.text = b""
        if path.suffix.lower() in (".slxp", ".mdlp"):
            raise InvalidModel(path, "", "is a protected model, which only MATLAB opens; ask its author for the .slx")
        try:
            content = content_of(path, LARGEST_MODEL)
        except NotRead as problem:
            raise InvalidModel(path, "", f"cannot be read: {problem}") from problem
        if zipfile.is_zipfile(io.BytesIO(content)):
            self._read_zip(content)
        elif path.suffix.lower() == ".mdl":
            self._read_text(content)
        else:
            raise InvalidModel(self.path, "", "is no .slx file: not a zip, or one that was cut off")

    def _read_zip(self, content: bytes) -> None:
        try:
            with zipfile.ZipFile(io.BytesIO(content)) as archive:
                entries = archive.infolist()
                if len(entries) > MOST_PARTS:
                    raise InvalidModel(self.path, "", f"has {len(entries)} parts; at most {MOST_PARTS} are read")
                for entry in entries:
                    name = entry.filename.lstrip("/")
                    if name.startswith("simulink/") and name.endswith(".xml"):
                        with archive.open(entry) as part:
                            self._keep(name, part.read(LARGEST_PART + 1))
        except _DAMAGE as problem:
            if isinstance(problem, InvalidModel):
                raise
            raise InvalidModel(self.path, "", f"is a damaged zip: {problem}") from problem

    def _read_text(self, content: bytes) -> None:
        if _TEXT_PACKAGE not in content[:4096]:
            self.text = content
            return
        content = content.replace(b"\r\n", b"\n")
        pieces = _TEXT_PART.split(content)
        for name, part in zip(pieces[1::2], pieces[2::2], strict=True):
            clean = name.split()[0].decode("ascii", "replace").lstrip("/")
            if clean.startswith("simulink/") and clean.endswith(".xml"):
                self._keep(clean, part.partition(b"__MWOPC_PACKAGE_END__")[0].strip())

    def _keep(self, name: str, content: bytes) -> None:
        if len(content) > LARGEST_PART:
            raise InvalidModel(self.path, name, f"is larger than {LARGEST_PART // 2**20} MB")
        self.parts[name] = content
        if sum(map(len, self.parts.values())) > LARGEST_MODEL:
            raise InvalidModel(self.path, "", f"unpacks to more than {LARGEST_MODEL // 2**20} MB")
