"""Arguments and options that several commands share, each with its help.

Commands are functions, whose parameters typer turns into options. A *group* of options is a dataclass whose fields are
the options. A decorator replaces one parameter of a command, which takes an object of this class, by a parameter for
each field: typer sees the options, and the command gets the object.
"""

import inspect
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, TypeAlias, get_args, get_type_hints

import typer
from pydantic.fields import FieldInfo

from simrob_drake.base.errors import Unsuitable
from simrob_drake.base.files import station_files
from simrob_drake.base.messages import Message, join_texts, message
from simrob_drake.base.packages import MESH_PATH_VARIABLE, granting
from simrob_drake.base.sections import Pose, field_texts, validate_section
from simrob_drake.results.files import Saved
from simrob_drake.results.plots.formats import PlotFormat
from simrob_drake.robots.imports import ImportOptions


def completed_station(typed: str) -> list[str]:
    """List the stations whose names begin with a text, for the shell's completion."""
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
"""Argument of a command that lists the suitable stations if no station is given."""

# A setting and a file have the same option, so that a file of settings can be made from a command line.
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY.PATH=VALUE|FILE",
        help=message(
            "cli.help_settings",
            "Change a key of the station, or all keys of a YAML file; may be given several times.",
        ),
    ),
]
AllowCode = Annotated[
    bool,
    typer.Option(
        "--allow-code",
        help=message("cli.help_allow_code", "Run the Python code that the station's file names."),
    ),
]
MeshPath = Annotated[
    list[Path] | None,
    typer.Option(
        "--mesh-path",
        metavar="DIR",
        # A missing folder would be ignored without a word, and the error would be about a mesh that is not found.
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
Force = Annotated[
    bool, typer.Option("--force", help=message("cli.help_force", "Replace existing files."))
]

# The options of `Saving`: all commands that simulate have them, with the same helps.
ResultFolder = Annotated[
    Path | None,
    typer.Option(
        "--out",
        help=message(
            "cli.help_result_folder", "Folder of the result; runs/STATION-TIME by default."
        ),
    ),
]
Live = Annotated[
    bool,
    typer.Option(
        "--live",
        help=message("cli.help_live", "Show the motion in the browser while it is computed."),
    ),
]
NoRecording = Annotated[
    bool,
    typer.Option(
        "--no-recording",
        help=message("cli.help_no_recording", "Write no recording and no film strip."),
    ),
]
Video = Annotated[
    bool,
    typer.Option(
        "--video", help=message("cli.help_video", "Also write an MP4 (needs the extra `video`).")
    ),
]
Workers = Annotated[
    int | None,
    typer.Option(
        min=1,
        help=message("cli.help_workers", "Count of processes; by default one for each processor."),
    ),
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help=message(
            "cli.help_scheduler", "A Dask scheduler, tcp://HOST:PORT, whose workers do the work."
        ),
    ),
]
Strictly = Annotated[
    bool,
    typer.Option(
        "--strict",
        help=message(
            "cli.help_strictly",
            "Exit with 4 if the result has warnings; the result is saved all the same.",
        ),
    ),
]
ShowVerdict = Annotated[
    bool,
    typer.Option(
        "--verdict",
        help=message(
            "cli.help_show_verdict",
            "Show all criteria with their bounds, even if no bound is violated.",
        ),
    ),
]
Plots = Annotated[
    PlotFormat, typer.Option("--plots", help=message("cli.help_plots", "Format of the plots."))
]

FileArgument = Annotated[
    Path,
    typer.Argument(
        metavar="FILE",
        help=message(
            "cli.help_file_argument",
            "A URDF, xacro, MJCF or SDF file; import also reads a Simulink model or a RAPID module.",
        ),
    ),
]


@dataclass(frozen=True)
class Saving:
    """Options for showing and saving a run. All commands that simulate have them."""

    out: ResultFolder = None
    force: Force = False
    live: Live = False
    no_recording: NoRecording = False
    video: Video = False
    plots: Plots = "png"
    strict: Strictly = False
    verdict: ShowVerdict = False

    @property
    def save_options(self) -> Saved:
        """The options of the result's method ``save``."""
        return {
            "force": self.force,
            "recording": not self.no_recording,
            "video": self.video,
            "plots": self.plots,
        }


@dataclass(frozen=True)
class LanguageOptions:
    """Options for running a program in the language of a robot, such as RAPID."""

    robot: Annotated[
        str | None,
        typer.Option(
            metavar="ROBOT",
            help=message(
                "cli.help_language_robot",
                "Robot that runs a RAPID module: alone, or a robot of the station --on.",
            ),
        ),
    ] = None
    on: Annotated[
        str | None,
        typer.Option(
            "--on",
            metavar="STATION",
            help=message("cli.help_language_on", "Station in which a RAPID module runs."),
        ),
    ] = None
    io: Annotated[
        Path | None,
        typer.Option(
            "--io",
            metavar="FILE",
            help=message(
                "cli.help_language_io", "Table with the meanings of the signals of a RAPID module."
            ),
        ),
    ] = None
    cycles: Annotated[
        int,
        typer.Option(
            min=1,
            help=message(
                "cli.help_language_cycles", "Repetitions of WHILE TRUE in a RAPID module."
            ),
        ),
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
                "cli.help_language_allow_losses",
                "Accept a RAPID or Simulink import even if parts of it are lost.",
            ),
        ),
    ] = False


Decorator: TypeAlias = Callable[[Callable[..., Any]], Callable[..., Any]]
"""Function that makes another command of a command."""


def _option_parameter(name: str, annotation: Any, default: Any) -> inspect.Parameter:
    """Make a parameter of a command, which typer turns into an option.

    Args:
        name: name of the parameter.
        annotation: its type, with typer's options.
        default: its default value.
    """
    return inspect.Parameter(
        name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation
    )


def _parameters_of(group: type[Any]) -> list[inspect.Parameter]:
    """Make the parameters of a command for the options of a group, a dataclass."""
    # The extras are typer's options in the annotations, which Python would drop.
    annotations = get_type_hints(group, include_extras=True)
    return [
        _option_parameter(option.name, annotations[option.name], option.default)
        for option in fields(group)
    ]


def with_group(group: type[Any], name: str) -> Decorator:
    """Make a decorator that gives a command the options of a group.

    Args:
        group: dataclass of the options.
        name: parameter of the command that takes an object of this class.
    """
    parameters = _parameters_of(group)

    def with_options(command: Callable[..., Any]) -> Callable[..., Any]:
        """Wrap a command in a function that has a parameter for each option, and collects their values."""

        @wraps(command)
        def call(**arguments: Any) -> Any:
            # Typer passes every option, with its default value if the user has not given it.
            values = {parameter.name: arguments.pop(parameter.name) for parameter in parameters}
            return command(**arguments, **{name: group(**values)})

        _set_signature(call, _signature(command, name, parameters))
        return call

    return with_options


def _set_signature(function: Callable[..., Any], signature: inspect.Signature) -> None:
    """Set the signature that Python's inspect, and so typer, sees of a function."""
    # functools.wraps has copied the signature of the command itself, which has no parameter for each option.
    vars(function)["__signature__"] = signature


with_saving = with_group(Saving, "saving")
"""Decorator that gives a command the options of :class:`Saving`."""

with_language = with_group(LanguageOptions, "language")
"""Decorator that gives a command the options of :class:`LanguageOptions`."""


def flag_of(name: str) -> str:
    """Option of the command line for a name of Python: ``--drop-loops`` for ``drop_loops``, ``--all`` for ``all_``."""
    return f"--{name.rstrip('_').replace('_', '-')}"


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
        return options_class(
            **{field.name: self.values[field.name] for field in fields(options_class)}
        )

    def refuse_all_but(self, allowed_classes: Collection[type[Any]]) -> None:
        """Check that only options of some groups are given. An option with its default value counts as not given.

        Args:
            allowed_classes: dataclasses of these groups. If there are none, no option may be given.

        Raises:
            Unsuitable: an option of another group is given; the message says to what it belongs.
        """
        allowed = set[str]()
        for options_class in allowed_classes:
            allowed |= {field.name for field in fields(options_class)}
        for group in self.groups:
            for field in fields(group.options_class):
                # Typer passes defaults like given values, so this is the only sign that the user has given an option.
                is_default = self.values[field.name] == field.default
                if not is_default and field.name not in allowed:
                    raise Unsuitable(
                        flag_of(field.name),
                        message(
                            "cli.belongs_to", "the option belongs to {owner}", owner=group.owner
                        ),
                    )


def with_groups(groups: Sequence[OptionGroup], name: str) -> Decorator:
    """Make a decorator that gives a command the options of several groups.

    If groups have fields of the same name, the command has one option for all of them, as the first group defines it.

    Args:
        groups: the groups of options.
        name: parameter of the decorated function that takes the chosen options, :class:`ChosenOptions`.
    """
    parameters = dict[str, inspect.Parameter]()
    for group in groups:
        for parameter in _parameters_of(group.options_class):
            # Two importers may have an option of the same name, and typer refuses a second one.
            parameters.setdefault(parameter.name, parameter)

    def with_options(command: Callable[..., Any]) -> Callable[..., Any]:
        """Wrap a command's function in one that has a parameter for each option, and collects their values."""

        @wraps(command)
        def call(**arguments: Any) -> Any:
            values = {option: arguments.pop(option) for option in parameters}
            return command(**arguments, **{name: ChosenOptions(groups, values)})

        _set_signature(call, _signature(command, name, list(parameters.values())))
        return call

    return with_options


def _signature(
    command: Callable[..., Any], name: str, instead: list[inspect.Parameter]
) -> inspect.Signature:
    """Make the signature of a command in which one parameter is replaced by others. All become keyword parameters.

    Args:
        command: the command.
        name: name of the parameter that is replaced. If the command has none of this name, such as "", it keeps all of
            its parameters, and `instead` is not used.
        instead: parameters that take its place.

    Returns:
        the signature, without the type of the returned value, which typer does not need.
    """
    parameters = list[inspect.Parameter]()
    for parameter in inspect.signature(command, eval_str=True).parameters.values():
        # The new options take the position of the parameter, so that the help lists them there.
        if parameter.name == name:
            parameters += instead
        else:
            parameters.append(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY))
    return inspect.Signature(parameters)


def with_mesh_path(command: Callable[..., Any]) -> Callable[..., Any]:
    """Decorator that gives a command the option ``--mesh-path``. It holds for all files that the command loads."""

    @wraps(command)
    def call(*, mesh_path: list[Path] | None = None, **options: Any) -> Any:
        # The grant ends with the command: in one process, as in a test, the next command must ask for it again.
        with granting(mesh_path or ()):
            return command(**options)

    own = _option_parameter("mesh_path", MeshPath, None)
    signature = _signature(command, "", [])
    _set_signature(call, signature.replace(parameters=[*signature.parameters.values(), own]))
    return call


def with_import_options(*names: str) -> Decorator:
    """Make a decorator that gives a command options for an import, and their helps.

    The command takes them together as its parameter ``options``, which is None if all have their default values.

    Args:
        *names: names of the options, fields of :class:`ImportOptions`. Without names, the command has all of them.
    """
    chosen_names = names or tuple(ImportOptions.model_fields)
    # The helps come from the class of the options, so that a station's file and the command line have the same ones.
    helps = import_option_messages()
    parameters = [
        _import_parameter(name, ImportOptions.model_fields[name], helps[name])
        for name in chosen_names
    ]

    def with_options(command: Callable[..., Any]) -> Callable[..., Any]:
        """Wrap a command in a function that has a parameter for each option, and collects their values."""

        @wraps(command)
        def call(**arguments: Any) -> Any:
            values = {name: arguments.pop(name) for name in chosen_names}
            # An option that is not given takes the default of the class.
            content = {name: value for name, value in values.items() if value is not None}
            options = validate_section(
                ImportOptions, content, message("cli.import_options", "import options")
            )
            # The import may read the folders of --mesh-path.
            with granting(options.mesh_path):
                return command(**arguments, options=None if options == ImportOptions() else options)

        _set_signature(call, _signature(command, "options", parameters))
        return call

    return with_options


def import_option_messages() -> dict[str, Message]:
    """Helps of the options of an import, by name: the docstrings below the fields of :class:`ImportOptions`."""
    texts = field_texts(ImportOptions)
    return {
        name: Message(f"cli.import_{name}", texts[name], {}) for name in ImportOptions.model_fields
    }


def _import_parameter(name: str, field: FieldInfo, text: str) -> inspect.Parameter:
    """Make the parameter of a command for an option of an import.

    Args:
        name: name of the field of :class:`ImportOptions`.
        field: the field. Its type decides the form of the option.
        text: help of the option.
    """
    flag = flag_of(name)
    # None means "not given" for all options but the last ones, whose type has no None.
    default: Any = None
    annotation: Any
    if field.annotation == tuple[Path, ...]:
        annotation = MeshPath
    elif field.annotation == tuple[str, ...]:
        # The form "NAME:=VALUE" is that of xacro itself.
        form = "NAME=FOLDER" if name == "packages" else "NAME:=VALUE"
        several = join_texts(
            [text, message("cli.help_several", "May be given several times.")], " "
        )
        annotation = Annotated[list[str] | None, typer.Option(flag, metavar=form, help=several)]
    elif Path in get_args(field.annotation):
        file_option = typer.Option(flag, metavar="FILE", resolve_path=True, help=text)
        annotation = Annotated[Path | None, file_option]
    elif get_args(field.annotation) == get_args(Pose):
        pose_option = typer.Option(flag, metavar="X Y Z RZ RY RX", help=text)
        annotation = Annotated[tuple[float, float, float, float, float, float] | None, pose_option]
    else:
        annotation = Annotated[field.annotation, typer.Option(flag, help=text)]
        default = field.default
    return _option_parameter(name, annotation, default)
