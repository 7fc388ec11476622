"""Exporter of a station's motion: joint positions over time as CSV, which every spreadsheet opens."""

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
import typer

from simrob_drake.base.folders import written_at_once
from simrob_drake.programs.exporter import StationExporter
from simrob_drake.stations.config import StationConfig


@dataclass(frozen=True)
class CsvOptions:
    """Options that the exporter adds to `simrob export`."""

    rate: Annotated[
        float, typer.Option("--rate", min=0.1, max=1000, help="Rows per second of the CSV file.")
    ] = 20.0


class PositionsCsv(StationExporter):
    """Runs a station, or the program that it carries, and writes the positions of all joints."""

    help: ClassVar[str] = "Joint positions over time as CSV, FILE.csv, in degrees or metres."
    suffix: ClassVar[str] = ".csv"
    options_class: ClassVar[type[Any]] = CsvOptions

    def export_station(
        self, config: StationConfig, file: Path, options: CsvOptions, *, force: bool
    ) -> list[Path]:
        """Write one row for each sample: the time [s], then each axis.

        Raises:
            SimrobError: the station cannot be run, or the file cannot be written.
        """
        # programs load much, and the help needs this module
        from simrob_drake.programs.whole_program import (
            run_whole,
        )

        result = run_whole(config.model_copy(update={"sample_rate": options.rate}))
        headings = ["time [s]"]
        columns = [result.times]
        for robot in result.plant.robots.values():
            for axis, unit in zip(robot.axes, robot.model.units, strict=True):
                headings.append(f"{robot.prefix}{axis} [{unit.name}]")
                columns.append(result[f"{robot.prefix}q.{axis}"] / unit.size)
        text = io.StringIO()
        np.savetxt(
            text,
            np.column_stack(columns),
            delimiter=",",
            header=",".join(headings),
            comments="",
            fmt="%.6g",
        )
        written_at_once(file, text.getvalue())
        return [file]
