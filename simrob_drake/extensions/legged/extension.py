"""What this extension adds to the toolbox. The core finds it by the entry points of pyproject.toml."""

from simrob_drake.base.extension import Extension
from simrob_drake.base.messages import message

EXTENSION = Extension(
    core=">=0.1",
    uses=("tuning",),
    title=message("cli.title_robots", "Robots"),
    commands={"legged": "simrob_drake.extensions.legged.commands:legged"},
    messages={"legged": "simrob_drake.extensions.legged:languages"},
)
