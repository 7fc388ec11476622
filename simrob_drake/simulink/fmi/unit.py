"""A station as a file that Simulink, OpenModelica, FMPy and others load: a unit of FMI 2.0 or 3.0 for co-simulation."""

from collections.abc import Iterator
from importlib import import_module
from importlib.metadata import distribution
from pathlib import Path
from tempfile import TemporaryDirectory
from zipfile import ZIP_DEFLATED, ZipFile

from simrob_drake.arguments import as_path
from simrob_drake.errors import InvalidParameter, OutputError
from simrob_drake.extras import needed
from simrob_drake.folders import replaced_at_once, writing
from simrob_drake.simulink.fmi.description import description
from simrob_drake.simulink.stepping.station import SteppedStation
from simrob_drake.simulink.writing.urdf import plain
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.load import station_yaml
from simrob_drake.stations.located import carried

_MAKERS = {2: "pythonfmu", 3: "pythonfmu3"}
"""Packages whose libraries call Python, by version of FMI."""
_LIBRARIES = ("*.so", "*.dylib")  # there is no Drake for Windows
_SCRIPT = '''"""A station as a unit; simrob_drake must be importable where it runs."""

from simrob_drake.simulink.fmi.slave import Fmi2Slave as Fmi3Slave, keep

keep(globals())


class {name}(Fmi3Slave):  # by this name pythonfmu3 finds it
    pass
'''


def write_fmu(config: StationConfig, target: Path | str, *, version: int = 2, force: bool = False) -> Path:
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
        raise InvalidParameter("--fmi", version, "2 or 3")
    with needed("simrob fmu", "fmi"):
        maker = import_module(_MAKERS[version])
    target = as_path(target, "target")
    if target.suffix != ".fmu":
        raise InvalidParameter("--out", str(target), "a file that ends in .fmu")
    if target.exists() and not force:
        raise OutputError(f"{target} exists already; choose another file or replace it with --force")
    name = f"{plain(config.name)}_unit"
    with TemporaryDirectory() as folder:
        work = Path(folder)
        resources = work / "resources"
        resources.mkdir()
        station = resources / "station.yaml"
        station.write_text(station_yaml(carried(config, resources)), encoding="utf-8")
        described = description(SteppedStation(station), name, version)  # what cannot be stepped is told here
        (work / "modelDescription.xml").write_bytes(described)
        (resources / f"{name}.py").write_text(_SCRIPT.format(name=name), encoding="utf-8")
        (resources / "slavemodule.txt").write_text(name, encoding="utf-8")
        with writing(target):
            target.parent.mkdir(parents=True, exist_ok=True)
        with replaced_at_once(target) as whole, ZipFile(whole, "w", ZIP_DEFLATED) as archive:
            for file in sorted(work.rglob("*")):
                archive.write(file, file.relative_to(work))
            for file, place in _library(Path(str(maker.__file__)).parent / "resources", name, _MAKERS[version]):
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
