"""Files and folders that are no stations: what they are, and which command takes them.

The core describes some in ``others.yaml``; extensions describe others in files of the same form.
"""

# These return False for names that no file can have, where methods of a Path would raise an error.
from os.path import isdir, isfile
from pathlib import Path

from pydantic import Field

from simrob_drake.base.errors import InvalidConfig, SimrobError
from simrob_drake.base.extension import addition_files
from simrob_drake.base.messages import message
from simrob_drake.base.sections import Strict, validate_section
from simrob_drake.base.yaml_files import is_yaml_name, read_yaml
from simrob_drake.importer.importer import CORE_SUFFIXES
from simrob_drake.stations.config import StationConfig

_OTHERS = Path(__file__).with_name("others.yaml")
_READ = message(
    "cli.what_is_read",
    "stations and programs are read from .yaml, robots from .urdf, .xacro, .xml and .sdf, models from .slx",
)
# A file with one robot may have the key `robot` in place of `robots`.
_STATION_KEYS = {*StationConfig.model_fields, "robot"}
"""Keys of the files of stations."""


class OtherFiles(Strict):
    """Descriptions of files that are no stations. In each text, {file}, {name} and {folder} are those of the file."""

    folders: dict[str, str] = Field(default_factory=dict)
    """Texts about folders, by the name of a file that the folder has."""
    keys: tuple[tuple[tuple[str, ...], str], ...] = ()
    """Texts about YAML files that have all of some keys; the first that fits is used."""
    endings: dict[str, str] = Field(default_factory=dict)
    """Texts about other files, by their suffix."""


def read_descriptions(file: Path) -> OtherFiles:
    """Read descriptions of other files; raises InvalidConfig if the file cannot be read or has another form."""
    return validate_section(OtherFiles, read_yaml(file), str(file))


def refuse_other(text: str) -> None:
    """Check that an argument for a station is not a file or folder that is known to be something else.

    Args:
        text: argument of a command. If there is no such file or folder, it passes: it may be the name of a station. A
            folder, a YAML file and the file of a robot pass, too, if they have no description: they are reported when
            the station is loaded.

    Raises:
        InvalidConfig: there is a description of the file or folder. The message says what it is, and which command
            takes it.
        InvalidConfig: the file has no description, and is neither a YAML file nor the file of a robot; or it is a YAML
            file that cannot be read.
    """
    file = Path(text)
    if not isdir(file) and not isfile(file):
        return
    is_yaml = isfile(file) and is_yaml_name(file)
    keys = set(read_yaml(file)) if is_yaml else set[str]()
    # An empty file is described by its suffix, or reported when the station is loaded.
    if keys and keys <= _STATION_KEYS:
        return
    # Extensions come first: if the core describes the same files, an extension describes them in more detail.
    for descriptions in [*_descriptions_of_extensions(), read_descriptions(_OTHERS)]:
        remedy = _find_remedy(file, keys, descriptions)
        if remedy:
            raise InvalidConfig(
                file,
                "",
                message("cli.is_no_station", "is not a station, but {remedy}", remedy=remedy),
            )
    # Loading refuses the file of a robot, and says what makes a station of it.
    is_robot = file.suffix.lower() in CORE_SUFFIXES
    if isfile(file) and not is_yaml and not is_robot:
        raise InvalidConfig(
            file,
            "",
            message(
                "cli.neither_station_nor_robot",
                "is neither a station nor a robot; {hint}",
                hint=_READ,
            ),
        )


def _descriptions_of_extensions() -> list[OtherFiles]:
    """Read the descriptions that extensions add. Descriptions that cannot be read are left out."""
    found = []
    for path in addition_files("other_files"):
        try:
            found.append(read_descriptions(path))
        except SimrobError:
            # Without the description a message is only less clear. `simrob extensions --check` reports the problem.
            continue
    return found


def _find_remedy(file: Path, keys: set[str], descriptions: OtherFiles) -> str:
    """Find the text about a file or folder: what it is, and which command takes it.

    Args:
        file: the file or folder.
        keys: keys of the file if it is a YAML file; empty for other files and for folders.
        descriptions: descriptions of files that are no stations.

    Returns:
        the first text that fits, with the file's own names in place of {file}, {name} and {folder}; empty if none fits.
    """
    if isdir(file):
        texts = [text for name, text in descriptions.folders.items() if isfile(file / name)]
    elif keys:
        texts = [text for needed, text in descriptions.keys if keys.issuperset(needed)]
    else:
        texts = [
            text for ending, text in descriptions.endings.items() if ending == file.suffix.lower()
        ]
    if not texts:
        return ""
    # Plain replacement: a text of an extension is no template, and may have other braces.
    remedy = texts[0].replace("{file}", str(file))
    remedy = remedy.replace("{name}", file.name)
    return remedy.replace("{folder}", str(file.parent))
