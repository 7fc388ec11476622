"""The exporters of stations as files of Drake."""

from pathlib import Path
from typing import Any, ClassVar

from simrob_drake.base.messages import message
from simrob_drake.programs.exporter import StationExporter
from simrob_drake.stations.config import StationConfig


class DirectivesExporter(StationExporter):
    """Writes a station as model directives of Drake."""

    help: ClassVar[str] = message(
        "drake_scenes.help_directives",
        "Model directives of Drake to write, FILE.dmd.yaml, with a folder of models.",
    )
    suffix: ClassVar[str] = ".yaml"

    def export_station(
        self, config: StationConfig, file: Path, options: Any, *, force: bool
    ) -> list[Path]:
        """Write a station. Arguments and errors are those of the base class."""
        from simrob_drake.extensions.drake_scenes.exporting import save_directives

        return save_directives(config, file, force=force)


class ScenarioExporter(StationExporter):
    """Writes a station as a scenario of Drake: directives, drivers and settings of the simulation."""

    help: ClassVar[str] = message(
        "drake_scenes.help_scenario",
        "Scenario of Drake to write, FILE.yaml: directives, drivers and settings.",
    )
    suffix: ClassVar[str] = ".yaml"

    def export_station(
        self, config: StationConfig, file: Path, options: Any, *, force: bool
    ) -> list[Path]:
        """Write a station. Arguments and errors are those of the base class."""
        from simrob_drake.extensions.drake_scenes.exporting import save_scenario

        return save_scenario(config, file, force=force)


class UrdfExporter(StationExporter):
    """Writes a station as one URDF file."""

    help: ClassVar[str] = message(
        "drake_scenes.help_urdf",
        "URDF of the whole station to write, FILE.urdf; it has no positions of joints.",
    )
    suffix: ClassVar[str] = ".urdf"

    def export_station(
        self, config: StationConfig, file: Path, options: Any, *, force: bool
    ) -> list[Path]:
        """Write a station. Arguments and errors are those of the base class."""
        from simrob_drake.extensions.drake_scenes.exporting import save_urdf

        return save_urdf(config, file, force=force)


class SdfExporter(StationExporter):
    """Writes a station as one world of an SDF file."""

    help: ClassVar[str] = message(
        "drake_scenes.help_sdf",
        "SDF world of the whole station to write, FILE.sdf; it has no positions of joints.",
    )
    suffix: ClassVar[str] = ".sdf"

    def export_station(
        self, config: StationConfig, file: Path, options: Any, *, force: bool
    ) -> list[Path]:
        """Write a station. Arguments and errors are those of the base class."""
        from simrob_drake.extensions.drake_scenes.exporting import save_sdf

        return save_sdf(config, file, force=force)
