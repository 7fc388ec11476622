"""What this extension adds to the toolbox. The core finds it by the entry points of pyproject.toml."""

from simrob_drake.base.extension import Extension

EXTENSION = Extension(
    core=">=0.1",
    uses=("mujoco", "simulink"),
    title="Exchange and other engines",
    commands={"compare": "simrob_drake.extensions.comparison.commands:compare"},
    other_files={"comparison": "simrob_drake.extensions.comparison:other_files.yaml"},
    messages={"comparison": "simrob_drake.extensions.comparison:languages"},
)
