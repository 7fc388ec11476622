"""What this extension adds to the toolbox. The core finds it by the entry points of pyproject.toml."""

from simrob_drake.base.extension import Extension
from simrob_drake.base.messages import message

EXTENSION = Extension(
    core=">=0.1",
    uses=("mujoco",),
    title=message("tuning.title_of_commands", "Many runs"),
    commands={
        "sweep": "simrob_drake.extensions.tuning.commands.sweep:sweep",
        "tune": "simrob_drake.extensions.tuning.commands.tune:tune",
        "dashboard": "simrob_drake.extensions.tuning.commands.tune:dashboard",
        "prove": "simrob_drake.extensions.tuning.commands.tune:prove",
        "pushes": "simrob_drake.extensions.tuning.commands.pushes:pushes",
    },
    other_files={"tuning": "simrob_drake.extensions.tuning:other_files.yaml"},
    messages={"tuning": "simrob_drake.extensions.tuning:languages"},
)
