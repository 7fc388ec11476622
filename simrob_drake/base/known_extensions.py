"""Names that extensions of this project add, for messages about a missing extension.

The core imports no extension. The table of names only serves for messages, such as that a file needs an extension.
"""

from simrob_drake.base.extension import additions, needed_extension

# Extensions cannot be asked for these names: the ones that matter here are those that are not installed.
_PROVIDERS = {
    "controllers": {"policy": "learning"},
    "engines": {"mujoco": "mujoco"},
    "importers": {
        **dict.fromkeys((".mjcf", "<mujoco>"), "mujoco"),
        **dict.fromkeys((".slx", ".mdl", ".slxp", ".mdlp"), "simulink"),
        **dict.fromkeys(("<SimscapeMultibodyImportXML>", "<PhysicalModelingXMLFile>"), "simulink"),
        "<SimMechanicsImportXML>": "simulink",
        "directives:": "drake_scenes",
        **dict.fromkeys((".mod", ".modx", ".prg", ".sys", ".sysx", ".pgf"), "rapid"),
    },
    "exporters": {
        "mjcf": "mujoco",
        **dict.fromkeys(("dmd", "scenario", "urdf", "sdf"), "drake_scenes"),
        "rapid": "rapid",
        "urscript": "rapid",
    },
}
"""Name of the extension of simrob-drake that adds a name, by extension point and name."""


def known_names(point: str) -> list[str]:
    """Names that extensions of this project add at an extension point, whether they are installed or not."""
    return list(_PROVIDERS.get(point, {}))


def check_provided(point: str, name: str, purpose: str) -> None:
    """Raise an error if a name belongs to an extension of this project that is missing.

    For any other name nothing is raised, and the caller reports an unknown name.

    Args:
        point: extension point at which the name is looked for, a key of ``POINTS``.
        name: name that a user wrote, and that the core does not have.
        purpose: what needs the name, the subject of the message, such as ``solver.kind mujoco``.

    Raises:
        MissingExtension: an extension of this project adds the name, and is not installed or is left out.
    """
    provider = _PROVIDERS.get(point, {}).get(name)
    if provider is not None and name not in additions(point):
        # The context manager raises the error. There is nothing to do inside of it.
        with needed_extension(provider, purpose):
            pass
