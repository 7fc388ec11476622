"""What this extension adds to the toolbox. The core finds it by the entry points of pyproject.toml."""

from simrob_drake.base.extension import Extension
from simrob_drake.base.messages import message

EXTENSION = Extension(
    core=">=0.1",
    title=message("cli.title_robots", "Robots"),
    commands={"teach": "simrob_drake.extensions.pendant.commands:teach"},
    messages={"pendant": "simrob_drake.extensions.pendant:languages"},
)
