"""What this extension adds to the toolbox. The core finds it by the entry points of pyproject.toml."""

from simrob_drake.base.extension import Extension

_IMPORTER = "simrob_drake.extensions.rapid.importer:RapidImporter"

EXTENSION = Extension(
    core=">=0.1",
    importers=dict.fromkeys((".mod", ".modx", ".prg", ".sys", ".sysx", ".pgf"), _IMPORTER),
    exporters={
        "rapid": "simrob_drake.extensions.rapid.exporters:RapidExporter",
        "urscript": "simrob_drake.extensions.rapid.exporters:UrscriptExporter",
    },
    messages={"rapid": "simrob_drake.extensions.rapid:languages"},
)
