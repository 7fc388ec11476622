"""What is taken away of what was taught and run: files in the folder of the program."""

from collections.abc import Callable, Mapping
from concurrent.futures import Future
from pathlib import Path
from shutil import copyfile
from tempfile import TemporaryDirectory
from typing import Any
from zipfile import ZIP_DEFLATED, ZipFile

from simrob_drake.base.errors import SimrobError
from simrob_drake.base.folders import writing
from simrob_drake.extensions.pendant.move_runner import Commands
from simrob_drake.extensions.pendant.pages.words import Notice
from simrob_drake.extensions.pendant.program_book import ProgramBook
from simrob_drake.extensions.pendant.run_client import RunClient, done
from simrob_drake.parts.controllers.own import OwnController
from simrob_drake.programs.script import script
from simrob_drake.programs.whole_program import goes_on_legs
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.file_paths import with_copied_files
from simrob_drake.stations.load import station_names, station_yaml


class Exports:
    """Writes files; each method gives a future with the file, or None of what was wrong."""

    def __init__(self, client: RunClient, book: ProgramBook, commands: Commands) -> None:
        """Prepare for a program, and for what the client runs."""
        self._client, self._book, self._commands = client, book, commands

    def program(self) -> Future[Any]:
        """Write the program as YAML that ``simrob run`` takes, beside it the station if it has settings."""
        book = self._book
        program = book.store.placed(book.whole_program(), book.settings)

        def write() -> None:
            book.conflict = not book.store.write(program)

        return self._written(book.file, write)

    def script(self) -> Future[Any]:
        """Write the program as a Python script that runs by itself and gives the same signals.

        One of a station that is a file goes into a ZIP, with all that it reads.
        """
        book = self._book
        program, file = book.whole_program(), book.file.with_suffix(".py")
        legs = bool(book.robot) and goes_on_legs(book.model, program)
        code = any(isinstance(one, OwnController) for one in book.config.controllers.values())

        def text(station: str, settings: Mapping[str, Any], folder: Path) -> str:
            where: dict[str, Any] = {"robot": book.one_of_several, "file": folder / file.name}
            return script(program, station, settings, legs=legs, code=code, **where)

        if book.station in station_names():
            own = text(book.station, book.settings, file.parent)
            return self._written(file, lambda: book.store.make(file, own))
        packed = file.with_suffix(".zip")
        return self._written(
            packed, lambda: _pack(packed, book.config, lambda one: text(str(one), {}, one.parent))
        )

    def station(self) -> Future[Any]:
        """Write the station with its settings as YAML."""
        file, text = self._book.store.station_file, station_yaml(self._book.config)
        return self._written(file, lambda: self._book.store.make(file, text))

    def csv(self) -> Future[Any]:
        """Write the signals of the last run."""
        return self._of_run("signals", ".csv")

    def recording(self) -> Future[Any]:
        """Write the last run as one HTML page."""
        return self._of_run("page", ".html")

    def film_strip(self) -> Future[Any]:
        """Draw the last run as a strip of pictures, for who cannot see the view."""
        return self._of_run("strip", ".png", quietly=True)

    def _written(self, file: Path, write: Callable[[], object]) -> Future[Any]:
        book, client = self._book, self._client
        try:
            write()
        except SimrobError as problem:
            client.wrong(problem)
            return done(None)
        if book.conflict and file == book.file:
            client.refuse("conflict", file=file.name)
            return done(None)
        client.say(Notice("exported", {"file": str(file)}))
        book.save()  # and tell what was put aside
        return done(file)

    def _of_run(self, what: str, suffix: str, *, quietly: bool = False) -> Future[Any]:
        file, commands = self._book.file.with_suffix(suffix), self._commands

        def written(_: Any) -> Path:
            if not quietly:
                self._client.say(Notice("exported", {"file": str(file)}))
            return file

        return commands.queued(
            what,
            lambda: commands.travel("save", written, phase="saving", what=what, file=str(file)),
        )


def _pack(file: Path, config: StationConfig, script: Callable[[Path], str]) -> None:
    """Write a ZIP of a script, the station that it runs, and copies of what that names; ``script`` gives its text.

    Raises OutputError: the disk does not take it.
    """
    with writing(file), TemporaryDirectory(dir=file.parent) as place:
        folder = Path(place)
        station = folder / f"{file.stem}-station.yaml"
        station.write_text(
            station_yaml(_with_code(with_copied_files(config, folder), folder)), encoding="utf-8"
        )
        (folder / f"{file.stem}.py").write_text(script(station), encoding="utf-8")
        files = [one for one in sorted(folder.rglob("*")) if one.is_file()]
        with ZipFile(folder / file.name, "w", ZIP_DEFLATED) as packed:
            for one in files:
                packed.write(one, Path(file.stem) / one.relative_to(folder))
        (folder / file.name).replace(file)


def _with_code(config: StationConfig, folder: Path) -> StationConfig:
    """Return a station that names copies of its own blocks' files in a folder, by paths from there."""
    controllers = dict(config.controllers)
    for name, section in controllers.items():
        if (
            isinstance(section, OwnController)
            and (file := Path(section.class_.partition(":")[0])).suffix == ".py"
        ):
            copy = Path(name, file.name)
            (folder / name).mkdir()
            copyfile(file, folder / copy)
            named = f"{copy.as_posix()}:{section.class_.partition(':')[2]}"
            controllers[name] = section.model_copy(update={"class_": named})
    return config.model_copy(update={"controllers": controllers})
