"""What this extension adds to the toolbox. The core finds it by the entry points of pyproject.toml."""

from simrob_drake.base.extension import Extension
from simrob_drake.base.messages import message

EXTENSION = Extension(
    core=">=0.1",
    uses=("mujoco", "simulink"),
    title=message("cli.title_exchange", "Exchange and other engines"),
    commands={"compare": "simrob_drake.extensions.comparison.commands:compare"},
    other_files={"comparison": "simrob_drake.extensions.comparison:other_files.yaml"},
    messages={"comparison": "simrob_drake.extensions.comparison:languages"},
)
