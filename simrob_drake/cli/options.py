"""The arguments and options that several commands share, each with its help."""

import inspect
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Annotated, Any

import typer
from pydantic.fields import FieldInfo

from simrob_drake.importer.options import ImportOptions
from simrob_drake.results.plots.formats import PlotFormat
from simrob_drake.yaml_files import validated

StationArgument = Annotated[str, typer.Argument(metavar="STATION", help="A name from `simrob list`, or a YAML file.")]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY.PATH=VALUE|FILE",
        help="Change a key of the station, or all that a YAML file has; may be given several times.",
    ),
]
AllowCode = Annotated[bool, typer.Option("--allow-code", help="Run the Python code that the station's file names.")]
Force = Annotated[bool, typer.Option("--force", help="Replace what is there.")]

ResultFolder = Annotated[Path | None, typer.Option("--out", help="Folder of the result; runs/STATION-TIME by default.")]
Live = Annotated[bool, typer.Option("--live", help="Show the motion in the browser while it is computed.")]
NoRecording = Annotated[bool, typer.Option("--no-recording", help="No recording and no film strip.")]
Video = Annotated[bool, typer.Option("--video", help="Write an MP4, too (needs the extra `video`).")]
Workers = Annotated[int | None, typer.Option(min=1, help="Processes; as many as processors by default.")]
Scheduler = Annotated[
    str | None, typer.Option(metavar="ADDRESS", help="A Dask scheduler, tcp://HOST:PORT, whose workers do it.")
]
Plots = Annotated[PlotFormat, typer.Option("--plots", help="What the plots are written as.")]

FileArgument = Annotated[
    Path, typer.Argument(metavar="FILE", help="A URDF or xacro file, or a Simulink model (import).")
]


def with_import_options(*names: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Give a command options for fields of :class:`ImportOptions`, with their help; all fields unless some are named.

    The command takes them together as ``options``, which is None where nothing was chosen.
    """
    fields = {name: ImportOptions.model_fields[name] for name in names or ImportOptions.model_fields}
    own = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=option)
        for name, (option, default) in {name: _option(name, field) for name, field in fields.items()}.items()
    ]

    def with_options(command: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(command)
        def called(**given: Any) -> Any:
            chosen = {name: value for name in fields if (value := given.pop(name)) is not None}
            options = validated(ImportOptions, chosen, "import options")
            return command(**given, options=None if options == ImportOptions() else options)

        parameters = inspect.signature(command, eval_str=True).parameters.values()
        signature = [p for q in parameters for p in (own if q.name == "options" else [q])]
        vars(called)["__signature__"] = inspect.Signature(signature)
        return called

    return with_options


def _option(name: str, field: FieldInfo) -> tuple[Any, Any]:
    """Return what typer makes an option of, and its default."""
    flag = f"--{name.replace('_', '-')}"
    several = f"{field.description} May be given several times."
    if field.annotation == tuple[Path, ...]:
        folders = typer.Option(flag, metavar="DIR", exists=True, file_okay=False, resolve_path=True, help=several)
        return Annotated[list[Path] | None, folders], None
    if field.annotation == tuple[str, ...]:
        return Annotated[list[str] | None, typer.Option(flag, metavar="NAME:=VALUE", help=several)], None
    return Annotated[field.annotation, typer.Option(flag, help=field.description)], field.default
