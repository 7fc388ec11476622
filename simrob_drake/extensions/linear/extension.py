"""What this extension adds to the toolbox. The core finds it by the entry points of pyproject.toml."""

from simrob_drake.base.extension import Extension

EXTENSION = Extension(
    core=">=0.1",
    title="Stations",
    commands={"linearize": "simrob_drake.extensions.linear.commands:linearize_station"},
    messages={"linear": "simrob_drake.extensions.linear:languages"},
)
