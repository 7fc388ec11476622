"""The arguments and options that several commands share, each with its help."""

import inspect
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, get_args, get_type_hints

import typer
from pydantic.fields import FieldInfo

from simrob_drake.base.errors import Unsuitable
from simrob_drake.base.files import station_files
from simrob_drake.base.messages import Message, join_texts, message
from simrob_drake.base.packages import MESH_PATH_VARIABLE, granting
from simrob_drake.base.sections import Pose, field_texts, validated
from simrob_drake.results.files import Saved
from simrob_drake.results.plots.formats import PlotFormat
from simrob_drake.robots.imports import ImportOptions


def completed_station(typed: str) -> list[str]:
    """Return the stations of the package that begin as a user typed, for the shell's completion."""
    return [name for name in station_files() if name.startswith(typed)]


StationArgument = Annotated[
    str,
    typer.Argument(
        metavar="STATION",
        help=message("cli.help_station_argument", "A name from `simrob list`, or a YAML file."),
        autocompletion=completed_station,
    ),
]
OptionalStation = Annotated[
    str | None,
    typer.Argument(
        metavar="STATION",
        help=message("cli.help_station_argument", "A name from `simrob list`, or a YAML file."),
        autocompletion=completed_station,
    ),
]
"""Argument of a command that lists the fitting stations if none is given."""
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY.PATH=VALUE|FILE",
        help=message(
            "cli.help_settings", "Change a key of the station, or all that a YAML file has; may be given several times."
        ),
    ),
]
AllowCode = Annotated[
    bool,
    typer.Option(
        "--allow-code", help=message("cli.help_allow_code", "Run the Python code that the station's file names.")
    ),
]
MeshPath = Annotated[
    list[Path] | None,
    typer.Option(
        "--mesh-path",
        metavar="DIR",
        exists=True,
        file_okay=False,
        resolve_path=True,
        help=message(
            "cli.help_mesh_path",
            "A further folder in which meshes and packages of the robot may be read. May be given several times. "
            "Folders in {variable} may always be read.",
            variable=MESH_PATH_VARIABLE,
        ),
    ),
]
Force = Annotated[bool, typer.Option("--force", help=message("cli.help_force", "Replace what is there."))]

ResultFolder = Annotated[
    Path | None,
    typer.Option(
        "--out", help=message("cli.help_result_folder", "Folder of the result; runs/STATION-TIME by default.")
    ),
]
Live = Annotated[
    bool, typer.Option("--live", help=message("cli.help_live", "Show the motion in the browser while it is computed."))
]
NoRecording = Annotated[
    bool, typer.Option("--no-recording", help=message("cli.help_no_recording", "No recording and no film strip."))
]
Video = Annotated[
    bool, typer.Option("--video", help=message("cli.help_video", "Write an MP4, too (needs the extra `video`)."))
]
Workers = Annotated[
    int | None, typer.Option(min=1, help=message("cli.help_workers", "Processes; as many as processors by default."))
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS", help=message("cli.help_scheduler", "A Dask scheduler, tcp://HOST:PORT, whose workers do it.")
    ),
]
Strictly = Annotated[
    bool,
    typer.Option("--strict", help=message("cli.help_strictly", "Exit with 4 if the result has warnings; it is saved.")),
]
ShowVerdict = Annotated[
    bool,
    typer.Option(
        "--verdict",
        help=message("cli.help_show_verdict", "Show all criteria with their bounds, even if all are within them."),
    ),
]
Plots = Annotated[PlotFormat, typer.Option("--plots", help=message("cli.help_plots", "Format of the plots."))]

FileArgument = Annotated[
    Path,
    typer.Argument(
        metavar="FILE",
        help=message(
            "cli.help_file_argument",
            "A URDF, xacro, MJCF or SDF file; for import a Simulink model or a RAPID module, too.",
        ),
    ),
]


@dataclass(frozen=True)
class Saving:
    """How a command shows and saves a run: options that all commands share which simulate."""

    out: ResultFolder = None
    force: Force = False
    live: Live = False
    no_recording: NoRecording = False
    video: Video = False
    plots: Plots = "png"
    strict: Strictly = False
    verdict: ShowVerdict = False

    @property
    def kept(self) -> Saved:
        """What the result's own ``save`` takes of it."""
        return {"force": self.force, "recording": not self.no_recording, "video": self.video, "plots": self.plots}


@dataclass(frozen=True)
class LanguageOptions:
    """How a program in the language of a robot, such as RAPID, is done."""

    robot: Annotated[
        str | None,
        typer.Option(
            metavar="ROBOT",
            help=message("cli.help_language_robot", "Robot that does a RAPID module: alone, or one of --on."),
        ),
    ] = None
    on: Annotated[
        str | None,
        typer.Option(
            "--on", metavar="STATION", help=message("cli.help_language_on", "Station on which a RAPID module is done.")
        ),
    ] = None
    io: Annotated[
        Path | None,
        typer.Option(
            "--io",
            metavar="FILE",
            help=message("cli.help_language_io", "Table of what the signals of a RAPID module mean."),
        ),
    ] = None
    cycles: Annotated[
        int,
        typer.Option(min=1, help=message("cli.help_language_cycles", "Repetitions of WHILE TRUE in a RAPID module.")),
    ] = 1
    check: Annotated[
        Literal["collision", "limits", "nothing"],
        typer.Option(
            help=message(
                "cli.help_language_check",
                "What is checked before each move of a RAPID module, in addition to the reach.",
            )
        ),
    ] = "collision"
    allow_losses: Annotated[
        bool,
        typer.Option(
            "--allow-losses",
            help=message(
                "cli.help_language_allow_losses", "Take a RAPID or Simulink import though parts of it are lost."
            ),
        ),
    ] = False


def with_group(group: type[Any], name: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Return what gives a command the options that are the fields of a class; it takes them together, by a name."""
    hints = get_type_hints(group, include_extras=True)
    own = [
        inspect.Parameter(one.name, inspect.Parameter.KEYWORD_ONLY, default=one.default, annotation=hints[one.name])
        for one in fields(group)
    ]

    def with_options(command: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(command)
        def called(**arguments: Any) -> Any:
            chosen = {one.name: arguments.pop(one.name) for one in own}
            return command(**arguments, **{name: group(**chosen)})

        vars(called)["__signature__"] = _signature(command, name, own)
        return called

    return with_options


with_saving = with_group(Saving, "saving")  # give a command the options of :class:`Saving`
with_language = with_group(LanguageOptions, "language")  # give a command those of :class:`LanguageOptions`


def flag_of(name: str) -> str:
    """Option of the command line for a name of Python: ``--drop-loops`` for ``drop_loops``."""
    return f"--{name.replace('_', '-')}"


class OptionGroup(NamedTuple):
    """Options that belong to one importer or exporter.

    Attributes:
        owner: what the options belong to, such as "a Simulink model" or "--mjcf", for messages.
        options_class: dataclass whose fields are the options.
    """

    owner: str
    options_class: type[Any]


@dataclass(frozen=True)
class ChosenOptions:
    """Values of the options of several groups, such as those of all importers. A command uses one of the groups.

    Attributes:
        groups: the groups of options.
        values: value of each option by the name of its field.
    """

    groups: Sequence[OptionGroup]
    values: Mapping[str, Any]

    def of(self, options_class: type[Any]) -> Any:
        """Make an object of the dataclass of a group from the values of its options."""
        return options_class(**{field.name: self.values[field.name] for field in fields(options_class)})

    def refuse_all_but(self, allowed_classes: Collection[type[Any]]) -> None:
        """Check that only options of some groups are given. An option with its default value counts as not given.

        Args:
            allowed_classes: dataclasses of these groups. If there are none, no option may be given.

        Raises:
            Unsuitable: an option of another group is given; the message says to what it belongs.
        """
        allowed = {field.name for options_class in allowed_classes for field in fields(options_class)}
        for group in self.groups:
            for field in fields(group.options_class):
                is_default = self.values[field.name] == field.default
                if not is_default and field.name not in allowed:
                    raise Unsuitable(
                        flag_of(field.name), message("cli.belongs_to", "it belongs to {owner}", owner=group.owner)
                    )


def with_groups(groups: Sequence[OptionGroup], name: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Make a decorator that gives a command the options of several groups.

    If groups have fields of the same name, the command has one option for all of them, as the first group defines it.

    Args:
        groups: the groups of options.
        name: parameter of the decorated function that takes the chosen options, :class:`ChosenOptions`.
    """
    parameters = dict[str, inspect.Parameter]()
    for group in groups:
        hints = get_type_hints(group.options_class, include_extras=True)
        for field in fields(group.options_class):
            parameter = inspect.Parameter(
                field.name, inspect.Parameter.KEYWORD_ONLY, default=field.default, annotation=hints[field.name]
            )
            parameters.setdefault(field.name, parameter)

    def with_options(command: Callable[..., Any]) -> Callable[..., Any]:
        """Wrap a command's function in one that has a parameter for each option, and collects their values."""

        @wraps(command)
        def called(**arguments: Any) -> Any:
            values = {field: arguments.pop(field) for field in parameters}
            return command(**arguments, **{name: ChosenOptions(groups, values)})

        vars(called)["__signature__"] = _signature(command, name, list(parameters.values()))
        return called

    return with_options


def _signature(command: Callable[..., Any], name: str, instead: list[inspect.Parameter]) -> inspect.Signature:
    """Return a command's signature with parameters in place of one; all of them by keyword."""
    parameters = inspect.signature(command, eval_str=True).parameters.values()
    named = [parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY) for parameter in parameters]
    return inspect.Signature([p for q in named for p in (instead if q.name == name else [q])])


def with_mesh_path(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command that loads a station the option ``--mesh-path``, which holds for all that it loads."""

    @wraps(command)
    def called(*, mesh_path: list[Path] | None = None, **options: Any) -> Any:
        with granting(mesh_path or ()):
            return command(**options)

    own = inspect.Parameter("mesh_path", inspect.Parameter.KEYWORD_ONLY, default=None, annotation=MeshPath)
    signature = _signature(command, "", [])
    vars(called)["__signature__"] = signature.replace(parameters=[*signature.parameters.values(), own])
    return called


def with_import_options(*names: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Give a command options for fields of :class:`ImportOptions`, with their help; all fields unless some are named.

    The command takes them together as ``options``, which is None where nothing was chosen.
    """
    known = names or tuple(ImportOptions.model_fields)
    texts = import_option_messages()
    own = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=option)
        for name in known
        for option, default in [_option(name, ImportOptions.model_fields[name], texts[name])]
    ]

    def with_options(command: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(command)
        def called(**arguments: Any) -> Any:
            chosen = {name: value for name in known if (value := arguments.pop(name)) is not None}
            options = validated(ImportOptions, chosen, message("cli.import_options", "import options"))
            with granting(options.mesh_path):
                return command(**arguments, options=None if options == ImportOptions() else options)

        vars(called)["__signature__"] = _signature(command, "options", own)
        return called

    return with_options


def import_option_messages() -> dict[str, Message]:
    """Helps of the options of an import, by name: the texts below the fields of :class:`ImportOptions`."""
    texts = field_texts(ImportOptions)
    return {name: Message(f"cli.import_{name}", texts[name], {}) for name in ImportOptions.model_fields}


def _option(name: str, field: FieldInfo, text: str) -> tuple[Any, Any]:
    """Make an option of an import.

    Args:
        name: name of the field of :class:`ImportOptions`.
        field: the field.
        text: its help.

    Returns:
        annotation of the command's parameter for typer, and default value.
    """
    flag = flag_of(name)
    several = join_texts([text, message("cli.help_several", "May be given several times.")], " ")
    if field.annotation == tuple[Path, ...]:
        return MeshPath, None
    if field.annotation == tuple[str, ...]:
        return Annotated[list[str] | None, typer.Option(flag, metavar="NAME:=VALUE", help=several)], None
    if Path in get_args(field.annotation):
        return Annotated[Path | None, typer.Option(flag, metavar="FILE", resolve_path=True, help=text)], None
    if get_args(field.annotation) == get_args(Pose):
        numbers = typer.Option(flag, metavar="X Y Z RZ RY RX", help=text)
        return Annotated[tuple[float, float, float, float, float, float] | None, numbers], None
    return Annotated[field.annotation, typer.Option(flag, help=text)], field.default
