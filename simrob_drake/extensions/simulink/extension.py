"""What this extension adds to the toolbox. The core finds it by the entry points of pyproject.toml."""

from simrob_drake.base.extension import Extension

EXTENSION = Extension(
    core=">=0.1",
    title="Exchange and other engines",
    commands={
        "fmu": "simrob_drake.extensions.simulink.commands:fmu",
        "serve": "simrob_drake.extensions.simulink.commands:serve",
    },
)
