"""The importer of Drake's scene files: model directives and scenarios."""

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import typer

from simrob_drake.base.files import open_regular
from simrob_drake.base.folders import cache_entry, filled_at_once
from simrob_drake.base.messages import message
from simrob_drake.importer.importer import FileImporter, ImportOutcome, ImportRequest, SceneRequest
from simrob_drake.robots.imports import REPORT_FILE

if TYPE_CHECKING:  # the options are needed for the help, and Drake's loader takes long to import
    from simrob_drake.extensions.drake_scenes.scene_station import SceneStation

SECTIONS_FILE = "sections.json"
"""File in an entry of the cache with the sections of the station."""


@dataclass(frozen=True)
class SceneReading:
    """Options for reading a scene."""

    scenario: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help=message(
                "drake_scenes.help_which_scenario",
                "Which scenario of a file with several, for scenes of Drake.",
            ),
        ),
    ] = None


class SceneImporter(FileImporter):
    """Makes a folder of robots, pieces and a station from model directives or a scenario."""

    title: ClassVar[str] = message("drake_scenes.a_scene", "a scene of Drake")
    options_class: ClassVar[type[Any]] = SceneReading
    reading_class: ClassVar[type[Any]] = SceneReading
    robot_options: ClassVar[tuple[str, ...]] = ("mesh_path", "packages")
    has_scenes: ClassVar[bool] = True

    def import_file(self, file: Path, request: ImportRequest) -> ImportOutcome:
        """Write the robots, pieces and station of a scene.

        Args:
            file: the scene.
            request: request of the user, with `SceneReading` as its options.

        Raises:
            SimrobError: the scene cannot be loaded, or no station can be made of it.
        """
        folder = request.out or Path(f"{_stem(file)}_imported")
        with filled_at_once(folder, marker=REPORT_FILE, force=request.force) as work:
            made = _write(file, _scene_request(request), work)
            _write_station_file(made, work, file)
        station = folder / f"{_stem(file)}.yaml"
        return _outcome(made, file, (f"station {station}", f"next    simrob run {station}"))

    def examine(self, file: Path, request: ImportRequest) -> ImportOutcome:
        """Report what would become of a scene. Arguments and errors are those of `import_file`."""
        with TemporaryDirectory(prefix="simrob-") as work:
            made = _write(file, _scene_request(request), Path(work))
        return _outcome(made, file, ())

    def station_sections(self, file: Path, request: SceneRequest) -> dict[str, Any]:
        """Make the sections of a station. The robots and pieces are written to the cache, unless they are there.

        Arguments and errors are those of the base class.
        """
        with TemporaryDirectory(prefix="simrob-") as work:
            made = _write(file, request, Path(work))
            entry = cache_entry(
                "scenes",
                made_of=_contents(Path(work), made.sections),
                made_by=[Path(__file__).parent],
            )
            if not (entry / SECTIONS_FILE).is_file():
                with filled_at_once(entry, marker=SECTIONS_FILE, force=True) as target:
                    _write(file, request, target)
                    (target / SECTIONS_FILE).write_text(json.dumps(made.sections), encoding="utf-8")
        return {"name": _stem(file), **_with_folder(made.sections, entry)}


def _write(file: Path, request: SceneRequest, folder: Path) -> "SceneStation":
    """Load a scene, and write its robots and pieces to a folder."""
    from simrob_drake.extensions.drake_scenes.scene_files import load_scene
    from simrob_drake.extensions.drake_scenes.scene_station import write_station

    made = write_station(load_scene(file, request), folder)
    report = json.dumps(made.report.as_json(), indent=2, ensure_ascii=False)
    (folder / REPORT_FILE).write_text(report + "\n", encoding="utf-8")
    return made


def _scene_request(request: ImportRequest) -> SceneRequest:
    """Translate the options of a command."""
    return SceneRequest(
        packages=request.robot_options.package_folders,
        mesh_path=request.robot_options.mesh_path,
        scenario=request.options.scenario or "",
    )


def _write_station_file(made: "SceneStation", folder: Path, source: Path) -> None:
    """Write the station's file into the folder of an import."""
    from simrob_drake.extensions.drake_scenes.tagged import yaml_text

    header = (
        f"# From the scene {source.name} of Drake; report.json says what became of its parts.\n"
    )
    text = header + yaml_text(
        {"description": f"{_stem(source)}, from a scene of Drake", **made.sections}
    )
    (folder / f"{_stem(source)}.yaml").write_text(text, encoding="utf-8")


def _outcome(made: "SceneStation", file: Path, lines: tuple[str, ...]) -> ImportOutcome:
    """Describe the result of an import, for the screen."""
    robots = ", ".join(made.sections.get("robots", {})) or "-"
    pieces = ", ".join(made.sections.get("pieces", {})) or "-"
    counts = (f"{file.name}: {made.report.summary()}", f"robots  {robots}", f"pieces  {pieces}")
    losses = tuple(f"{entry.element}: {entry.text}" for entry in made.report.of("lost"))
    return ImportOutcome(lines=(*counts, *lines), report=made.report, losses=losses)


def _stem(file: Path) -> str:
    """Name of a scene: that of its file up to the first dot."""
    return file.name.partition(".")[0]


def _contents(folder: Path, sections: Mapping[str, Any]) -> Iterator[bytes]:
    """Yield all that the written files and the sections of a station consist of, for the key of the cache."""
    yield json.dumps(sections).encode()
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            yield str(path.relative_to(folder)).encode()
            with open_regular(path) as content:  # meshes may be larger than what is read of texts
                yield hashlib.file_digest(content, "sha256").digest()


def _with_folder(sections: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Copy the sections of a station, with the files of robots and pieces as absolute paths."""
    result = dict(sections)
    for kind in ("robots", "pieces"):
        if kind in result:
            result[kind] = {
                name: {**entry, "model": str(folder / entry["model"])}
                for name, entry in result[kind].items()
            }
    return result
