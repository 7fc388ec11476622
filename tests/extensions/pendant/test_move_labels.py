"""Titles and forms of moves: the pendant's own, those that a package announces, and those made from a move's keys."""

from typing import Annotated, ClassVar, Literal

import pytest

from simrob_drake.base.sections import Boolean, Number
from simrob_drake.extensions.pendant.form import move_fields
from simrob_drake.extensions.pendant.move_labels import labels_of
from simrob_drake.programs.moves.kinds import KINDS
from simrob_drake.programs.moves.motion import ArmMotion
from simrob_drake.programs.moves.move import Move, NameOf, named_things


class Polish(Move):
    """A move of another package without words for the pendant."""

    key: ClassVar[str] = "polish_piece"

    piece: Annotated[str, NameOf("pieces")]
    pressure: Number
    passes: int = 3
    pattern: Literal["circles", "lines"] = "lines"
    dry: Boolean = False
    points: tuple[tuple[float, float], ...] = ()
    robot: str | None = None


class Nod(Move):
    key: ClassVar[str] = "nod_here"
    title: ClassVar[str] = "Nod"
    form: ClassVar[dict[str, float]] = {"angle_deg": 20.0}
    angle_deg: Number = 10.0


class Trace(Move):
    key: ClassVar[str] = "trace"
    points: tuple[tuple[float, float], ...]


class TakeOld(Move):
    key: ClassVar[str] = "take_old"
    form: ClassVar[dict[str, str]] = {"what": "pieces"}
    what: str


def test_a_move_without_words_has_a_form_of_its_keys():
    labels = labels_of(Polish)
    assert labels.title == "Polish piece"
    assert labels.form == {
        "piece": "pieces",
        "pressure": None,
        "passes": None,
        "pattern": None,
        "dry": None,
    }
    fields = move_fields(Polish, labels.form, {"passes": 5})
    assert [field.kind for field in fields] == ["text", "number", "number", "choice", "switch"]
    assert fields[2].value == 5


def test_a_package_may_announce_its_own_words():
    labels = labels_of(Nod)
    assert labels.title == "Nod"
    assert labels.form == {"angle_deg": 20.0}


def test_a_move_that_needs_a_list_is_offered_by_no_form():
    assert labels_of(Trace).form == {}


@pytest.mark.parametrize("key", list(KINDS))
def test_every_move_of_the_toolbox_has_its_words_in_the_pendant_alone(key):
    kind = KINDS[key]
    assert not hasattr(kind, "title")
    assert not hasattr(kind, "form")
    labels = labels_of(kind)
    assert labels.title
    assert set(labels.form) <= set(kind.model_fields)
    assert bool(labels.form) != (issubclass(kind, ArmMotion) or key == "together")
    # A key that names something is chosen among the names.
    named = named_things(kind)
    assert all(labels.form[name] == what for name, what in named.items() if name in labels.form)


def test_a_move_depends_on_the_pieces_that_it_names():
    assert Polish(piece="cup", pressure=1).pieces() == ["cup"]
    assert TakeOld(what="cup").pieces() == ["cup"]
    assert KINDS["kick"](ball="ball").pieces() == ["ball"]
    assert KINDS["kick"]().pieces() == []
