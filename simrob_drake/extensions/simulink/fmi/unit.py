"""A station as a file that Simulink, OpenModelica, FMPy and others load: a unit of FMI 2.0 or 3.0 for co-simulation."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import distribution
from pathlib import Path
from tempfile import TemporaryDirectory
from uuid import NAMESPACE_OID, uuid5
from xml.etree.ElementTree import Element, SubElement, indent, tostring
from zipfile import ZIP_DEFLATED, ZipFile

from simrob_drake.base.arguments import as_path
from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.extras import importing_extra
from simrob_drake.base.folders import check_ending, check_new_file, replaced_at_once, writing
from simrob_drake.base.messages import message
from simrob_drake.extensions.simulink.stepping.station import SteppedStation
from simrob_drake.extensions.simulink.values.units import UnknownUnit, parse_unit, plain_unit
from simrob_drake.extensions.simulink.writing.urdf import plain
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.file_paths import with_copied_files
from simrob_drake.stations.load import station_yaml

STOPPED, MESSAGE, TIME = "stopped", "message", "time"
"""Variables beside those of the station: whether and why it was ended, and where it is."""
_TYPES = {"real": ("Real", "Float64"), "flag": ("Boolean", "Boolean"), "text": ("String", "String")}
"""In FMI 2.0 and 3.0."""
_STATES = {
    2: ("canGetAndSetFMUstate", "canSerializeFMUstate"),
    3: ("canGetAndSetFMUState", "canSerializeFMUState"),
}
_CATEGORIES = ("logStatusWarning", "logStatusError")


@dataclass(frozen=True)
class Variable:
    """A variable of a unit; its reference is its place in the list of all."""

    name: str
    causality: str  # as FMI has it
    variability: str = "continuous"  # as FMI has it
    kind: str = "real"  # ``real``, ``flag`` or ``text``
    unit: str = ""  # empty unless it is a real number
    start: float | None = None  # of inputs and parameters


def variables_of(station: SteppedStation) -> list[Variable]:
    """Return the variables of a unit, in the order of their references."""
    return [
        *(
            Variable(e.name, "input", unit=e.unit, start=station.get(e.name))
            for e in station.inputs.values()
        ),
        *(Variable(e.name, "output", unit=e.unit) for e in station.outputs.values()),
        *(
            Variable(p.name, "parameter", "fixed", unit=p.unit, start=p.start)
            for p in station.parameters.values()
        ),
        Variable(STOPPED, "output", "discrete", "flag"),
        Variable(MESSAGE, "output", "discrete", "text"),
        Variable(TIME, "independent", unit="s"),
    ]


def description(station: SteppedStation, name: str, version: int) -> bytes:
    """Return the XML of a unit that is called ``name``."""
    variables = variables_of(station)
    said = {
        "fmiVersion": f"{version}.0",
        "modelName": name,
        "description": station.config.description,
    }
    said |= {"generationTool": "simrob_drake", "variableNamingConvention": "structured"}
    said["guid" if version == 2 else "instantiationToken"] = str(
        uuid5(NAMESPACE_OID, f"{name}{variables}")
    )
    root = Element("fmiModelDescription", said)
    abilities = {"canHandleVariableCommunicationStepSize": "true", "needsExecutionTool": "true"}
    abilities |= dict.fromkeys(_STATES[version], "true")
    SubElement(root, "CoSimulation", {"modelIdentifier": name, **abilities})
    _add_units(
        SubElement(root, "UnitDefinitions"),
        {variable.unit for variable in variables if variable.unit},
    )
    categories = SubElement(root, "LogCategories")
    for category in _CATEGORIES:
        SubElement(categories, "Category", name=category)
    SubElement(
        root,
        "DefaultExperiment",
        startTime="0",
        stopTime=repr(station.config.duration),
        stepSize="0.001",
    )
    listed = SubElement(root, "ModelVariables")
    for reference, variable in enumerate(variables):
        _add_variable(listed, variable, reference, version)
    _add_structure(SubElement(root, "ModelStructure"), variables, version)
    indent(root)
    return bytes(tostring(root, "UTF-8", xml_declaration=True))


def _add_variable(listed: Element, variable: Variable, reference: int, version: int) -> None:
    """Add a variable: in FMI 2.0 its type is an element of its own, and in 3.0 the variable's."""
    said = {
        "name": variable.name,
        "valueReference": str(reference),
        "causality": variable.causality,
    }
    said["variability"] = variable.variability
    values = {"unit": unit_name(variable.unit)} if variable.unit else {}
    if variable.start is not None:
        values["start"] = repr(variable.start)
    kind = _TYPES[variable.kind][version - 2]
    if version == 3:
        SubElement(listed, kind, {**said, **values})
    else:
        SubElement(SubElement(listed, "ScalarVariable", said), kind, values)


def _add_structure(structure: Element, variables: list[Variable], version: int) -> None:
    """Add the outputs, and that all of them are known when the initialization is over."""
    outputs = [place for place, variable in enumerate(variables) if variable.causality == "output"]
    for kind in ("Output", "InitialUnknown"):
        group = structure if version == 3 else SubElement(structure, f"{kind}s")
        for place in outputs:
            said = {"valueReference": str(place)} if version == 3 else {"index": str(place + 1)}
            SubElement(group, kind if version == 3 else "Unknown", said)


def unit_name(unit: str) -> str:
    """Return a unit as FMI writes it: ``N·m/rad`` is ``N.m/rad``."""
    return plain_unit(unit).replace("*", ".").replace("^", "")


def _add_units(definitions: Element, units: Iterable[str]) -> None:
    """Define units by their SI bases; an angle counts as a base where a unit has one."""
    for unit in sorted(units):
        defined = SubElement(definitions, "Unit", name=unit_name(unit))
        try:
            factor, (kg, m, s, _) = parse_unit(plain_unit(unit))
        except UnknownUnit:
            continue
        above, _, below = unit.partition("/")
        angle = any(name in above for name in ("rad", "deg")) - ("rad" in below)
        powers = {"kg": kg, "m": m, "s": s, "rad": angle}
        bases = {base: str(power) for base, power in powers.items() if power}
        SubElement(defined, "BaseUnit", bases | ({} if factor == 1 else {"factor": repr(factor)}))


_MAKERS = {
    2: "pythonfmu",
    3: "pythonfmu3",
}  # packages whose libraries call Python, by version of FMI
_LIBRARIES = ("*.so", "*.dylib")  # there is no Drake for Windows
_SCRIPT = '''"""A station as a unit; simrob_drake must be importable where it runs."""

from simrob_drake.extensions.simulink.fmi.slave import Fmi2Slave as Fmi3Slave, keep

keep(globals())


class {name}(Fmi3Slave):  # by this name pythonfmu3 finds it
    pass
'''


def write_fmu(
    config: StationConfig, target: Path | str, *, version: int = 2, force: bool = False
) -> Path:
    """Write a station as a co-simulation unit.

    Where the unit runs, this package must be importable by the Python it finds there. The files that the station
    names, such as those of robots and pieces, are in the unit.

    Args:
        config: the station.
        target: the file, ending in ``.fmu``.
        version: of FMI, 2 or 3.
        force: replace a file that is there.

    Raises:
        InvalidParameter: a kinematic station, a target of another ending, no such version, or the extra is not
            installed.
        OutputError: the file is there, or the disk does not take it.
    """
    if version not in _MAKERS:
        raise InvalidParameter("--fmi", version, message("simulink.two_or_three", "2 or 3"))
    with importing_extra(message("simulink.fmu_command", "simrob fmu"), "fmi"):
        maker = import_module(_MAKERS[version])
    target = as_path(target, "target")
    check_ending(target, [".fmu"], "--out")
    check_new_file(target, force=force)
    name = f"{plain(config.name)}_unit"
    with TemporaryDirectory() as folder:
        work = Path(folder)
        resources = work / "resources"
        resources.mkdir()
        station = resources / "station.yaml"
        station.write_text(station_yaml(with_copied_files(config, resources)), encoding="utf-8")
        # what cannot be stepped is told here
        described = description(SteppedStation(station), name, version)
        (work / "modelDescription.xml").write_bytes(described)
        (resources / f"{name}.py").write_text(_SCRIPT.format(name=name), encoding="utf-8")
        (resources / "slavemodule.txt").write_text(name, encoding="utf-8")
        with writing(target):
            target.parent.mkdir(parents=True, exist_ok=True)
        with replaced_at_once(target) as whole, ZipFile(whole, "w", ZIP_DEFLATED) as archive:
            for file in sorted(work.rglob("*")):
                archive.write(file, file.relative_to(work))
            for file, place in _library(
                Path(str(maker.__file__)).parent / "resources", name, _MAKERS[version]
            ):
                archive.write(file, place)
    return target


def _library(resources: Path, name: str, maker: str) -> Iterator[tuple[Path, str]]:
    """Yield the compiled part of a unit, for each system where Drake runs, and its licence, with their places."""
    for pattern in _LIBRARIES:
        for file in sorted((resources / "binaries").glob(f"*/{pattern}")):
            yield file, f"binaries/{file.parent.name}/{name}{file.suffix}"
    for entry in distribution(maker).files or ():
        if entry.name == "LICENSE":
            yield Path(str(entry.locate())), f"documentation/licenses/{maker}.txt"
