"""How to recognise the file of a program, without reading the moves in it."""

from os.path import isfile  # which is false for names that no file can have
from pathlib import Path

from simrob_drake.base.yaml_files import is_yaml_name, read_yaml
from simrob_drake.importer.importer import find_station_importer

_PROGRAM_KEYS = frozenset(("moves", "references"))  # keys of programs that no station has


def is_program_file(file: Path | str) -> bool:
    """Whether a text is the path of a program's YAML file, not of a station. It is False if there is no such file.

    The file is read: that of a program has a key ``moves`` or ``references``.

    Raises:
        InvalidConfig: the file cannot be read.
    """
    # A file that an importer of an extension reads is a station, whatever its keys are.
    if not is_yaml_name(file) or not isfile(file) or find_station_importer(file) is not None:
        return False
    return not _PROGRAM_KEYS.isdisjoint(read_yaml(Path(file)))
