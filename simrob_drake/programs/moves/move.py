"""Base class of moves, and how the file of a program has them.

A program is a list of moves. Each *kind* of move is a subclass of :class:`Move`, with a `key` by which a file names it
and with fields for its own keys. A file has a move as an *entry*: ``{walk: {steps: 4}}`` has the key ``walk``. An entry
is *brief* if it has only the value of the first field: ``{act: bow}`` means ``{act: {name: bow}}``. A kind whose key is
one of its own fields has no level of its own: ``{target_deg: {waist: 10}, duration: 1}``.

The *pendant* is a page by which users teach robots. It offers a form for each kind of move.
"""

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
from simrob_drake.base.sections import Strict, validate_section
from simrob_drake.programs.geometry import LeggedGeometry
from simrob_drake.programs.plan import Plan
from simrob_drake.programs.stateful_station import StatefulStation
from simrob_drake.results.record.run import move_title
from simrob_drake.results.result import SimulationResult
from simrob_drake.robots.catalog import RobotModel
from simrob_drake.stations.config import StationConfig

Kind = TypeVar("Kind", bound="Move")
Run: TypeAlias = Callable[[list[Plan], float | None], Any]
"""Function that runs plans of arms at the same time, for a duration [s] or, if it is None, until the last one ends.

A program that is only checked uses another function, which places the robots at the ends of their plans.
"""
Stage: TypeAlias = Callable[[LeggedGeometry], SimulationResult | None]
"""Function that performs a checked part of a program, by a robot with legs. It returns None if that takes no time."""

MOVE_TIME = 1.0
"""Default duration of a move of joints [s]; ``tinc`` of the thesis."""
MOST_STEPS = 10_000
"""Largest count of steps of one walk, which then takes about an hour."""
MOST_AMPLITUDE = 100
"""Largest factor of the length of steps, far beyond what legs can do."""

# What is expected of a value, for messages, by its key.
_EXPECTED = {
    "duration": message(
        "base.a_positive_time",
        "a positive time [s], {shortest:g} to {longest:g}",
        shortest=SHORTEST,
        longest=LONGEST,
    ),
    "target_deg": message("programs.axes_to_degrees", "a mapping of at least one axis to degrees"),
    "steps": message(
        "programs.whole_number_at_most", "a whole number, at most {most}", most=MOST_STEPS
    ),
    "amplitude": message(
        "programs.number_up_to",
        "a number up to {most}; 1 keeps the parameters of the gait",
        most=MOST_AMPLITUDE,
    ),
}


@dataclass
class Outlook:
    """Station as it will be before a move, while a program is checked. Checking a move updates it.

    Attributes:
        station: the station as it will be.
        changed: whether earlier moves change the station in a way that is not known exactly. Then motions that depend
            on it have to be planned again when they run.
    """

    station: StationConfig
    changed: bool = False


@dataclass(frozen=True)
class NameOf:
    """Annotation of a key of a move whose value names something of the robot or its station.

    Example: ``piece: Annotated[str, NameOf("pieces")]``. A form can then offer the names that there are.

    Attributes:
        what: ``pieces`` or ``tools`` of the station, ``gaits`` of the robot with steps, or ``acts``, its gaits without
            steps.
    """

    what: Literal["pieces", "tools", "gaits", "acts"]


def named_things(kind: "type[Move]") -> dict[str, str]:
    """Find the keys of a kind of move whose values name something, each with what it names, such as ``pieces``.

    These are the keys that are annotated by :class:`NameOf`.
    """
    return {
        key: mark.what
        for key, field in kind.model_fields.items()
        for mark in field.metadata
        if isinstance(mark, NameOf)
    }


class Move(Strict):
    """A move of a program. A subclass is a kind of move: it adds its keys as fields, and overrides methods.

    A kind that is ``brief`` may be written by the value of its first field alone: ``{act: bow}``.

    Attributes:
        key: key by which a file names this kind.
        says: caption of the move in events and messages: a template with fields of ``it``, the move.
        brief: whether the value of the first field alone can stand for the move.
        takes_time: whether the move is a run of the station.
        of_arms: whether arms can perform it.
        of_legs: whether robots with legs can perform it.
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
    def _expand_brief(cls, content: Any) -> Any:
        """Expand a brief move, the value of its first field, to a mapping with this field.

        Pydantic calls this before it checks the fields. A mapping, a move, None, and any content of a kind that is not
        brief are returned unchanged.
        """
        is_value = content is not None and not isinstance(content, (Mapping, Move))
        return {_first_field(cls): content} if cls.brief and is_value else content

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """JSON schema of the kind. A brief kind allows the value of its first field as well."""
        schema = super().__get_pydantic_json_schema__(core, handler)
        if not cls.brief:
            return schema
        first_field = handler.resolve_ref_schema(schema)["properties"][_first_field(cls)]
        return {"anyOf": [schema, first_field]}

    def entry(self) -> dict[str, Any]:
        """Entry of the move in a program's file, brief if possible. Keys with default values are left out."""
        content = self.model_dump(mode="json", exclude_defaults=True)
        # A kind whose key is one of its own fields, such as `target_deg`, has no level of its own in the file.
        if self.key in type(self).model_fields:
            return content
        first = _first_field(type(self))
        # The shortest entry is written: a value alone means the same as a mapping with the first field only.
        is_brief = self.brief and list(content) == [first]
        return {self.key: content[first] if is_brief else content}

    def caption(self, *, robots: bool = False) -> str:
        """Caption of the move for events and lists, such as "attach box" or "grip of left".

        Args:
            robots: whether the caption names the robot. It does so only if the move itself names one.
        """
        text = self.says.format(it=self)
        robot = getattr(self, "robot", None) if robots else None
        return f"{text} of {robot}" if robot else text

    def pieces(self) -> Iterable[str]:
        """Names of the pieces under the keys of the move that are annotated as names of pieces.

        A piece under another key, such as `parent` of a move `attach`, does not count.
        """
        keys = [key for key, what in named_things(type(self)).items() if what == "pieces"]
        # Until 0.2: in moves of other packages the keys may have no annotation. Then the form for the pendant has it.
        form: Mapping[str, Any] = getattr(type(self), "form", {})
        keys += [key for key, what in form.items() if what == "pieces" and key not in keys]
        # Such a key may have no value: a kick without a ball swings the foot through the air.
        values = [getattr(self, key) for key in keys]
        return [piece for piece in values if piece]

    @classmethod
    def possible_keys(
        cls, config: StationConfig, robot: str, model: RobotModel
    ) -> frozenset[str] | None:
        """Keys that a move of this kind may have for a robot of a station.

        A kind that not every robot can do overrides this. Forms for moves offer nothing else.

        Args:
            config: the station.
            robot: name of the robot in the station.
            model: model of the robot.

        Returns:
            The keys, or None if the robot can do no move of this kind.
        """
        return frozenset(cls.model_fields)

    def perform(self, cell: StatefulStation, robot: str | None, run: Run) -> Any:
        """Perform the move with arms of a station. A kind that arms can do overrides this.

        Args:
            cell: the station.
            robot: name of the robot whose program it is. If it is None, the only robot.
            run: function that runs the plans of the move.

        Returns:
            The value that `run` returns, or None if the move takes no time.

        Raises:
            SimrobError: the move cannot be done.
        """
        raise InvalidParameter(
            message("programs.the_move", "the move"),
            self.key,
            message("programs.move_for_legs", "a move for arms, not for robots with legs"),
        )

    def stage(self, robot: LeggedGeometry, outlook: Outlook, name: str) -> Stage:
        """Check that a robot with legs can perform the move, and return the stage that performs it later.

        A kind that robots with legs can do overrides this.

        Args:
            robot: the robot.
            outlook: the station as it will be before the move. It is updated to the station after the move.
            name: name of the move for messages.

        Raises:
            SimrobError: the robot cannot perform the move.
        """
        raise InvalidParameter(
            message("programs.the_move", "the move"),
            self.key,
            message("programs.move_for_arms", "a move for robots with legs, not for arms"),
        )


def field_of(*kinds: type[Move]) -> Any:
    """Pydantic type of a field that holds a move of one of some kinds, and is written as an entry of a file.

    The field accepts an entry, or a move that was made in Python, and holds the move.
    """
    # Pydantic finds the kind by the key: each entry model accepts exactly one.
    union: Any = reduce(or_, (entry_model(kind) for kind in kinds))
    return Annotated[
        union,
        BeforeValidator(_wrap_move),
        AfterValidator(_unwrap_move),
        PlainSerializer(Move.entry),
    ]


@cache
def entry_model(kind: type[Move]) -> type[Strict]:
    """Pydantic model of an entry in a file: one field with the key of a kind of move, which holds the move.

    A kind whose key is one of its own fields has no level of its own in the file, and is its own model.
    """
    if kind.key in kind.model_fields:
        return kind
    # The model of the entry exists for the schema: an editor shows the first line of the kind's docstring.
    about = (kind.__doc__ or "").partition("\n")[0]
    fields: dict[str, Any] = {kind.key: (kind, ...)}
    return create_model(
        kind.__name__.removesuffix("Move") + "Entry", __base__=Strict, __doc__=about, **fields
    )


def content_of(kind: type[Move], move: Mapping[str, Any]) -> dict[str, Any]:
    """Fields of a move and their values from its entry in a file, also if the entry is brief. Nothing is checked.

    Args:
        kind: kind of the move.
        move: the entry, which has the key of the kind.
    """
    content = move if kind.key in kind.model_fields else move[kind.key]
    return dict(content) if isinstance(content, Mapping) else {_first_field(kind): content}


def _first_field(kind: type[Move]) -> str:
    """Name of the first field of a kind of move, whose value alone is a brief move."""
    return next(iter(kind.model_fields))


def kind_of(content: Mapping[str, Any], kinds: Iterable[type[Move]]) -> type[Move] | None:
    """Kind of the move that an entry of a file is. It is None if the entry has the key of no kind."""
    # A key of a kind may be anywhere in the entry: `duration` may stand before `target_deg`.
    return next((kind for kind in kinds if kind.key in content), None)


def read_move(kind: type[Move], content: Mapping[str, Any], where: str) -> Move:
    """Read a move of a kind from an entry of a file.

    Args:
        kind: kind of the move.
        content: the entry. If it lacks the key of the kind, the error says so.
        where: name of the move for error messages.

    Raises:
        InvalidConfig: a key or a value is wrong.
    """
    return _unwrap_move(validate_section(entry_model(kind), plain(content), where))


def make_move(kind: type[Kind], /, **content: Any) -> Kind:
    """Make a move from arguments that a user gave in Python.

    Args:
        kind: kind of the move.
        **content: values of its keys. Keys that are left out have their defaults.

    Raises:
        InvalidParameter: a value is wrong. The message names the first one.
    """
    try:
        return kind.model_validate(plain(content))
    except ValidationError as problem:
        # Pydantic's texts name Python types. The user gets the words of this package, for the first finding.
        finding = problem.errors()[0]
        key = ".".join(str(part) for part in finding["loc"])  # such as "target_deg.waist"
        # What is expected by keys that `_EXPECTED` does not have: most of them are names.
        default = message("programs.a_text", "a text")
        if key.startswith("target_deg"):
            default = message("programs.finite_degrees", "a finite number [deg]")
        raise InvalidParameter(key, finding["input"], _EXPECTED.get(key, default)) from None


def move_name(index: int, count: int, file: str = "") -> str:
    """Name of a move in messages, which count moves from 1, such as "move 3" or "the move".

    Args:
        index: index of the move in its program, from 0.
        count: count of the program's moves. A single one needs no number.
        file: file of the program, which is part of the name; empty if the program has none.
    """
    # A file numbers its moves even if it has only one, so that an editor can find the move.
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
    """Context manager that puts the name of a move before the message of an error in it.

    Args:
        move: name of the move. If it is empty, messages stay as they are.
    """
    try:
        yield
    except SimrobError as problem:
        # The exception itself stays the same, with its class and its attributes: only its message changes.
        if move:
            problem.put_in_front(move)
        raise


def _wrap_move(value: Any) -> Any:
    """Put a move that was made in Python under its key, as in an entry of a file. Other values stay unchanged.

    A move whose key is one of its own fields stays unchanged, too: it is its own entry.
    """
    # A move of Python is valid already, but the field's models accept entries of files only.
    if not isinstance(value, Move) or value.key in type(value).model_fields:
        return value
    return {value.key: value}


def _unwrap_move(entry: Any) -> Move:
    """Move in an entry that was checked: an object of a class of :func:`entry_model`, or the move itself."""
    if isinstance(entry, Move):
        move = entry
    else:
        key = next(iter(type(entry).model_fields))  # the only field: the key of the kind
        move = getattr(entry, key)
    assert isinstance(move, Move)
    return move
