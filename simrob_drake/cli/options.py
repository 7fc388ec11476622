"""The arguments and options that several commands share, each with its help."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

StationArgument = Annotated[str, typer.Argument(metavar="STATION", help="A name from `simrob list`, or a YAML file.")]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY.PATH=VALUE", help="Change a key of the station; may be given several times."),
]
Force = Annotated[bool, typer.Option("--force", help="Replace what is there.")]

ResultFolder = Annotated[Path | None, typer.Option("--out", help="Folder of the result; runs/STATION-TIME by default.")]
Live = Annotated[bool, typer.Option("--live", help="Show the motion in the browser while it is computed.")]
NoRecording = Annotated[bool, typer.Option("--no-recording", help="No recording and no film strip.")]
Video = Annotated[bool, typer.Option("--video", help="Write an MP4, too (needs the extra `video`).")]

FileArgument = Annotated[
    Path, typer.Argument(metavar="FILE", help="A URDF or xacro file, or a Simulink model (import).")
]
MeshPath = Annotated[
    list[Path] | None,
    typer.Option(
        "--mesh-path",
        metavar="DIR",
        exists=True,
        file_okay=False,
        help="A further folder with meshes or packages; may be given often.",
    ),
]
Collision = Annotated[
    Literal["hull", "box", "none"], typer.Option(help="What collision meshes become: convex hull, box, or nothing.")
]
Estimate = Annotated[
    bool, typer.Option("--estimate-inertia", help="Estimate missing and impossible inertias from the geometry.")
]
Density = Annotated[float, typer.Option(help="Of links whose inertia is estimated [kg/m³].")]
Base = Annotated[
    Literal["auto", "fixed", "floating"], typer.Option(help="Whether the root link is fixed to the world.")
]
Friction = Annotated[
    bool, typer.Option("--friction-as-damping", help="Add joint friction, which Drake ignores, to the damping.")
]
