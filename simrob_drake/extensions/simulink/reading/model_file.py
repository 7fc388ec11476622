"""Model files, and the libraries that they take blocks from: a zip of XML, or a text.

Parts are read into memory within limits, by name; nothing is unpacked to disk, so no name can lead outside.
"""

import io
import re
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import cached_property, partial
from pathlib import Path
from typing import IO, Any
from xml.etree.ElementTree import Element

import numpy as np

from simrob_drake.base.errors import InvalidModel, InvalidParameter
from simrob_drake.base.files import NotRead, content_of
from simrob_drake.base.messages import message
from simrob_drake.extensions.simulink.reading.graph import (
    Model,
    SimulinkBlock,
    System,
    SystemReader,
    Unreadable,
    parse_mdl,
    parse_part,
    read_defaults,
    read_mask,
)
from simrob_drake.extensions.simulink.values.code import CodeRun
from simrob_drake.extensions.simulink.values.mat import variables_of_mat
from simrob_drake.extensions.simulink.values.syntax import NotUnderstood

MOST_PARTS = 20_000
LARGEST_PART = 64 * 2**20  # bytes
LARGEST_MODEL = 256 * 2**20  # bytes of all parts that are read

_ASSIGNED = re.compile(r"^[ \t]*(\w+)[\w.()]*[ \t]*=(?!=)", re.MULTILINE)
_NAME = re.compile(r"(?<![\w.])[A-Za-z]\w*")
_GLOBAL = re.compile(r"^[ \t]*global[ \t]+([\w \t]+)", re.MULTILINE)
_REFERENCE = re.compile(r"\b([A-Za-z]\w*)\.(\w+)\((\d{1,6})\)")
_STORED = "simulink/modelWorkspace.mxarray"
_TEXT_PACKAGE = b"__MWOPC_PACKAGE_BEGIN__"
_TEXT_PART = re.compile(rb"^__MWOPC_PART_BEGIN__ (\S.*?)\s*$\n", re.MULTILINE)
_DAMAGE = (
    zipfile.BadZipFile,
    zlib.error,
    EOFError,
    NotImplementedError,
    RuntimeError,
    OSError,
    ValueError,
)


class _Parts(dict[str, bytes]):
    """The XML parts of a model file by name, such as ``simulink/blockdiagram.xml``, and its workspace.

    Attributes:
        path: the file.
        text: the whole of an old `.mdl` file, which has no parts; else empty.
    """

    def __init__(self, path: Path) -> None:
        """Read a file (raises InvalidModel: it is missing, protected, damaged or too large)."""
        super().__init__()
        self.path, self.text = path, b""
        if path.suffix.lower() in (".slxp", ".mdlp"):
            raise InvalidModel(
                path,
                "",
                message(
                    "simulink.protected_model",
                    "is a protected model, which only MATLAB opens; ask its author for the .slx",
                ),
            )
        try:
            content = content_of(path, LARGEST_MODEL)
        except NotRead as problem:
            raise InvalidModel(
                path,
                "",
                message("simulink.cannot_be_read", "cannot be read: {problem}", problem=problem),
            ) from problem
        if zipfile.is_zipfile(io.BytesIO(content)):
            self._read_zip(content)
        elif path.suffix.lower() != ".mdl":
            raise InvalidModel(
                path,
                "",
                message("simulink.no_slx", "is no .slx file: not a zip, or one that was cut off"),
            )
        elif _TEXT_PACKAGE not in content[:4096]:
            self.text = content
        else:
            pieces = _TEXT_PART.split(content.replace(b"\r\n", b"\n"))
            for name, part in zip(pieces[1::2], pieces[2::2], strict=True):
                whole = part.partition(b"__MWOPC_PACKAGE_END__")[0].strip()
                self._keep(name.split()[0].decode("ascii", "replace"), partial(io.BytesIO, whole))

    def _read_zip(self, content: bytes) -> None:
        try:
            with zipfile.ZipFile(io.BytesIO(content)) as archive:
                entries = archive.infolist()
                if len(entries) > MOST_PARTS:
                    raise InvalidModel(
                        self.path,
                        "",
                        message(
                            "simulink.too_many_parts",
                            "has {count} parts; at most {most} are read",
                            count=len(entries),
                            most=MOST_PARTS,
                        ),
                    )
                for entry in entries:
                    self._keep(entry.filename, partial(archive.open, entry))
        except InvalidModel:
            raise
        except _DAMAGE as problem:
            raise InvalidModel(
                self.path,
                "",
                message("simulink.damaged_zip", "is a damaged zip: {problem}", problem=problem),
            ) from problem

    def _keep(self, written: str, opened: Callable[[], IO[bytes]]) -> None:
        name = written.lstrip("/")
        if not (name.startswith("simulink/") and name.endswith(".xml")) and name != _STORED:
            return
        with opened() as part:
            self[name] = part.read(LARGEST_PART + 1)
        if len(self[name]) > LARGEST_PART:
            raise InvalidModel(
                self.path,
                name,
                message(
                    "simulink.larger_than",
                    "is larger than {megabytes} MB",
                    megabytes=LARGEST_PART // 2**20,
                ),
            )
        if sum(map(len, self.values())) > LARGEST_MODEL:
            raise InvalidModel(
                self.path,
                "",
                message(
                    "simulink.unpacks_to_more",
                    "unpacks to more than {megabytes} MB",
                    megabytes=LARGEST_MODEL // 2**20,
                ),
            )

    def element(self, name: str) -> Element:
        """Return the outermost element of a part (raises InvalidModel: it is missing, or no XML)."""
        if name not in self:
            raise InvalidModel(
                self.path,
                name,
                message(
                    "simulink.part_missing", "is missing; the file is damaged, or no Simulink model"
                ),
            )
        with _readable(self.path, name):
            return parse_part(self[name])


SUFFIXES = (".slx", ".mdl", ".slxp", ".mdlp")

_DIAGRAM, _MASK, _DEFAULTS = (
    "simulink/blockdiagram.xml",
    "simulink/modelMask.xml",
    "simulink/bddefaults.xml",
)
SCRIPT = "MATLAB code"
"""The parameter of a block that holds the code of a MATLAB Function, which stands in a part of its own."""
_KINDS = ("Model", "Library", "Subsystem")
_STOP_TIME = re.compile(rb'Name="StopTime"[^>]*>([^<]{1,200})<')
_CALLBACK = re.compile(r"(PreLoad|PostLoad|Init|Start)Fcn")


def read_model(path: Path) -> Model:
    """Return the graph of a model file.

    Raises InvalidModel: it is missing, damaged, protected, or holds no block diagram.
    """
    parts = _Parts(path)
    with _readable(path):
        diagram = parse_mdl(parts.text) if parts.text else parts.element(_DIAGRAM)
    top = next((child for child in diagram if child.tag in _KINDS), None)
    inner = None if top is None else top.find("System")
    if top is None or inner is None:
        sentence = message(
            "simulink.unknown_format",
            "holds no model, library or subsystem; a newer format than this reader knows?",
        )
        raise InvalidModel(path, _DIAGRAM, sentence)
    written = parts.element(_DEFAULTS) if _DEFAULTS in parts else top
    defaults = read_defaults(written.find("BlockParameterDefaults"))
    reader = SystemReader(lambda name: parts.element(f"simulink/systems/{name}.xml"), defaults)
    with _readable(path):
        system = reader.system(inner)
    _add_scripts(parts, system)
    texts = {parameter.get("Name", ""): parameter.text or "" for parameter in top.iterfind("P")}
    callbacks = {
        name: text for name, text in texts.items() if _CALLBACK.fullmatch(name) and text.strip()
    }
    mask = read_mask(parts.element(_MASK)) if _MASK in parts else None
    stored, code = parts.get(_STORED, b""), _workspace_code(top)
    return Model(path, top.tag, system, mask, code, stored, callbacks, _stop_time(parts, texts))


def _workspace_code(top: Element) -> str:
    """Return the code of a model's workspace, or what takes its variables from the file in which they are."""
    texts = {
        parameter.get("Name", ""): parameter.text or ""
        for parameter in top.iterfind("ModelWorkspace/P")
    }
    command = {"MATLAB File": "run", "MAT-File": "load"}.get(texts.get("WSDataSource", ""))
    return (
        f"{command}('{texts.get('WSSourceFileName', '')}')"
        if command
        else texts.get("WSMATLABCode", "")
    )


def _add_scripts(parts: _Parts, system: System) -> None:
    for name in parts:
        for chart in (
            parts.element(name).iter("chart") if name.startswith("simulink/stateflow") else ()
        ):
            scripts = (one.text for one in chart.iter("P") if one.get("Name") == "script")
            code = next(filter(None, scripts), "")
            if code and (block := system.find(chart.findtext("P[@Name='name']") or "")) is not None:
                block.parameters[SCRIPT] = code


def _stop_time(parts: _Parts, texts: dict[str, str]) -> str:
    """Return when a run of the model ends: it stands in the configuration, or in an old file on top."""
    found = (_STOP_TIME.search(parts[name]) for name in sorted(parts) if "configSet" in name)
    written = next(
        (match[1].decode("utf-8", "replace") for match in found if match), texts.get("StopTime", "")
    )
    return written.strip() or "10"


@contextmanager
def _readable(path: Path, name: str = "") -> Iterator[None]:
    try:
        yield
    except Unreadable as problem:
        raise InvalidModel(path, name, str(problem)) from problem


BUILT_IN = {
    "sm_lib", "nesl_utility", "simulink", "slpidlib", "fl_lib", "fl_ps_legacy_lib", "simulink_extras", "robotcorelib",
    "robotmaniplib", "robotalgslib", "ee_lib", "sdl_lib", "batteryecm_lib", "SignalEditorBlockLib", "eml_lib", "sflib",
    "dspsrcs4", "dspsigops", "simscape", "sl3dlib", "sim3dlib", "uavlib", "autolibshared", "aerolibsixdof", "cstblocks",
    "sharedtransform", "rllib", "mpclib", "vrlib",
}  # fmt: skip
"""Libraries of MATLAB: their blocks are known by name, or not at all."""

_SUFFIXES = ".slx", ".mdl"
_MOST_FOLDERS = 500


def referenced_by(block: SimulinkBlock) -> str:
    """Return the name of the file that a block stands for as a whole; empty of others."""
    names = ("ModelFile", "ModelNameDialog", "ModelName") if block.kind == "ModelReference" else ()
    named = (block.parameters.get(name, "") for name in ("ReferencedSubsystem", *names))
    return next(filter(None, named), "").removesuffix(".slx").removesuffix(".mdl")


def _filled(known: Any, other: Any) -> Any:
    """Return a structure with the fields that it lacks, and another one has, at any depth; other values as they are."""
    if not (isinstance(known, dict) and isinstance(other, dict)):
        return known
    return {**other, **{name: _filled(value, other.get(name)) for name, value in known.items()}}


def _same(one: Any, other: Any) -> bool:
    """Tell whether two values are the same, matrices in structures and lists included."""
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(
            _same(value, other[name]) for name, value in one.items()
        )
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(_same, one, other))
    return type(one) is type(other) and np.array_equal(one, other)


class Libraries:
    """Model files, `.m` and `.mat` files by name, each read once, from the folders that the user names."""

    def __init__(self, folders: Iterable[Path]) -> None:
        self.folders: list[Path] = []
        for folder in folders:
            if folder.is_dir():
                self.folders += [
                    folder,
                    *sorted(child for child in folder.iterdir() if child.is_dir())[:_MOST_FOLDERS],
                ]
        self._models: dict[str, Model | None] = {}

    def model(self, name: str) -> Model | None:
        """Return a file's model, or None where it lies in no folder (raises InvalidModel: the file cannot be read)."""
        if name not in self._models:
            file = self._find(name)
            self._models[name] = None if file is None else read_model(file)
        return self._models[name]

    def block(self, place: str) -> SimulinkBlock | None:
        """Return the block of a library at ``file/system/block``, or None where there is none.

        Raises InvalidModel: the library cannot be read.
        """
        name, slash, way = place.partition("/")
        model = self.model(name)
        return model.system.find(way) if model and slash else None

    def script(self, name: str, suffix: str = ".m") -> str:
        """Return the text of a function's, script's or component's own file; empty where it lies in no folder."""
        file = self._find(name, (suffix,))
        try:
            return "" if file is None else content_of(file, LARGEST_PART).decode("utf-8", "replace")
        except NotRead:
            return ""

    def variables(self, name: str) -> dict[str, Any] | None:
        """Return the variables of ``name.mat``; None where it lies in no folder, or cannot be read."""
        file = self._find(name, (".mat",))
        try:
            return None if file is None else variables_of_mat(file)
        except InvalidParameter:
            return None

    def offered(self, model: Model) -> dict[str, tuple[str, Any, list[str]]]:
        """Return what files set of the variables that a model names: file, value, and files that set it otherwise.

        The likeliest file counts: that called after the model, before which none else counts, or as one that the model
        names and that is not there; then that whose structures are as long as the model asks for; then that in the
        model's folder, then that which sets more of them.
        """
        texts, named = (
            set(self._texts(model.system, {""})),
            " ".join([model.code, *model.callbacks.values()]),
        )
        # of functions that blocks call
        codes = [self.script(text) for text in texts if text.isidentifier()]
        names = {
            name
            for text in (*texts, *map(" ".join, map(_GLOBAL.findall, codes)))
            for name in _NAME.findall(text)
        }
        asked = {reference for text in texts for reference in _REFERENCE.findall(text)}
        found = {
            file: self._set_by(file, names)
            for file in self._files.values()
            if file.suffix in (".m", ".mat")
        }

        def rank(file: Path) -> tuple[bool, int, bool, int]:
            return (
                file.stem.startswith(model.name) or file.stem in named,
                -sum(
                    _is_short(found[file].get(name), part, int(place))
                    for name, part, place in asked
                ),
                file.parent == model.path.parent,
                len(found[file]),
            )

        offered: dict[str, tuple[str, Any, list[str]]] = {}
        for file in sorted(found, key=rank, reverse=True):
            for name, value in found[file].items():
                first, known, others = offered.setdefault(name, (file.name, value, []))
                if not _same(value, known) and not first.startswith(model.name):
                    others.append(file.name)
                    offered[name] = first, _filled(known, value), others
        return offered

    def _texts(self, system: System, seen: set[str]) -> Iterator[str]:
        """Yield all parameters of blocks and masks of a system, and of the files that these refer to, as written."""
        for block in system.blocks.values():
            yield from block.parameters.values()
            yield from (
                (parameter.value for parameter in block.mask.parameters) if block.mask else ()
            )
            other = referenced_by(block) or (block.kind.partition("/")[0] if block.linked else "")
            systems = [block.system]
            if other not in {*seen, *BUILT_IN}:
                seen.add(other)
                with suppress(InvalidModel):  # one that is damaged is told where it is used
                    model = self.model(other)
                    systems += [model.system] if model else []
            for one in systems:
                yield from self._texts(one, seen) if one is not None else ()

    def _set_by(self, file: Path, names: set[str]) -> dict[str, Any]:
        run = CodeRun({}, files=self)
        if file.suffix == ".mat":
            run.variables.update(self.variables(file.stem) or {})
        elif names.intersection(_ASSIGNED.findall(code := self.script(file.stem))):
            with suppress(NotUnderstood):
                run.run(code)
        return {name: run.variables[name] for name in names & run.variables.keys() - run.unknown}

    def _find(self, name: str, suffixes: tuple[str, ...] = _SUFFIXES) -> Path | None:
        return self._files.get(
            next((name + suffix for suffix in suffixes if name + suffix in self._files), "")
        )

    @cached_property
    def _files(self) -> dict[str, Path]:
        """The files by name; of one name, that of the first folder."""
        suffixes = (*_SUFFIXES, ".m", ".mat", ".ssc")
        files = [
            file for folder in self.folders for file in folder.iterdir() if file.suffix in suffixes
        ]
        return {file.name: file for file in reversed(files) if file.is_file()}


def _is_short(structure: Any, part: str, place: int) -> bool:
    """Tell whether a structure has an array of structures that is too short for an index."""
    array = structure.get(part) if isinstance(structure, dict) else None
    return array is not None and (len(array) if isinstance(array, list) else 1) < place
