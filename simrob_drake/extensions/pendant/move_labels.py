"""Titles of moves and fields of their forms, as the pendant offers them.

The toolbox's own moves are in a table here. A move of another package may have the class attributes ``title`` and
``form``; otherwise its title is its key, and its form is made from its keys.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from types import MappingProxyType

from simrob_drake.extensions.pendant.form import ENTERED_ALONE, move_fields
from simrob_drake.programs.moves.motion import ArmMotion
from simrob_drake.programs.moves.move import Move, named_things

FormFields = Mapping[str, str | float | None]
"""Fields of a form, by the key of the move.

The value is what the field is chosen among: ``pieces`` or ``tools`` of the station, ``gaits`` or ``acts`` of the robot.
``axes`` stands for targets of the robot's axes, and ``origin`` for a pose that is that of a frame, or is left out. A
number is what the field holds at first. None stands for the default value of the key.
"""

_NO_FIELDS: FormFields = MappingProxyType({})


@dataclass(frozen=True)
class MoveLabels:
    """How the pendant offers a kind of move.

    Attributes:
        title: its title in English, for languages without words of their own.
        form: the fields that are asked for. A kind without fields is not offered by a form.
    """

    title: str
    form: FormFields = field(default_factory=lambda: _NO_FIELDS)


_LABELS: Mapping[str, MoveLabels] = {
    "target_deg": MoveLabels("Move joints", {"target_deg": "axes", "duration": None}),
    "walk": MoveLabels("Walk", {"steps": 4, "amplitude": None, "gait": "gaits"}),
    "go": MoveLabels("Go", {"ahead": None, "sideways": None, "turn_deg": None, "duration": None}),
    "act": MoveLabels("Act", {"name": "acts"}),
    "kick": MoveLabels("Kick", {"ball": "pieces", "speed": None}),
    "climb": MoveLabels("Climb", {"distance": 1.0}),
    "get_up": MoveLabels("Get up", {"attempts": None}),
    "attach": MoveLabels("Take a piece", {"piece": "pieces", "tool": "tools", "pose": "origin"}),
    "release": MoveLabels("Let a piece go", {"piece": "pieces", "fixed": None}),
    "wait": MoveLabels("Wait", {"duration": 1.0}),
    "play": MoveLabels("Play", {"duration": 5.0}),
    "tool": MoveLabels("Tool", {"name": "tools"}),
    "grip": MoveLabels("Grip", {"force": None, "width": None, "duration": None}),
    "open": MoveLabels("Open", {"width": None, "duration": None}),
    "move_abs_j": MoveLabels("MoveAbsJ"),
    "move_j": MoveLabels("MoveJ"),
    "move_l": MoveLabels("MoveL"),
    "move_c": MoveLabels("MoveC"),
    "move_free": MoveLabels("MoveFree"),
    "together": MoveLabels("Together"),
}
"""The toolbox's own moves, by their key."""


@cache
def labels_of(kind: type[Move]) -> MoveLabels:
    """Title and form of a kind of move.

    Those of the toolbox's own moves are in the table above. A move of another package may have its own; otherwise its
    title is its key ("My move" for ``my_move``), and its form is made from its keys.
    """
    if kind.key in _LABELS:
        return _LABELS[kind.key]
    title = getattr(kind, "title", None)
    form = getattr(kind, "form", None)
    return MoveLabels(
        title=kind.key.replace("_", " ").capitalize() if title is None else title,
        form=form_from_keys(kind) if form is None else form,
    )


def form_from_keys(kind: type[Move]) -> FormFields:
    """Make a form from the keys of a kind of move: fields for names, numbers, texts, choices and switches.

    Other keys, such as lists, are left out. If the move cannot be without such a key, the form is empty: the pendant
    does not offer the move. The form of an arm's move to targets is empty, too: the pendant teaches its targets.
    """
    if issubclass(kind, ArmMotion):
        return _NO_FIELDS
    names = named_things(kind)
    # the pendant has chosen the robot already
    keys = [key for key in kind.model_fields if key != "robot"]
    form = dict[str, str | float | None]()
    for form_field in move_fields(kind, keys, {}):
        if form_field.key in names:
            form[form_field.key] = names[form_field.key]
        elif form_field.kind in ENTERED_ALONE:
            form[form_field.key] = None
        elif kind.model_fields[form_field.key].is_required():  # a key that no field can enter
            return _NO_FIELDS
    return form
