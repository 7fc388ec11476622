"""Names that extensions of this project add, for messages where such an extension is missing.

The core imports no extension. This table only lets it say which one a file needs: it decides nothing.
"""

from simrob_drake.base.errors import SimrobError
from simrob_drake.base.extension import additions, installed_extensions

_PROVIDERS = {
    "engines": {"mujoco": "mujoco"},
    "importers": {
        **dict.fromkeys((".mjcf", "<mujoco>"), "mujoco"),
        **dict.fromkeys((".slx", ".mdl", ".slxp", ".mdlp"), "simulink"),
        **dict.fromkeys(("<SimscapeMultibodyImportXML>", "<PhysicalModelingXMLFile>"), "simulink"),
        **dict.fromkeys((".mod", ".modx", ".prg", ".sys", ".sysx", ".pgf"), "rapid"),
    },
    "exporters": {"mjcf": "mujoco", "rapid": "rapid", "urscript": "rapid"},
}
"""Name of the extension of simrob-drake that adds a name, by extension point and name."""


class MissingExtension(SimrobError):
    """Raised when something is used whose extension is not installed, or left out."""


def missing_provider(point: str, name: str) -> str:
    """Say which extension of this project provides a name that nobody provides here, and why it does not.

    Returns:
        the end of a sentence such as "it needs the extension mujoco of simrob-drake, which is not installed". It is
        empty if the name is available, or if no extension of this project provides it.
    """
    provider = _PROVIDERS.get(point, {}).get(name)
    if provider is None or name in additions(point):
        return ""
    needs = f"it needs the extension {provider} of simrob-drake, which is"
    for installed in installed_extensions():
        if installed.name == provider and installed.problem:
            return f"{needs} left out: {installed.problem}"
    return f"{needs} not installed"
