"""All kinds of moves, by the key that a program's file names them by.

A new kind of the core is a file in this folder and a name in the list `_CORE`. Installed extensions add further kinds,
which are imported when a program is first read. An *entry* is a move as the file of a program has it:
``{walk: {steps: 4}}`` is an entry of the kind with the key ``walk``. An entry without the key of a kind is a move of
joints.
"""

from collections.abc import Iterator, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import GetJsonSchemaHandler, TypeAdapter
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, core_schema

from simrob_drake.base.errors import InvalidConfig, Unsuitable, nearest, quote_value
from simrob_drake.base.extension import check_usable, classes_of_extensions, register_core_names
from simrob_drake.base.messages import message
from simrob_drake.programs.moves.attach import AttachMove, ReleaseMove
from simrob_drake.programs.moves.climb import ClimbMove
from simrob_drake.programs.moves.get_up import GetUpMove
from simrob_drake.programs.moves.grip import GripMove, OpenMove, ToolMove
from simrob_drake.programs.moves.joints import JointMove, move_of
from simrob_drake.programs.moves.kick import KickMove
from simrob_drake.programs.moves.move import MOVE_TIME, Move, field_of, kind_of, read_move
from simrob_drake.programs.moves.together import MOTIONS, TogetherMove
from simrob_drake.programs.moves.wait import PlayMove, WaitMove
from simrob_drake.programs.moves.walk import ActMove, GoMove, WalkMove

__all__ = [
    "KINDS",
    "ActMove",
    "AttachMove",
    "GoMove",
    "JointMove",
    "PlayMove",
    "ReleaseMove",
    "WaitMove",
    "WalkMove",
]

_CORE: tuple[type[Move], ...] = (
    JointMove,
    WalkMove,
    GoMove,
    ActMove,
    KickMove,
    ClimbMove,
    GetUpMove,
    AttachMove,
    ReleaseMove,
    WaitMove,
    PlayMove,
    *MOTIONS,
    ToolMove,
    GripMove,
    OpenMove,
    TogetherMove,
)
"""The kinds of the core, in the order in which the pendant and messages list them."""

_POINT = "moves"
"""Extension point at which extensions add kinds of moves."""


class MoveKinds(Mapping[str, type[Move]]):
    """Kinds of moves by their key: those of the core, then those of the installed extensions.

    The kinds of extensions are imported when the mapping is first used.
    """

    @cached_property
    def _all(self) -> dict[str, type[Move]]:
        """Kinds by their key."""
        # A kind of an extension cannot replace one of the core: `classes_of_extensions` leaves out such names.
        return {kind.key: kind for kind in _CORE} | classes_of_extensions(
            _POINT, Move, named_by="key"
        )

    @cached_property
    def adapter(self) -> TypeAdapter[Any]:
        """Reads and writes a move of any kind, as a program's file has it."""
        return TypeAdapter(field_of(*self._all.values()))

    def __getitem__(self, key: str) -> type[Move]:
        return self._all[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._all)

    def __len__(self) -> int:
        return len(self._all)


KINDS = MoveKinds()
"""All kinds of moves by their key."""

register_core_names(_POINT, lambda: [kind.key for kind in _CORE])


def leg_kinds() -> list[str]:
    """Keys of the kinds that robots with legs can perform."""
    return [key for key, kind in KINDS.items() if kind.of_legs]


def _validate_move(content: Any) -> Any:
    """Check a move of any kind. The kinds of extensions are imported when the first move is checked, not before."""
    return KINDS.adapter.validate_python(content)


class _AnyMoveField:
    """Annotation of a field that holds a move of any kind; which kinds there are is asked when a move is read."""

    def __get_pydantic_core_schema__(self, _source: Any, _handler: Any) -> CoreSchema:
        """Schema by which pydantic checks a move by its kind, and writes it as an entry of a file.

        The schema calls a function, so that it need not list the kinds when a class with such a field is defined.
        """
        return core_schema.no_info_plain_validator_function(
            _validate_move,
            serialization=core_schema.plain_serializer_function_ser_schema(Move.entry),
        )

    def __get_pydantic_json_schema__(
        self, _schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """JSON schema of a move of any kind."""
        return handler(KINDS.adapter.core_schema)


if TYPE_CHECKING:
    AnyMove = Move
else:
    AnyMove = Annotated[Any, _AnyMoveField()]


def move_from(
    content: Move | Mapping[str, Any],
    duration: float | None = None,
    *,
    otherwise: float = MOVE_TIME,
) -> Move:
    """Make a move of any kind from what a user gives in Python.

    Args:
        content: targets of axes by name [deg, or m for a prismatic axis], an entry of a program's file, or a move,
            which is returned as it is.
        duration: duration of the move [s], only for targets of axes. If it is None, ``otherwise``.
        otherwise: default of ``duration`` [s].

    Raises:
        Unsuitable: a duration is given in addition to an entry or a move, which has its own.
        InvalidParameter: a target is no finite number, there is none, or the duration is not positive.
        InvalidConfig: an entry has a wrong key or value.
    """
    if isinstance(content, Move):
        move = content
    # A mapping with the key of a kind is an entry. Without such a key, it has the targets of axes.
    elif isinstance(content, Mapping) and kind_of(content, KINDS.values()) is not None:
        move = check_move(content)
    else:
        return move_of(content, otherwise if duration is None else duration)
    if duration is not None:
        raise Unsuitable(
            "duration",
            message("programs.belongs_to_axes", "only a move of axes has a separate duration"),
        )
    return move


def check_move(
    entry: Any,
    where: str = message("programs.the_move", "the move"),
    kinds: Mapping[str, type[Move]] = KINDS,
) -> Move:
    """Check one entry of a program's file by itself, so that messages can name it, and return its move.

    Args:
        entry: the entry, as it was read from the file.
        where: name of the move for messages.
        kinds: the kinds that are possible, by key. The entry may always be a move of joints.

    Raises:
        InvalidConfig: the entry is no mapping, is of no known kind, or has a wrong key or value. The message begins
            with ``where``.
        BrokenExtension: the entry is of a kind that an extension adds, and that cannot be used.
    """
    if not isinstance(entry, Mapping):
        raise InvalidConfig(
            where,
            "",
            message(
                "programs.move_is_mapping",
                "must be a mapping of keys to values (it is {entry})",
                entry=quote_value(entry),
            ),
        )
    kind = kind_of(entry, kinds.values())
    # If the entry has the key of no kind, its first key that no move of joints has is likely a misspelt key of a kind.
    strange = next((name for name in entry if name not in JointMove.model_fields), None)
    if kind is None and strange is not None:
        # An extension that could not be loaded explains the unknown key better than a spelling would.
        check_usable(_POINT, str(strange), Move, named_by="key")
        known = [*kinds, *JointMove.model_fields]
        raise InvalidConfig(
            where,
            str(strange),
            message(
                "base.unknown_key",
                "unknown key{suggestion}",
                suggestion=nearest(str(strange), known),
            ),
        )
    return read_move(kind or JointMove, entry, where)
