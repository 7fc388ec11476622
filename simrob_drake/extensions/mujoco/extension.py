"""What this extension adds to the toolbox. The core finds it by the entry points of pyproject.toml."""

from simrob_drake.base.extension import Extension

EXTENSION = Extension(
    core=">=0.1",
    engines={"mujoco": "simrob_drake.extensions.mujoco.engine:MujocoEngine"},
    importers={
        ".mjcf": "simrob_drake.extensions.mujoco.importer:MjcfImporter",
        "<mujoco>": "simrob_drake.extensions.mujoco.importer:MjcfImporter",
    },
    exporters={"mjcf": "simrob_drake.extensions.mujoco.exporter:MjcfExporter"},
    messages={"mujoco": "simrob_drake.extensions.mujoco:languages"},
)
