"""A line of a program: what all kinds of moves declare, and how a program's file holds them."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, reduce
from operator import or_
from typing import Annotated, Any, ClassVar, Literal, TypeAlias, TypeVar

from pydantic import (
    AfterValidator,
    BeforeValidator,
    GetJsonSchemaHandler,
    PlainSerializer,
    ValidationError,
    create_model,
    model_validator,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from simrob_drake.base.arguments import LONGEST, SHORTEST, plain
from simrob_drake.base.errors import InvalidParameter, SimrobError
from simrob_drake.base.messages import compound, message
from simrob_drake.base.sections import Strict, validated
from simrob_drake.programs.geometry import LeggedGeometry
from simrob_drake.programs.plan import Plan
from simrob_drake.programs.stateful_station import StatefulStation
from simrob_drake.results.record.run import move_title
from simrob_drake.results.result import SimulationResult
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.stations.config import StationConfig

Kind = TypeVar("Kind", bound="Move")
Run: TypeAlias = Callable[[list[Plan], float | None], Any]
"""Runs plans of arms at the same time, for a duration [s] if one is named; or stands robots where they lead."""
Stage: TypeAlias = Callable[[LeggedGeometry], SimulationResult | None]
"""A part of a program, checked and ready, that a robot with legs does from where it is; None: it takes no time."""

MOVE_TIME = 1.0  # time of a move of joints unless another one is asked for [s]; ``tinc`` of the thesis
MOST_STEPS, MOST_AMPLITUDE = 10_000, 100  # of one walk: about an hour; far beyond what legs can do
_EXPECTED = {
    "duration": message(
        "base.a_positive_time", "a positive time [s], {shortest:g} to {longest:g}", shortest=SHORTEST, longest=LONGEST
    ),
    "target_deg": message("programs.axes_to_degrees", "a mapping of at least one axis to degrees"),
    "steps": message("programs.whole_number_at_most", "a whole number, at most {most}", most=MOST_STEPS),
    "amplitude": message(
        "programs.number_up_to", "a number up to {most}; 1 walks as the gait's parameters say", most=MOST_AMPLITUDE
    ),
}


@dataclass
class Outlook:
    """What is known of a station before a move of a program that is only looked at."""

    station: StationConfig  # as it will be
    changed: bool = False  # whether earlier moves changed it, so that what depends on it is to be planned anew


@dataclass(frozen=True)
class NameOf:
    """Annotation of a key of a move whose value names something of the robot or its station.

    Example: ``piece: Annotated[str, NameOf("pieces")]``. A form can then offer the names that there are.

    Attributes:
        what: ``pieces`` or ``tools`` of the station, ``gaits`` of the robot that go steps, or ``acts``, its gaits that
            go no steps.
    """

    what: Literal["pieces", "tools", "gaits", "acts"]


def named_things(kind: "type[Move]") -> dict[str, str]:
    """Find the keys of a kind of move that are annotated by `NameOf`, each with the annotation's ``what``."""
    return {
        key: mark.what
        for key, field in kind.model_fields.items()
        for mark in field.metadata
        if isinstance(mark, NameOf)
    }


class Move(Strict):
    """A line of a program. A kind has its keys and overrides what is its own.

    A file tells kinds apart by their ``key``, under which the others stand: ``{walk: {steps: 4}}``. A kind that is
    ``brief`` may stand there by its first field alone: ``{act: bow}``.

    Attributes:
        key: by which a file tells it.
        says: caption of the move in events and messages, a template with fields of ``it``.
        brief: whether its first field alone can stand for it.
        takes_time: whether it is a run of the station.
        of_arms: whether arms can do it.
        of_legs: whether robots with legs can.
    """

    key: ClassVar[str]
    says: ClassVar[str] = "{it.key}"
    brief: ClassVar[bool] = False
    takes_time: ClassVar[bool] = True
    of_arms: ClassVar[bool] = True
    of_legs: ClassVar[bool] = True

    # Title and form for the pendant, which a move of another package may assign. The core gives them no values: the
    # pendant has those of the toolbox's own moves.
    title: ClassVar[str]
    form: ClassVar[Mapping[str, str | float | None]]

    @model_validator(mode="before")
    @classmethod
    def _from_first(cls, content: Any) -> Any:
        alone = cls.brief and content is not None and not isinstance(content, (Mapping, Move))
        return {next(iter(cls.model_fields)): content} if alone else content

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        schema = super().__get_pydantic_json_schema__(core, handler)
        if not cls.brief:
            return schema
        alone = handler.resolve_ref_schema(schema)["properties"][next(iter(cls.model_fields))]
        return {"anyOf": [schema, alone]}

    def entry(self) -> dict[str, Any]:
        """Return what a program's file has of it, without the values that are as they would be anyway."""
        content = self.model_dump(mode="json", exclude_defaults=True)
        if self.key in type(self).model_fields:
            return content
        first = next(iter(type(self).model_fields))
        return {self.key: content[first] if self.brief and list(content) == [first] else content}

    def caption(self, *, robots: bool = False) -> str:
        """Return what it does, in a few words, for events and lists; with ``robots`` whose move it is."""
        whose = getattr(self, "robot", None) if robots else None
        return self.says.format(it=self) + (f" of {whose}" if whose else "")

    def pieces(self) -> Iterable[str]:
        """Names of the pieces that the move depends on."""
        keys = [key for key, what in named_things(type(self)).items() if what == "pieces"]
        # Until 0.2: in moves of other packages the keys may have no annotation. The form for the pendant says it then.
        form: Mapping[str, Any] = getattr(type(self), "form", {})
        keys += [key for key, what in form.items() if what == "pieces" and key not in keys]
        # Such a key may have no value: a kick without a ball swings the foot through the air.
        return [piece for key in keys if (piece := getattr(self, key))]

    @classmethod
    def possible_keys(cls, config: StationConfig, robot: str, model: RobotModel) -> frozenset[str] | None:
        """Find out whether a robot of a station can do moves of this kind, and which keys of them it can be given.

        A kind that not every robot can do overrides this. Forms for moves offer nothing else.

        Args:
            config: the station.
            robot: name of the robot in the station.
            model: model of the robot.

        Returns:
            the keys; None if the robot can do no move of this kind.
        """
        return frozenset(cls.model_fields)

    def perform(self, cell: StatefulStation, robot: str | None, run: Run) -> Any:
        """Do it with arms of a station, and return what ``run`` gives, which runs plans; None if it takes no time.

        ``robot`` is whose program it is in, None the only one. Raises SimrobError: it cannot be done.
        """
        raise InvalidParameter(
            message("programs.the_move", "the move"),
            self.key,
            message("programs.move_for_legs", "one of arms: this one is for legs"),
        )

    def stage(self, robot: LeggedGeometry, outlook: Outlook, name: str) -> Stage:
        """Check that a robot with legs can do it, and return the stage that does, called ``name`` in messages.

        The outlook is the station when it will be done; it is changed to what the move leaves. Raises SimrobError: it
        cannot.
        """
        raise InvalidParameter(
            message("programs.the_move", "the move"),
            self.key,
            message("programs.move_for_arms", "one for legs: this one is of arms"),
        )


def field_of(*kinds: type[Move]) -> Any:
    """Return the type of a field that holds a move of some kinds, each as a file has it."""
    union: Any = reduce(or_, (entry_model(kind) for kind in kinds))
    return Annotated[union, BeforeValidator(_wrapped), AfterValidator(_unwrapped), PlainSerializer(Move.entry)]


@cache
def entry_model(kind: type[Move]) -> type[Strict]:
    """Return the section of a file that a move of a kind is: its key, and its own keys under that."""
    if kind.key in kind.model_fields:
        return kind
    about = (kind.__doc__ or "").partition("\n")[0]
    fields: dict[str, Any] = {kind.key: (kind, ...)}
    return create_model(kind.__name__.removesuffix("Move") + "Entry", __base__=Strict, __doc__=about, **fields)


def content_of(kind: type[Move], move: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a move, however briefly a file has it."""
    content = move if kind.key in kind.model_fields else move[kind.key]
    return dict(content) if isinstance(content, Mapping) else {next(iter(kind.model_fields)): content}


def kind_of(content: Mapping[str, Any], kinds: Iterable[type[Move]]) -> type[Move] | None:
    """Return what kind of move a mapping of a program's file is; None if no key tells."""
    return next((kind for kind in kinds if kind.key in content), None)


def read_move(kind: type[Move], content: Mapping[str, Any], where: str) -> Move:
    """Return the move of a kind that a file's mapping is; raises InvalidConfig: ``where``, key, what would be right."""
    return _unwrapped(validated(entry_model(kind), plain(content), where))


def checked(kind: type[Kind], /, **content: Any) -> Kind:
    """Return a move of what a user gave in Python; raises InvalidParameter: the first value that cannot be."""
    try:
        return kind.model_validate(plain(content))
    except ValidationError as problem:
        finding = problem.errors()[0]
        key = ".".join(str(part) for part in finding["loc"])
        otherwise = (
            message("programs.finite_degrees", "a finite number [deg]")
            if key.startswith("target_deg")
            else message("programs.a_text", "a text")
        )
        raise InvalidParameter(key, finding["input"], _EXPECTED.get(key, otherwise)) from None


def move_name(index: int, count: int, file: str = "") -> str:
    """Name of a move in messages, which count moves from 1.

    Args:
        index: index of the move in its program, from 0.
        count: how many moves the program has. A single one needs no number.
        file: file of the program, which is part of the name; empty if the program has none.
    """
    if file:
        return compound("{file}: {move}", file=file, move=move_title(index))
    return move_title(index) if count > 1 else message("programs.the_move", "the move")


def reference_name(index: int, file: str = "") -> str:
    """Name of a reference of a program in messages, which count from 1 as they do for moves.

    Args:
        index: index of the reference in its program, from 0.
        file: file of the program, which is part of the name; empty if the program has none.
    """
    reference = message("programs.reference_number", "reference {number}", number=index + 1)
    return compound("{file}: {reference}", file=file, reference=reference) if file else reference


@contextmanager
def naming(move: str) -> Iterator[None]:
    """Put the name of a move before what goes wrong with it."""
    try:
        yield
    except SimrobError as problem:
        if move:
            problem.put_in_front(move)
        raise


def _wrapped(value: Any) -> Any:
    """Return a move that was made in Python as a file would have it."""
    if isinstance(value, Move):
        return value if value.key in type(value).model_fields else {value.key: value}
    return value


def _unwrapped(entry: Any) -> Move:
    """Return the move of a section of a file."""
    move = entry if isinstance(entry, Move) else getattr(entry, next(iter(type(entry).model_fields)))
    assert isinstance(move, Move)
    return move
