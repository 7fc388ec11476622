"""Files and folders that are no station: what they are, and which command or key takes them."""

from collections.abc import Mapping
from os.path import isdir, isfile  # which are false for names that no file can have
from pathlib import Path

from simrob_drake.errors import InvalidConfig
from simrob_drake.yaml_files import YAML_SUFFIXES, read_yaml

_MESH = "a mesh: pieces: {{part: {{mesh: {name}, density: 1000}}}} in a station, or <mesh> in a URDF"
_BY_SUFFIX: Mapping[str, str] = {
    ".csv": "a table: simrob compare STATION --with {file}, or reference: {{kind: table, file: {name}}} in a station",
    ".mat": "variables of MATLAB: simrob compare STATION --with {file}, or simrob check MODEL.slx --variables {file}",
    ".json": "JSON: simrob run STATION --set start={file}, if it is the start.json of a result",
    ".jsonl": "a journal of runs: simrob sweep {folder}, or simrob tune STUDY --out {folder}, go on with it",
    ".onnx": "a network: controllers: {{policy: {{kind: policy, network: {name}, ...}}}} in a station",
    ".py": "a script: python {file}",
    ".fmu": "a unit of FMI: Simulink, OpenModelica and others import it",
    **dict.fromkeys((".stl", ".obj", ".dae", ".ply", ".off", ".glb", ".gltf"), _MESH),
}
_BY_KEYS: Mapping[frozenset[str], str] = {
    frozenset({"vary", "cost"}): "a study: simrob tune {file}",
    frozenset({"rewards", "station"}): "a task to learn: StationEnvironment('{file}') of simrob_drake.learning",
    frozenset({"asked", "digest"}): "the file of many runs: simrob sweep, tune or prove go on with {folder}",
    frozenset({"urdf", "axes"}): "a robot: simrob check URDF, or robot: {{model: {file}}} in a station",
    frozenset({"dh"}): "a robot: robot: {{model: {file}}} in a station",
    frozenset(
        {"facing_deg", "fastest"}
    ): "the figures of a robot's walk: controllers: {{walk: {{kind: walk}}}} takes them",
    frozenset({"facing_deg"}): "the gaits of a robot: simrob walk STATION --gait NAME, of a station with it",
    frozenset({"shapes"}): "a piece: pieces: {{part: {{model: {file}}}}} in a station",
}
"""What holds all of some keys; the first that fits."""
_FOLDERS: Mapping[str, str] = {
    "sweep.yaml": "the folder of a sweep: simrob sweep {file}",
    "study.yaml": "the folder of a study: simrob prove {file}",
    "station.yaml": "the folder of a result, whose station is {file}/station.yaml",
}
"""By a file that they hold."""
_READ = "stations and programs are read from .yaml, robots from .urdf, .xacro, .xml and .sdf, models from .slx"


def refuse_other(text: str) -> None:
    """Say what a file or a folder is, and what takes it, if that is known and no station does.

    Args:
        text: a name, or a file.

    Raises:
        InvalidConfig: it is no station; or a YAML file that cannot be read.
    """
    file = Path(text)
    if isdir(file):
        known = next((known for name, known in _FOLDERS.items() if isfile(file / name)), None)
    elif not isfile(file):
        return
    elif file.suffix.lower() in YAML_SUFFIXES:
        keys = read_yaml(file).keys()
        known = next((known for needed, known in _BY_KEYS.items() if needed <= keys), None)
    elif (known := _BY_SUFFIX.get(file.suffix.lower())) is None:
        raise InvalidConfig(file, "", f"is neither a station nor a robot; {_READ}")
    if known is not None:
        remedy = known.format(file=file, name=file.name, folder=file.parent)
        raise InvalidConfig(file, "", f"is no station but {remedy}")
