"""What this extension adds to the toolbox. The core finds it by the entry points of pyproject.toml."""

from simrob_drake.base.extension import Extension

EXTENSION = Extension(
    core=">=0.1",
    importers={"directives:": "simrob_drake.extensions.drake_scenes.importer:SceneImporter"},
    exporters={
        "dmd": "simrob_drake.extensions.drake_scenes.exporters:DirectivesExporter",
        "scenario": "simrob_drake.extensions.drake_scenes.exporters:ScenarioExporter",
        "urdf": "simrob_drake.extensions.drake_scenes.exporters:UrdfExporter",
        "sdf": "simrob_drake.extensions.drake_scenes.exporters:SdfExporter",
    },
    messages={"drake_scenes": "simrob_drake.extensions.drake_scenes:languages"},
)
