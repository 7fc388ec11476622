"""All kinds of moves; a new one is a file beside this and a name in the list."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from simrob_drake.errors import InvalidConfig, InvalidParameter, nearest, quoted
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

__all__ = ["KINDS", "ActMove", "AttachMove", "GoMove", "JointMove", "PlayMove", "ReleaseMove", "WaitMove", "WalkMove"]

_ALL: tuple[type[Move], ...] = (
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
KINDS: dict[str, type[Move]] = {kind.key: kind for kind in _ALL}  # by the key that tells them apart
LEG_KINDS = [key for key, kind in KINDS.items() if kind.of_legs]  # the keys of those that robots with legs can do

if TYPE_CHECKING:
    AnyMove = Move
else:
    AnyMove = field_of(*_ALL)


def move_from(
    content: Move | Mapping[str, Any], duration: float | None = None, *, otherwise: float = MOVE_TIME
) -> Move:
    """Return a move of any kind of what a user gave: targets of axes [deg], what would stand in a file, or a move.

    A move of joints takes its duration [s], ``otherwise`` unless given. Raises SimrobError: as :func:`move_of`; or a
    mapping that is wrong.
    """
    if isinstance(content, Move):
        made = content
    elif isinstance(content, Mapping) and kind_of(content, KINDS.values()) is not None:
        made = check_move(content)
    else:
        return move_of(content, otherwise if duration is None else duration)
    if duration is not None:
        raise InvalidParameter("duration", duration, "left out: it goes with targets of axes")
    return made


def check_move(entry: Any, where: str = "the move", kinds: Mapping[str, type[Move]] = KINDS) -> Move:
    """Return the move that an entry of a program's file is, checked by itself, so that messages can name it.

    Raises InvalidConfig: no mapping, a kind that there is not, or a wrong key or value; names ``where``.
    """
    if not isinstance(entry, Mapping):
        raise InvalidConfig(where, "", f"must be a mapping of keys to values (it is {quoted(entry)})")
    kind = kind_of(entry, kinds.values())
    strange = next((name for name in entry if name not in JointMove.model_fields), None)
    if kind is None and strange is not None:
        known = [*kinds, *JointMove.model_fields]
        raise InvalidConfig(where, str(strange), f"unknown key{nearest(str(strange), known)}")
    return read_move(kind or JointMove, entry, where)
