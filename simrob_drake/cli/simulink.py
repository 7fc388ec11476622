"""What `simrob import` and `simrob check` do with a Simulink model, `simrob fmu`, and `simrob serve`."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.text import Text

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.cli import ExitCode
from simrob_drake.cli.arguments import refuse, refuse_import
from simrob_drake.cli.options import with_group
from simrob_drake.cli.screen import console, errors, say, table
from simrob_drake.cli.tables import report_table
from simrob_drake.importer.options import ImportOptions

if TYPE_CHECKING:
    from simrob_drake.extensions.simulink.simulink_model import SimulinkModel

SUFFIXES = (".slx", ".mdl", ".slxp", ".mdlp")


@dataclass(frozen=True)
class ModelReading:
    """How a Simulink model is read."""

    library: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="DIR",
            exists=True,
            file_okay=False,
            help="A folder with libraries of a Simulink model; may be given often.",
        ),
    ] = None
    variables: Annotated[
        list[Path] | None,
        typer.Option(metavar="FILE", help="Variables of a Simulink model: .mat, or an .m of assignments."),
    ] = None
    assume: Annotated[
        bool,
        typer.Option(
            "--assume",
            help="Take variables that a Simulink model lacks from files beside it, or defaults.",
        ),
    ] = False
    octave: Annotated[
        bool,
        typer.Option("--octave", help="Run a Simulink model's own MATLAB code in GNU Octave: for models you trust."),
    ] = False


@dataclass(frozen=True)
class ModelImport(ModelReading):
    """How a Simulink model is read, and what is made of it."""

    servos: Annotated[
        bool,
        typer.Option("--servos", help="Let laws of a Simulink model that come to a PID be servos, not a signal flow."),
    ] = False
    contact_law: Annotated[
        bool, typer.Option("--contact-law", help="Let spheres of a Simulink model touch planes by Simscape's own law.")
    ] = False


_SHOWN = 5  # losses that are told on the screen

with_model_reading, with_model_import = with_group(ModelReading, "reading"), with_group(ModelImport, "reading")
"""Give a command the options of either class."""


def is_model_file(file: str | Path) -> bool:
    """Tell whether an argument is a Simulink model, or a CAD assembly exported for Simscape Multibody."""
    suffix = Path(file).suffix.lower()
    if suffix != ".xml":
        return suffix in SUFFIXES
    from simrob_drake.extensions.simulink.cad.assembly import is_export

    return is_export(Path(file))


def refuse_model(reading: ModelReading, **others: Any) -> None:
    """Refuse options that go with a Simulink model."""
    refuse("given with a Simulink model only", **asdict(reading), **others)


def model_options(options: ImportOptions | None, reading: ModelReading, set_: list[str] | None) -> dict[str, Any]:
    """Return the options of reading a model.

    Raises InvalidParameter: a setting that is none, a file of variables that cannot be read, or a choice that only the
    import of a URDF has.
    """
    chosen = options or ImportOptions()
    refuse_import("left out with a Simulink model", chosen.model_copy(update={"mesh_path": ()}))
    from simrob_drake.extensions.simulink.reading.model_file import Libraries
    from simrob_drake.extensions.simulink.values.workspace import variables_of

    read, settings = asdict(reading), dict[str, str]()
    libraries, files = tuple(read.pop("library") or ()), read.pop("variables") or []
    for setting in set_ or []:
        name, equals, value = setting.partition("=")
        if not (equals and all(part.isidentifier() for part in name.strip().split("."))):
            raise InvalidParameter("--set", setting, "of the form NAME=VALUE, as q0=[0 0 0] or tool.mass=1")
        settings[name.strip()] = value
    places = Libraries([*(file.parent for file in files), *libraries])
    return {
        "libraries": libraries,
        "meshes": chosen.mesh_path,
        "variables": variables_of(settings, files, places),
        **read,
    }


def import_model(
    file: Path, out: Path | None, options: dict[str, Any], *, force: bool, allow_losses: bool = False
) -> ExitCode:
    """Write the robots, pieces and station of a model, and tell what became of its blocks."""
    from simrob_drake.extensions.simulink.importing import import_simulink, lost_mechanics
    from simrob_drake.importer.options import REPORT_FILE

    folder = out or Path(f"{file.stem}_imported")
    with errors.status(Text(f"importing {file}")):
        imported = import_simulink(file, folder, force=force, **options)
    say(imported.fidelity)
    _tell(imported.model)
    for name, robot in imported.files.robots.items():
        joints = ", ".join(robot.axes.values())
        say(f"robot   {name}: {joints}")
    if imported.files.pieces:
        say(f"pieces  {', '.join(imported.files.pieces)}")
    if imported.station is not None:
        say(f"station {imported.station}")
        say(f"next    simrob run {imported.station}")
    lost = lost_mechanics(imported.outcomes)
    for outcome in lost[:_SHOWN]:
        errors.print(Text(f"lost: {outcome.path}: {outcome.text or outcome.noun}"), soft_wrap=True)
    if lost and not allow_losses:
        more = f"{len(lost) - _SHOWN} more in {REPORT_FILE}; " if len(lost) > _SHOWN else ""
        errors.print(f"{more}the station moves otherwise; --allow-losses takes it as it is", highlight=False)
        return ExitCode.BEYOND
    return ExitCode.DONE


def examine_model(file: Path, options: dict[str, Any]) -> None:
    """Report on a model without writing anything."""
    from simrob_drake.extensions.simulink.importing import check_importable
    from simrob_drake.extensions.simulink.simulink_model import read_simulink

    with errors.status(Text(f"reading {file}")):
        model = read_simulink(file, **options)
    if model.findings.undefined:
        rows = [
            (Text(name), Text("; ".join(places[:4]) + (" …" if len(places) > 4 else "")))
            for name, places in model.findings.undefined.items()
        ]
        console.print(table(("variable that only MATLAB knows", "where it is used"), *rows, numbers=False))
    _tell(model)
    check_importable(model)


def _tell(model: "SimulinkModel") -> None:
    joints = len(model.bodies.links)
    counts = f"{len(model.expanded.nodes)} blocks, {len(model.bodies.bodies)} bodies, {joints} joints"
    console.print(report_table(model.report))
    say(f"{model.path.name}: {counts}; {model.report.summary()}")
