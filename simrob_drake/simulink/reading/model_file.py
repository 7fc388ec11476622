"""Read a model file: `.slx`, or `.mdl` as a package of parts or as the old text."""

import re
from pathlib import Path
from xml.etree.ElementTree import Element

from simrob_drake.errors import InvalidModel
from simrob_drake.simulink.reading.elements import SystemReader, TooManyElements, one_line, read_defaults, read_mask
from simrob_drake.simulink.reading.graph import Mask, Model, System
from simrob_drake.simulink.reading.mdl_text import parse_mdl
from simrob_drake.simulink.reading.package import Package
from simrob_drake.simulink.reading.xml_part import Unreadable, parse_part

SUFFIXES = (".slx", ".mdl", ".slxp", ".mdlp")

_DIAGRAM, _MASK, _DEFAULTS = "simulink/blockdiagram.xml", "simulink/modelMask.xml", "simulink/bddefaults.xml"
SCRIPT = "MATLAB code"
"""The parameter of a block that holds the code of a MATLAB Function, which stands in a part of its own."""
_KINDS = ("Model", "Library", "Subsystem")
_STOP_TIME = re.compile(rb'Name="StopTime"[^>]*>([^<]{1,200})<')
_CALLBACK = re.compile(r"(PreLoad|PostLoad|Init|Start)Fcn")


def read_model(path: Path) -> Model:
    """Return the graph of a model file.

    Raises:
        InvalidModel: it is missing, damaged, protected, or holds no block diagram.
    """
    package = Package(path)
    diagram = _of_text(package) if package.text else _element(package, _DIAGRAM)
    top = next((child for child in diagram if child.tag in _KINDS), None)
    inner = None if top is None else top.find("System")
    if top is None or inner is None:
        raise InvalidModel(
            path, _DIAGRAM, "holds no model, library or subsystem; a newer format than this reader knows?"
        )
    written = _element(package, _DEFAULTS) if _DEFAULTS in package.parts else top
    defaults = read_defaults(written.find("BlockParameterDefaults"))
    reader = SystemReader(lambda name: _element(package, f"simulink/systems/{name}.xml"), defaults)
    try:
        system = reader.system(inner)
    except TooManyElements as problem:
        raise InvalidModel(path, "", str(problem)) from problem
    _add_scripts(package, system)
    workspace = top.find("ModelWorkspace")
    texts = {parameter.get("Name", ""): parameter.text or "" for parameter in top.iterfind("P")}
    return Model(
        path=path,
        kind=top.tag,
        system=system,
        mask=_mask(package),
        code=""
        if workspace is None
        else "".join(
            parameter.text or "" for parameter in workspace.iterfind("P") if parameter.get("Name") == "WSMATLABCode"
        ),
        stop_time=_stop_time(package, texts),
        callbacks={name: text for name, text in texts.items() if _CALLBACK.fullmatch(name) and text.strip()},
    )


def _add_scripts(package: Package, system: System) -> None:
    """Give the MATLAB Functions of a model their code, as a parameter."""
    for name in package.parts:
        for chart in _element(package, name).iter("chart") if name.startswith("simulink/stateflow") else ():
            parts = (parameter for parameter in chart.iter("P") if parameter.get("Name") == "script")
            code = next((part.text for part in parts if part.text), "")
            here: System | None = system
            block = None
            for step in (chart.findtext("P[@Name='name']") or "").replace("//", "\0").split("/"):
                called = one_line(step.replace("\0", "/"))
                block = next((one for one in here.blocks.values() if one.name == called), None) if here else None
                here = block.system if block else None
            if block is not None and code:
                block.parameters[SCRIPT] = code


def _stop_time(package: Package, texts: dict[str, str]) -> str:
    """Return when a run of the model ends: it stands in the configuration, or in an old file on top."""
    found = (_STOP_TIME.search(package.parts[name]) for name in sorted(package.parts) if "configSet" in name)
    written = next((match[1].decode("utf-8", "replace") for match in found if match), texts.get("StopTime", ""))
    return written.strip() or "10"


def _element(package: Package, name: str) -> Element:
    if name not in package.parts:
        raise InvalidModel(package.path, name, "is missing; the file is damaged, or no Simulink model")
    try:
        return parse_part(package.parts[name])
    except Unreadable as problem:
        raise InvalidModel(package.path, name, str(problem)) from problem


def _of_text(package: Package) -> Element:
    try:
        return parse_mdl(package.text)
    except Unreadable as problem:
        raise InvalidModel(package.path, "", str(problem)) from problem


def _mask(package: Package) -> Mask | None:
    return read_mask(_element(package, _MASK)) if _MASK in package.parts else None
