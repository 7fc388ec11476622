"""The commands that let other software step a station: `simrob fmu` and `simrob serve`."""

import os
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from simrob_drake.base.messages import message, translate
from simrob_drake.cli.arguments import station_from
from simrob_drake.cli.options import Force, Settings, StationArgument, with_mesh_path
from simrob_drake.cli.screen import STATION, say_place, say_text
from simrob_drake.stations.config import StationConfig

Step = Annotated[
    float | None,
    typer.Option(
        help=message(
            "simulink.help_step",
            "Take steps of this length [s], the fastest way at a given communication step.",
        )
    ),
]


@with_mesh_path
def fmu(
    station: StationArgument,
    out: Annotated[
        Path | None,
        typer.Option(help=message("simulink.help_fmu_out", "FILE.fmu; STATION.fmu unless given.")),
    ] = None,
    set_: Settings = None,
    step: Step = None,
    fmi: Annotated[
        int, typer.Option(help=message("simulink.help_fmu_fmi", "Version of FMI: 2 or 3."))
    ] = 2,
    force: Force = False,
) -> None:
    """Write a station as an FMI co-simulation unit, for Simulink, OpenModelica and others.

    For example:

        simrob fmu irb120_dynamic --step 1e-3 --out irb120.fmu
    """
    from simrob_drake.extensions.simulink.fmi.unit import write_fmu

    config = _station_with_steps(station, set_, step)
    target = out or Path(f"{config.name}.fmu")
    file = write_fmu(config, target, version=fmi, force=force)
    say_place(message("simulink.unit", "unit"), file)


@with_mesh_path
def serve(
    station: StationArgument,
    set_: Settings = None,
    step: Step = None,
    host: Annotated[
        str,
        typer.Option(
            help=message(
                "simulink.help_serve_host",
                "Where to listen; others than this computer reach it if it is not its own.",
            )
        ),
    ] = "127.0.0.1",
    port: Annotated[
        int | None,
        typer.Option(
            min=0,
            max=65535,
            help=message("simulink.help_serve_port", "Port; 8300, or a free one, by default."),
        ),
    ] = None,
) -> None:
    """Let others step a station over TCP, as MATLAB on Windows; they need its token, of SIMROB_TOKEN or a random one.

    For example:

        simrob serve irb120_dynamic --step 1e-3
    """
    from simrob_drake.extensions.simulink.stepping import server

    config = _station_with_steps(station, set_, step)
    token = os.environ.get(server.TOKEN_VARIABLE)  # None: the server makes a random one
    station_server = server.StationServer(config, host=host, port=port, token=token)
    with station_server, suppress(KeyboardInterrupt):
        used_port = station_server.server_address[1]
        place = message(
            "simulink.served_at",
            "{station} at {host}, port {port}",
            station=station_server.config.name,
            host=host,
            port=used_port,
        )
        say_place(STATION, translate(place))
        say_place(message("simulink.token", "token"), station_server.token)
        say_place(message("simulink.client", "client"), server.CLIENT)
        say_text(message("simulink.end_with", "end with Ctrl+C"))
        station_server.serve_forever()


def _station_with_steps(
    station: str, settings: list[str] | None, step: float | None
) -> StationConfig:
    """Read a station, and give it steps of a fixed length.

    Args:
        station: name or file of the station.
        settings: changes of the station, as the option ``--set`` takes them.
        step: length of the steps [s]. If it is None, the station keeps its own solver.

    Raises:
        SimrobError: there is no such station, a change is wrong, or the station cannot have such steps.
    """
    from simrob_drake.extensions.simulink.stepping.station import with_fixed_steps

    config = station_from(station, settings)
    return config if step is None else with_fixed_steps(config, step)
