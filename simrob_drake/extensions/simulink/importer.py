"""The importer of Simulink models with Simscape Multibody, and of CAD assemblies exported for it."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import typer

from simrob_drake.base.errors import InvalidModel, InvalidParameter
from simrob_drake.base.messages import compound, message
from simrob_drake.importer.importer import FileImporter, ImportOutcome, ImportRequest

if TYPE_CHECKING:  # the readers load much, and options are needed for the help
    from simrob_drake.extensions.simulink.simulink_model import SimulinkModel


@dataclass(frozen=True)
class ModelReading:
    """Options for reading a Simulink model."""

    library: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="DIR",
            exists=True,
            file_okay=False,
            help=message(
                "simulink.help_modelreading_library",
                "A folder with libraries of a Simulink model; may be given often.",
            ),
        ),
    ] = None
    variables: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE",
            help=message(
                "simulink.help_modelreading_variables",
                "Variables of a Simulink model: .mat, or an .m of assignments.",
            ),
        ),
    ] = None
    assume: Annotated[
        bool,
        typer.Option(
            "--assume",
            help=message(
                "simulink.help_modelreading_assume",
                "Take variables that a Simulink model lacks from files beside it, or defaults.",
            ),
        ),
    ] = False
    octave: Annotated[
        bool,
        typer.Option(
            "--octave",
            help=message(
                "simulink.help_modelreading_octave",
                "Run a Simulink model's own MATLAB code in GNU Octave: for models you trust.",
            ),
        ),
    ] = False


@dataclass(frozen=True)
class ModelImport(ModelReading):
    """Options for reading a Simulink model, and for the station that is made of it."""

    servos: Annotated[
        bool,
        typer.Option(
            "--servos",
            help=message(
                "simulink.help_modelimport_servos",
                "Let laws of a Simulink model that come to a PID be servos, not a signal flow.",
            ),
        ),
    ] = False
    contact_law: Annotated[
        bool,
        typer.Option(
            "--contact-law",
            help=message(
                "simulink.help_modelimport_contact_law",
                "Let spheres of a Simulink model touch planes by Simscape's own law.",
            ),
        ),
    ] = False


class SimulinkImporter(FileImporter):
    """Makes a folder of robots, pieces and a station from a Simulink model or a CAD assembly."""

    title: ClassVar[str] = message("simulink.a_simulink_model", "a Simulink model")
    options_class: ClassVar[type[Any]] = ModelImport
    reading_class: ClassVar[type[Any]] = ModelReading
    robot_options: ClassVar[tuple[str, ...]] = ("mesh_path",)
    takes_settings: ClassVar[bool] = True

    def import_file(self, file: Path, request: ImportRequest) -> ImportOutcome:
        """Write the robots, pieces and station of a model, and report what became of its blocks.

        Args:
            file: the model.
            request: request of the user, with `ModelImport` as its options.

        Returns:
            the outcome. Its losses are the blocks without which the mechanics move differently.

        Raises:
            SimrobError: the model cannot be read, or no station can be made of it.
        """
        from simrob_drake.extensions.simulink.importing import import_simulink, lost_mechanics

        folder = request.out or Path(f"{file.stem}_imported")
        imported = import_simulink(file, folder, force=request.force, **reading_arguments(request))
        lines = [_summary(imported.model)]
        for name, robot in imported.files.robots.items():
            joints = ", ".join(robot.axes.values())
            lines.append(
                message("simulink.robot_line", "robot   {name}: {joints}", name=name, joints=joints)
            )
        if imported.files.pieces:
            pieces = ", ".join(imported.files.pieces)
            lines.append(message("simulink.pieces_line", "pieces  {pieces}", pieces=pieces))
        if imported.station is not None:
            lines += [
                message("simulink.station_line", "station {file}", file=imported.station),
                message("simulink.next_line", "next    simrob run {file}", file=imported.station),
            ]
        lost = lost_mechanics(imported.outcomes)
        losses = tuple(
            compound("{path}: {loss}", path=outcome.path, loss=outcome.text or outcome.noun)
            for outcome in lost
        )
        return ImportOutcome(
            headline=imported.fidelity,
            lines=tuple(lines),
            report=imported.model.report,
            losses=losses,
        )

    def examine(self, file: Path, request: ImportRequest) -> ImportOutcome:
        """Report what would become of a model's blocks, and which variables it lacks.

        Args:
            file: the model.
            request: request of the user, with `ModelReading` as its options.

        Returns:
            the outcome. It has a problem if no station can be made of the model.

        Raises:
            SimrobError: the model cannot be read.
        """
        from simrob_drake.extensions.simulink.importing import check_importable
        from simrob_drake.extensions.simulink.simulink_model import read_simulink

        model = read_simulink(file, **reading_arguments(request))
        problem = None
        try:
            check_importable(model)
        except InvalidModel as error:  # the caller raises it after it has shown the report
            problem = error
        return ImportOutcome(
            lines=(_summary(model),),
            report=model.report,
            unknowns=model.findings.undefined,
            problem=problem,
        )


def reading_arguments(request: ImportRequest) -> dict[str, Any]:
    """Translate options of a command into arguments of ``read_simulink`` and ``import_simulink``.

    Args:
        request: request of the user. Options of `ModelImport` that `ModelReading` lacks are arguments of
            ``import_simulink`` only.

    Raises:
        InvalidParameter: a setting is not of the form NAME=VALUE, or a file of variables cannot be read.
    """
    from simrob_drake.extensions.simulink.reading.model_file import Libraries
    from simrob_drake.extensions.simulink.values.workspace import variables_of

    # Most options are arguments of the same name. Those for libraries and variables are converted.
    arguments = asdict(request.options)
    libraries = tuple(arguments.pop("library") or ())
    variable_files = arguments.pop("variables") or []
    settings = dict[str, str]()
    for setting in request.settings:
        name, equals, value = setting.partition("=")
        if not (equals and all(part.isidentifier() for part in name.strip().split("."))):
            raise InvalidParameter(
                "--set",
                setting,
                message(
                    "simulink.name_and_value",
                    "of the form NAME=VALUE, as q0=[0 0 0] or tool.mass=1",
                ),
            )
        settings[name.strip()] = value
    # A script of variables may name other files: those next to a file of variables, or in a library.
    folders = Libraries([*(file.parent for file in variable_files), *libraries])
    return {
        "libraries": libraries,
        "meshes": request.robot_options.mesh_path,
        "variables": variables_of(settings, variable_files, folders),
        **arguments,
    }


def _summary(model: "SimulinkModel") -> str:
    """Describe a model in one line: the counts of its parts, and of what was changed."""
    joints = len(model.bodies.links)  # the joints that connect the bodies
    return message(
        "simulink.summary_of_model",
        "{file}: {blocks} blocks, {bodies} bodies, {joints} joints; {changes}",
        file=model.path.name,
        blocks=len(model.expanded.nodes),
        bodies=len(model.bodies.bodies),
        joints=joints,
        changes=model.report.summary(),
    )
