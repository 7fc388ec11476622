"""Where the blocks come from that a model takes out of other files."""

from collections.abc import Iterable
from pathlib import Path

from simrob_drake.simulink.reading.graph import Model, SimulinkBlock, System
from simrob_drake.simulink.reading.model_file import read_model

BUILT_IN = {
    "sm_lib", "nesl_utility", "simulink", "slpidlib", "fl_lib", "fl_ps_legacy_lib", "simulink_extras", "robotcorelib",
    "robotmaniplib", "robotalgslib", "ee_lib", "sdl_lib", "batteryecm_lib", "SignalEditorBlockLib", "eml_lib", "sflib",
    "dspsrcs4", "dspsigops", "simscape", "sl3dlib", "sim3dlib", "uavlib", "autolibshared", "aerolibsixdof",
}  # fmt: skip
"""Libraries of MATLAB: their blocks are known by name, or not at all."""

_SUFFIXES = ".slx", ".mdl"
_MOST_FOLDERS = 500


class Libraries:
    """Model files by name, each read once, from the folders that the user names.

    Attributes:
        missing: names of files that were asked for and lie in none of the folders.
    """

    def __init__(self, folders: Iterable[Path]) -> None:
        """Take the folders; those right below them count, too."""
        self._folders = list(folders)
        self._models: dict[str, Model | None] = {}
        self.missing: set[str] = set()

    def model(self, name: str) -> Model | None:
        """Return a file's model, or None where it lies in no folder.

        Raises:
            InvalidModel: the file cannot be read.
        """
        if name not in self._models:
            file = self._find(name)
            self._models[name] = None if file is None else read_model(file)
        if self._models[name] is None:
            self.missing.add(name)
        return self._models[name]

    def block(self, place: str) -> SimulinkBlock | None:
        """Return the block of a library at ``file/system/block``, or None where there is none.

        Raises:
            InvalidModel: the library cannot be read.
        """
        name, *way = (part.replace("\0", "/") for part in place.replace("//", "\0").split("/"))
        model = self.model(name)
        system: System | None = model.system if model else None
        found: SimulinkBlock | None = None
        for step in way:
            found = next((block for block in system.blocks.values() if block.name == step), None) if system else None
            system = found.system if found else None
        return found

    def _find(self, name: str) -> Path | None:
        if "/" in name or "\\" in name or name.startswith("."):
            return None
        for folder in self._folders:
            below = (
                sorted(child for child in folder.iterdir() if child.is_dir())[:_MOST_FOLDERS] if folder.is_dir() else []
            )
            for place in (folder, *below):
                for suffix in _SUFFIXES:
                    if (place / f"{name}{suffix}").is_file():
                        return place / f"{name}{suffix}"
        return None
