"""What programs of legged robots are made of: moves of joints, walks, acts, and pieces taken and let go.

What users give in Python is checked, and told of as any other parameter.
"""

from collections.abc import Mapping
from typing import Annotated, Any, TypeVar, get_args

import numpy as np
from pydantic import (
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    SerializerFunctionWrapHandler,
    ValidationError,
    model_serializer,
    model_validator,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from simrob_drake.errors import InvalidParameter
from simrob_drake.given import LONGEST, SHORTEST
from simrob_drake.parts.site import WORLD
from simrob_drake.quantities import Duration, Pose
from simrob_drake.yaml_files import Number, Strict, validated

Entry = TypeVar("Entry", bound=Strict)

MOST_STEPS, MOST_AMPLITUDE = 10_000, 100
"""Of one walk: about an hour; far beyond what legs can do."""

_EXPECTED = {
    "duration": f"a positive time [s], {SHORTEST:g} to {LONGEST:g}",
    "target_deg": "a mapping of at least one axis to degrees",
    "steps": f"a whole number, at most {MOST_STEPS}",
    "amplitude": f"a number up to {MOST_AMPLITUDE}; 1 walks as the gait's parameters say",
}

MOVE_TIME = 1.0
"""Time of a move unless told otherwise [s]; ``tinc`` of the thesis."""

GO_TIME = 3.0
"""Time of a walk by commands unless told otherwise [s]: enough to stop."""

Targets = Annotated[dict[str, Number], Field(min_length=1)]
"""Where axes are to be [deg], and m for a prismatic one, by name or alias; the others stay where they were."""


class JointMove(Strict):
    """Axes that go to their targets at the same time; as a reference, a cell that lasts until they are there."""

    target_deg: Targets
    """Absolute positions at the end."""
    duration: Duration = MOVE_TIME
    """Time that it takes [s]."""


class Brief(Strict):
    """What is written without the values that are as they would be anyway."""

    @model_serializer(mode="wrap")
    def _brief(self, handler: SerializerFunctionWrapHandler) -> Any:
        fields = type(self).model_fields
        return {key: value for key, value in handler(self).items() if key not in fields or self._differs(key)}

    def _differs(self, key: str) -> bool:
        return bool(getattr(self, key) != type(self).model_fields[key].default)


class Named(Brief):
    """What its first field alone can stand for, such as its name."""

    @model_validator(mode="before")
    @classmethod
    def _from_first(cls, given: Any) -> Any:
        return {next(iter(cls.model_fields)): given} if isinstance(given, (str, list, tuple)) else given

    @model_serializer(mode="wrap")
    def _brief(self, handler: SerializerFunctionWrapHandler) -> Any:
        content, first = super()._brief(handler), next(iter(type(self).model_fields))
        return content[first] if list(content) == [first] else content

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        schema = handler(core)
        alone = handler.resolve_ref_schema(schema)["properties"][next(iter(cls.model_fields))]
        return {"anyOf": [schema, alone]}


class Walk(Brief):
    """Steps by a gait; further keys are parameters of the gait in place of its own."""

    model_config = ConfigDict(extra="allow")

    steps: Annotated[int, Field(strict=True, le=MOST_STEPS)]
    """How many step lengths ahead; the gait's `ramp_steps` come in addition. Legs in turn for a crawl."""
    amplitude: Annotated[Number, Field(ge=-MOST_AMPLITUDE, le=MOST_AMPLITUDE)] = 1.0
    """Scales them."""
    gait: str | None = None
    """One of the robot's gaits that go steps; the first for its feet unless given."""


class Act(Named):
    """Postures one after the other, or a stand on three legs; further keys are parameters in place of the act's own."""

    model_config = ConfigDict(extra="allow")

    name: str
    """One of the robot's gaits that go no steps."""


class Go(Brief):
    """A walk that is made while it goes, by its robot's `walking.yaml`; nothing but its duration: it stops and stands.

    What the legs cannot follow is clipped, and the result says so.
    """

    ahead: Number = 0.0
    """[m/s]."""
    sideways: Number = 0.0
    """To the left [m/s]."""
    turn_deg: Number = 0.0
    """To the left [deg/s]."""
    duration: Duration = GO_TIME
    """How long [s]; it does not stop at its end, so that another `go` can follow in the middle of a step."""
    strict: bool = False
    """Refuse what the legs cannot follow."""


class Attach(Named):
    """A piece that is taken."""

    piece: str
    """Which."""
    tool: str | None = None
    """With what: a tool or link of the robot, or a piece that it carries; the first tool unless given."""
    pose: Pose | None = None
    """Its pose in the hand, to put it there; it keeps its place in the world unless given."""
    parent: str | None = None
    """Instead of a tool of the robot anything else that it is to hang on: `world`, a robot, another piece."""
    frame: str | None = None
    """A frame of that piece, instead of its tool centre point; or a tool or link of that robot."""
    robot: str | None = None
    """Which robot of the station takes it; that of the program unless given."""


class Release(Named):
    """A piece that is let go."""

    piece: str
    """Which."""
    parent: str = WORLD
    """Where it is then: the world, or another piece that it hangs on."""
    fixed: bool = False
    """Hang it in the world, too, instead of letting it fall."""
    frame: str | None = None
    """A frame of the piece that it hangs on, instead of its tool centre point."""


class WalkMove(Strict):
    """A walk of a program."""

    walk: Walk


class GoMove(Strict):
    """A walk by commands of a program."""

    go: Go


class ActMove(Strict):
    """An act of a program."""

    act: Act


class AttachMove(Strict):
    """A piece taken in a program; it takes no time."""

    attach: Attach


class ReleaseMove(Strict):
    """A piece let go in a program; it takes no time."""

    release: Release


class WaitMove(Strict):
    """All robots hold their places."""

    wait: Duration
    """How long [s]."""


class PlayMove(Strict):
    """All robots follow the references of the station's file, from where they are."""

    play: Duration
    """How long [s]."""


LegMove = JointMove | WalkMove | GoMove | ActMove | AttachMove | ReleaseMove | WaitMove | PlayMove
LEG_KINDS: dict[str, type[LegMove]] = {next(iter(kind.model_fields)): kind for kind in get_args(LegMove)}
"""By the key that tells them apart, the first field."""


def kind_of(content: Mapping[str, Any]) -> type[LegMove] | None:
    """Return what kind of move a mapping of a program's file is; None if no key tells."""
    return next((kind for key, kind in LEG_KINDS.items() if key in content), None)


def move_of(target_deg: Mapping[str, Any], duration: Any = MOVE_TIME) -> JointMove:
    """Return a checked move of what a user gave.

    Raises:
        InvalidParameter: no axis, an angle that is no finite number, or a duration that is not positive.
    """
    return checked(JointMove, target_deg=target_deg, duration=duration)


def any_move(
    given: LegMove | Mapping[str, Any], duration: float | None = None, *, otherwise: float = MOVE_TIME
) -> LegMove:
    """Return a move of any kind of what a user gave: targets of axes, or what would stand in a program's file.

    Args:
        given: targets [deg] by axis, a mapping such as ``{"walk": {"steps": 4}}``, or a move.
        duration: of a move of joints [s].
        otherwise: its duration unless given [s].

    Raises:
        SimrobError: as :func:`move_of`; or a mapping that is wrong.
    """
    if isinstance(given, Strict):
        made = given
    elif isinstance(given, Mapping) and (kind := kind_of(given)) is not None:
        made = validated(kind, plain(given), "the move")
    else:
        return move_of(given, otherwise if duration is None else duration)
    if duration is not None:
        raise InvalidParameter("duration", duration, "left out: it goes with targets of axes")
    return made


def checked(kind: type[Entry], /, **content: Any) -> Entry:
    """Return what a user gave as a checked entry of a program.

    Raises:
        InvalidParameter: the first value that cannot be.
    """
    try:
        return kind.model_validate(plain(content))
    except ValidationError as problem:
        finding = problem.errors()[0]
        key = ".".join(str(part) for part in finding["loc"])
        otherwise = "a finite number [deg]" if key.startswith("target_deg") else "a text"
        raise InvalidParameter(key, finding["input"], _EXPECTED.get(key, otherwise)) from problem


def plain(value: Any) -> Any:
    """Return a value with numpy's numbers and arrays as Python's own."""
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    if isinstance(value, Mapping):
        return {str(key): plain(part) for key, part in value.items()}
    return [plain(part) for part in value] if isinstance(value, (list, tuple)) else value
