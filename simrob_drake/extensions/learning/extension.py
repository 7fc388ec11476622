"""What this extension adds to the toolbox. The core finds it by the entry points of pyproject.toml."""

from simrob_drake.base.extension import Extension

EXTENSION = Extension(
    core=">=0.1",
    uses=("mujoco",),
    controllers={"policy": "simrob_drake.extensions.learning.policy:Policy"},
    other_files={"learning": "simrob_drake.extensions.learning:other_files.yaml"},
    messages={"learning": "simrob_drake.extensions.learning:languages"},
)
