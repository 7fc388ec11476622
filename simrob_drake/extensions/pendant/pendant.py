"""What all tabs of the pendant share: what is taught, the view of it, and how the pages look."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from simrob_drake.base.errors import one_of
from simrob_drake.base.messages import message
from simrob_drake.extensions.pendant.own_files import keep, report_of
from simrob_drake.extensions.pendant.pages.words import languages
from simrob_drake.extensions.pendant.session import Session
from simrob_drake.extensions.pendant.tours import TourProgress, tours
from simrob_drake.results.animation.window import Board

_SCRIPT = Path(__file__).parent / "pages" / "hand.js"
_FAR = 1e6  # m or deg; nobody drags farther

Opener = Callable[[str | Path, str | None], Session]
"""Opens a subject, and of a station with several robots the one that is to be taught."""


@dataclass
class PushFields:
    """Fields of the pad for pushes, which a page that is loaded again shows.

    Attributes:
        is_open: whether the pad is unfolded.
        body: name of the chosen body; None until one was chosen.
        force: size of the force [N]; None if the field is empty.
        duration: duration of a push [s]; None if the field is empty.
    """

    is_open: bool = False
    body: str | None = None
    force: float | None = 10.0
    duration: float | None = 0.1


class Pendant:
    """One session at a time, and the view that is told of it.

    Attributes:
        session: of what is taught now.
        board: the view in three dimensions.
        language: of pages that name none.
        tours: the lessons, and ``tour``: the one that is under way.
        dark: whether the pages are dark; None: as the browser likes it.
        tab: name of the tab that is in front, which a page that is loaded again shows. None until one was shown.
        tab_kind: kind of robot for which the tab was shown.
        push: the fields of the pad for pushes, as the user left them.
    """

    def __init__(
        self,
        open_session: Opener,
        subject: str | Path,
        *,
        language: str = "en",
        lessons: Path | None = None,
    ) -> None:
        """Open the first subject; ``lessons`` is a folder with more of them.

        Raises SimrobError: no such subject or language, or a damaged lesson.
        """
        self.dark: bool | None = None
        self.tab: str | None = None
        self.tab_kind = ""
        self.push = PushFields()
        self.tours, self.tour = tours(lessons), cast(TourProgress | None, None)
        self.language = one_of(message("pendant.language", "language"), language, languages())
        self._open_session = open_session
        self.session = open_session(subject, None)
        self.board = Board(
            script=_SCRIPT, hears={"drag": self._drag, "put": self._put, "turn": self._turn}
        )
        self._begin()

    def load(self, subject: str | Path, robot: str | None = None) -> bool:
        """Open another subject, or another robot of the present one, in place of this; tell whether it is another.

        Raises SimrobError: no such subject; what is open stays so.
        """
        same = str(subject) == self.session.subject
        if same and robot in (None, self.session.book.robot):
            return False
        if same:
            self.session.close()  # two sessions do not teach in one folder
        following = self._open_session(subject, robot)
        if not same:
            self.session.close()
        self.session = following
        if self.tour is not None and self.tour.subject not in (
            following.subject,
            following.book.station,
        ):
            self.tour = None  # a lesson is about another robot or station
        self._begin()
        return True

    def take(self, files: Mapping[str, bytes]) -> bool:
        """Open a user's own files in place of what is open, and return True; the message tells what their import did.

        Raises SimrobError: nothing can be opened among them; what is open stays so.
        """
        self.load(keep(files, self.session.folder.parent))
        book = self.session.book
        if book.robot and (report := report_of(book.model.urdf_path)):
            self.session.client.say(report)
        return True

    def close(self) -> None:
        """End the session and its run."""
        self.session.close()

    def _begin(self) -> None:
        self.board.wipe()
        self.session.listen_to_view(self.board.tell)

    def _drag(self, said: Any) -> None:
        """Pass on what is dragged in the view, by the name that the station knows it by.

        The path in Meshcat's tree of the body that a user drags, the point in its frame (3) [m] that was picked, and
        where in the world the pointer is (3) [m]; None there ends it.
        """
        path, *places = said
        point, target = (None if place is None else _numbers(place, 3) for place in places)
        # below /drake/station; ValueError: no such path
        _, _, owner, *_, link = path.strip("/").split("/")
        known: Any = self.session.description.get("bodies", ())
        at = next((name for name in (f"{owner}.{link}", link, owner) if name in known), None)
        if at is not None and point is not None:
            self.session.drag(at, point, target)

    def _put(self, said: Any) -> None:
        """Pass on where a handle is put: its name, its pose (6) [m, deg], whether it is turned, and let go of."""
        handle, pose, turned, over = said
        self.session.hand.put(
            str(handle), _numbers(pose, 6), turned=turned is True, over=over is True
        )

    def _turn(self, said: Any) -> None:
        """Pass on how far an axis is turned by its link [deg or m]."""
        axis, value = said
        self.session.hand.turn(str(axis), *_numbers([value], 1))


def _numbers(values: Any, count: int) -> list[float]:
    """Return numbers that a page tells; raises ValueError, TypeError: they are none, or too large."""
    found = [float(value) for value in values]
    if len(found) != count or not all(abs(value) < _FAR for value in found):
        raise ValueError
    return found
