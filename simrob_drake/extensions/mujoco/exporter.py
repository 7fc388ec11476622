"""The exporter of stations as MJCF files."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar

import typer

from simrob_drake.base.extras import require
from simrob_drake.base.messages import message
from simrob_drake.programs.exporter import StationExporter
from simrob_drake.stations.config import StationConfig


@dataclass(frozen=True)
class MjcfOptions:
    """Options of the export as MJCF."""

    step: Annotated[
        float, typer.Option(help=message("mujoco.help_mjcf_step", "Length of MuJoCo's steps [s]."))
    ] = 2e-3


class MjcfExporter(StationExporter):
    """Writes a station as an MJCF file that MuJoCo loads by itself (extra `mujoco`)."""

    help: ClassVar[str] = message(
        "mujoco.help_mjcf_file", "The MJCF file of MuJoCo to write, FILE.xml."
    )
    suffix: ClassVar[str] = ".xml"
    options_class: ClassVar[type[Any]] = MjcfOptions

    def export_station(
        self, config: StationConfig, file: Path, options: MjcfOptions, *, force: bool
    ) -> list[Path]:
        """Write a station as MJCF, with a folder of its meshes and controls.

        Args:
            config: the station.
            file: the file to write.
            options: the step length.
            force: whether to replace what is there.

        Returns:
            the files and folders that were written.

        Raises:
            SimrobError: MuJoCo is not installed, MJCF cannot express the station, or a file cannot be written.
        """
        require(message("mujoco.export", "simrob export"), "mujoco", "mujoco")
        from simrob_drake.extensions.mujoco.export import save_mjcf

        return save_mjcf(config, file, step=options.step, force=force)
