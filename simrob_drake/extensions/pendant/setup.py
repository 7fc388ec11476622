"""The station that is taught on: its settings, by which it is opened anew, and what is asked about it."""

from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from typing import Any

from simrob_drake.base.messages import SOURCE_LANGUAGE
from simrob_drake.extensions.pendant.describe import value_of
from simrob_drake.extensions.pendant.move_runner import MoveRunner
from simrob_drake.extensions.pendant.program_book import ProgramBook
from simrob_drake.extensions.pendant.run_client import RunClient
from simrob_drake.stations.change_of_kind import settings_with
from simrob_drake.stations.feedback_loops import settings_with_loop
from simrob_drake.stations.load import station_content


class Setup:
    """Changes the station while nothing runs; tells by True or False whether it was done."""

    def __init__(self, client: RunClient, book: ProgramBook, runner: MoveRunner) -> None:
        """Begin with the book's station."""
        self._client, self._book, self._runner = client, book, runner

    def value(self, key: str) -> Any:
        """Return what the station has under a dotted key, settings counted in; None if nothing."""
        return value_of(station_content(self._book.config), key)

    def set(self, key: str, value: Any) -> bool:
        """Change a setting of the station and open the station anew.

        A new kind of a section, such as of the reference, removes the settings that were made for its old kind.

        Args:
            key: dotted key of the setting, such as ``servo.kp``.
            value: the new value; None removes an entry, such as a piece.

        Returns:
            whether the station could be opened.
        """
        return self.set_all({key: value})

    def set_all(self, changes: Mapping[str, Any]) -> bool:
        """Change several settings of the station, by their dotted keys, and open the station anew once.

        Returns:
            whether the station could be opened.
        """
        return self._open_with(settings_with(self._book.settings, dict(changes)))

    def unset(self, key: str) -> bool:
        """Take a setting back."""
        return self._open_with(
            {other: value for other, value in self._book.settings.items() if other != key}
        )

    def switch_loop(self, name: str, on: bool) -> bool:
        """Switch an outer loop of the station on or off."""
        book = self._book
        settings = self._client.or_wrong(
            lambda: settings_with_loop(book.known_loops, book.settings, name, on)
        )
        return settings is not None and self._open_with(settings)

    def check(self) -> Future[Any]:
        """Give what ``simrob check`` says of the station with its settings."""
        return self._client.ask("check")

    def picture(self, folded: Sequence[str] = (), language: str = SOURCE_LANGUAGE) -> Future[Any]:
        """Give the block picture as SVG, in a language, with the subsystems of some blocks folded."""
        return self._client.ask("picture", folded=list(folded), language=language)

    def loop_picture(self, name: str, language: str = SOURCE_LANGUAGE) -> Future[Any]:
        """Give as SVG in a language what a loop reads and moves, be it on or off."""
        book = self._book
        settings = settings_with_loop(book.known_loops, book.settings, name, True)
        how: dict[str, Any] = {
            "station": book.station,
            "settings": settings,
            "allow_code": book.allow_code,
        }
        return self._client.ask("loop_picture", name=name, language=language, **how)

    def _open_with(self, settings: dict[str, Any]) -> bool:
        book = self._book
        if self._client.phase not in ("opening", "idle", "gone"):
            return self._client.refuse("busy")
        config = self._client.or_wrong(lambda: book.loaded(settings))
        if config is None:
            return False
        before, book.config = book.config, config
        book.record(book.history.present.replaced(settings=settings))
        taken = book.history.present
        self._client.run.compare_last()

        def refused() -> None:
            if book.history.present is taken:
                book.history.withdraw()
                book.config = before
                book.save()
            self._runner.commands.set_phase("idle")

        self._runner.reopen(refused)
        return True
