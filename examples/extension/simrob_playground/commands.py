"""Command that measures the power of joints."""

from typing import Annotated

import numpy as np
import typer

from simrob_drake import load_station, simulate


def power(
    station: Annotated[str, typer.Argument(help="A station with one robot, by name or file.")],
    duration: Annotated[
        float | None, typer.Option(help="Time to simulate [s]; that of the station unless given.")
    ] = None,
) -> None:
    """Run a station and print the largest mechanical power of each joint."""
    config = load_station(station, {"sensors.power": {"kind": "joint_power"}})
    result = simulate(config, duration=duration, progress=False)
    for column in result.names:
        if column.startswith("joint_power.power."):
            axis = column.rpartition(".")[2]
            print(f"{axis:12} {np.abs(result[column]).max():8.3f} W")
