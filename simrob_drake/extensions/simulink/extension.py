"""What this extension adds to the toolbox. The core finds it by the entry points of pyproject.toml."""

from simrob_drake.base.extension import Extension
from simrob_drake.base.messages import message

_IMPORTER = "simrob_drake.extensions.simulink.importer:SimulinkImporter"
# The last two elements are those of the first generation, for which the importer names the remedy.
_FILES = (
    *(".slx", ".mdl", ".slxp", ".mdlp"),
    *("<SimscapeMultibodyImportXML>", "<PhysicalModelingXMLFile>", "<SimMechanicsImportXML>"),
)

EXTENSION = Extension(
    core=">=0.1",
    title=message("cli.title_exchange", "Exchange and other engines"),
    commands={
        "fmu": "simrob_drake.extensions.simulink.commands:fmu",
        "serve": "simrob_drake.extensions.simulink.commands:serve",
    },
    importers=dict.fromkeys(_FILES, _IMPORTER),
    other_files={"simulink": "simrob_drake.extensions.simulink:other_files.yaml"},
    messages={"simulink": "simrob_drake.extensions.simulink:languages"},
)
