"""Forms for moves: what a kind declares as its form, and all else as it stands in the file."""

from collections.abc import Callable, Mapping
from functools import partial
from math import inf
from typing import Any

from nicegui import ui

from simrob_drake.base.errors import SimrobError
from simrob_drake.base.yaml_files import parse_yaml
from simrob_drake.extensions.pendant.form import Field, as_text, as_value, move_fields
from simrob_drake.extensions.pendant.move_labels import FormFields, labels_of
from simrob_drake.extensions.pendant.pages.elements import (
    NumberField,
    icon_button,
    page_keys,
    set_keys,
    set_label,
)
from simrob_drake.extensions.pendant.pages.joints import axis_field
from simrob_drake.extensions.pendant.pages.words import MILLI, Content, Phrases, Words
from simrob_drake.extensions.pendant.session import Session
from simrob_drake.programs.moves.kinds import KINDS
from simrob_drake.programs.moves.motion import ArmMotion
from simrob_drake.programs.moves.move import MOVE_TIME, Move, content_of, kind_of

SHORTEST, LONGEST = 0.05, 600.0  # durations of moves that fields take [s]
SPEED, _FASTEST = 200.0, 5000.0
"""Of an arm's tool unless another one is asked for, v200 of RAPID; and that a field takes [mm/s]."""
AXES, ORIGIN = "axes", "origin"
"""What a form asks for by fields of its own; see :mod:`simrob_drake.extensions.pendant.move_labels`."""
_AT_ORIGIN = [0.0] * 6

Read = Callable[[], dict[str, Any] | None]
"""Gives what a form holds, as a program's file has it; None where a field is wrong, which then says so."""
_Get = Callable[[], Any]


class _Refused(Exception):
    """A field holds what cannot be, and says so."""


def offers(session: Session, phrases: Phrases, choices: Content, kinds: list[type[Move]]) -> None:
    """Build a form and a button for each of some kinds of moves that ask for nothing that there is not.

    ``choices`` is what there is to choose among, by the words of their forms, and under ``moves`` what the robot can
    do: the keys that it can be given, by the key of the move.
    """
    possible = choices["moves"]
    for kind in kinds:
        form = labels_of(kind).form
        is_taught_elsewhere = AXES in form.values() or not form
        if is_taught_elsewhere or kind.key not in possible or not all(_there(choices, form)):
            continue
        with ui.row().classes("w-full items-start gap-2").props("role=group") as row:
            set_label(row, phrases.title(kind))
            read = move_form(phrases, choices, kind, {})
            button = ui.button(phrases.title(kind), on_click=partial(_try, session, read)).props(
                "no-caps"
            )
        letter = page_keys().free_letter(button.text)
        if letter:
            set_keys(button, f"Alt+{letter}")
            button.tooltip(f"Alt+{letter}")


def choices_of(session: Session, robot: Content) -> dict[str, Any]:
    """Return what the forms of moves choose among, for a robot of a session's description."""
    return {**robot, "pieces": session.description.get("pieces", ())}


def _there(choices: Content, form: FormFields) -> list[bool]:
    """For each field of a form that is chosen among things, whether there is one."""
    return [
        bool(choices.get(what))
        for what in form.values()
        if isinstance(what, str) and what != ORIGIN
    ]


def _try(session: Session, read: Read) -> None:
    move = read()
    if move is not None:
        session.try_move(move)


def stored_form(phrases: Phrases, choices: Content, move: Content) -> Read:
    """Build a form for a stored move as a file has it: what its kind asks for, and the rest as YAML."""
    kind = kind_of(move, KINDS.values())
    if kind is not None and issubclass(kind, ArmMotion):
        return _motion_form(phrases, kind, content_of(kind, move))
    if kind is None or not labels_of(kind).form:
        return yaml_form(phrases.t, phrases.t("legs.as_yaml"), move)
    content, form = content_of(kind, move), labels_of(kind).form
    asked = move_form(phrases, choices, kind, {key: content[key] for key in form if key in content})
    rest = yaml_form(
        phrases.t,
        phrases.t("legs.further"),
        {key: content[key] for key in content if key not in form},
    )

    def read() -> dict[str, Any] | None:
        entry, further = asked(), rest()
        return (
            None
            if entry is None or further is None
            else _entry(kind, {**content_of(kind, entry), **further})
        )

    return read


def _motion_form(phrases: Phrases, kind: type[Move], content: dict[str, Any]) -> Read:
    """Build a form for the speed of a stored move of an arm, or the time that it takes, whichever is filled last."""
    t, speed = phrases.t, content.get("speed")
    with ui.row().classes("items-start gap-2"):
        fields = speed_field(t, speed and speed / MILLI), duration_field(t, content.get("duration"))
    for one, other in (fields, fields[::-1]):
        one.field.on_value_change(
            lambda event, other=other: event.value is None or other.field.set_value(None)
        )
    rest = {
        key: value for key, value in content.items() if key not in ("speed", "duration", "times")
    }

    def read() -> dict[str, Any] | None:
        if any(field.value is None and field.field.value is not None for field in fields):
            return None
        fast, long = (field.value for field in fields)
        return {
            kind.key: rest
            | ({"duration": long} if long else {"speed": fast * MILLI} if fast else {})
        }

    return read


def _entry(kind: type[Move], content: dict[str, Any]) -> dict[str, Any]:
    return content if kind.key in kind.model_fields else {kind.key: content}


def move_form(phrases: Phrases, choices: Content, kind: type[Move], content: Content) -> Read:
    """Build the form that a kind of move declares; ``content`` is what it holds at first."""
    with ui.row().classes("items-start gap-2"):
        asked = labels_of(kind).form
        possible = choices["moves"].get(kind.key, ())
        keys = [key for key in asked if key in possible or key in content]
        own_fields = move_fields(kind, keys, content)
        fields = {field.key: _asked(phrases, choices, kind, field) for field in own_fields}

    def read() -> dict[str, Any] | None:
        try:
            held = {key: get() for key, get in fields.items()}
        except _Refused:
            return None
        return _entry(kind, {key: value for key, value in held.items() if value is not None})

    return read


def _asked(phrases: Phrases, choices: Content, kind: type[Move], field: Field) -> _Get:
    """Build what asks for a field of a move, and return what reads it."""
    what, label = labels_of(kind).form[field.key], phrases.field(kind, field.key)
    value = field.value
    if value is None:
        value = field.default if what is None or isinstance(what, str) else what
    optional = not kind.model_fields[field.key].is_required()
    if what == AXES:
        return _targets(phrases, choices[AXES], value or {})
    if what == ORIGIN:
        here = ui.checkbox(label, value=value is not None)
        return lambda: (value or _AT_ORIGIN) if here.value else None
    if isinstance(what, str) or field.kind == "choice":
        names = list(choices[what] if isinstance(what, str) else field.choices)
        return _chosen(phrases, label, names, value, optional=optional)
    if field.kind == "switch":
        box = ui.checkbox(label, value=bool(value))
        return lambda: box.value
    if field.kind == "number":
        return _number(phrases.t, label, field, value, optional=optional)
    return _text(phrases.t, label, field)


def _chosen(phrases: Phrases, label: str, names: list[str], value: Any, *, optional: bool) -> _Get:
    known = names if value is None or value in names else [*names, value]
    usual: dict[str | None, str] = {None: phrases.t("legs.usual")} if optional else {}
    options = usual | dict(phrases.names(known))
    first = value if optional or value is not None else known[0]
    select = (
        ui.select(options, value=first, label=label)
        .props("dense outlined options-dense")
        .classes("w-40")
    )
    return lambda: select.value


def _number(t: Words, label: str, field: Field, value: Any, *, optional: bool) -> _Get:
    low, high = -inf if field.low is None else field.low, inf if field.high is None else field.high
    unit, step = f" {field.unit}" if field.unit else "", 1.0 if field.whole else 0.1
    number = NumberField(
        t, label, value, low=low, high=high, unit=unit, step=step, whole=field.whole
    )
    number.field.classes("w-28")

    def get() -> float | None:
        if optional and number.field.value is None:
            return None
        if (held := number.needed()) is None:
            raise _Refused
        return held

    return get


def _text(t: Words, label: str, field: Field) -> _Get:
    box = ui.input(label, value=as_text(field.value)).props("dense outlined")

    def get() -> Any:
        try:
            return as_value(field, box.value or "")
        except SimrobError as problem:
            box.error = t.render(str(problem))
            raise _Refused from problem

    return get


def duration_field(t: Words, value: float | None = MOVE_TIME) -> NumberField:
    """Build a field for the duration of a move [s]."""
    return NumberField(
        t, t("fields.duration"), value, low=SHORTEST, high=LONGEST, unit=" s", step=0.1
    )


def speed_field(t: Words, value: float | None = SPEED) -> NumberField:
    """Build a field for the speed of an arm's tool [mm/s]."""
    return NumberField(t, t("fields.speed"), value, low=1.0, high=_FASTEST, unit=" mm/s", step=10)


def yaml_form(t: Words, label: str, content: Content) -> Read:
    """Build a form for something as a file has it."""
    held = as_text(content).removeprefix("{").removesuffix("}")
    field = ui.input(label, value=held).props("outlined").classes("w-full")

    def read() -> dict[str, Any] | None:
        try:
            read = parse_yaml("{" + field.value + "}", label)
        except SimrobError as problem:
            field.error = t.render(str(problem))
            return None
        return read if isinstance(read, dict) else None

    return read


def _targets(phrases: Phrases, axes: list[Content], targets: Mapping[str, float]) -> _Get:
    """Build fields for targets of axes, to which others can be added."""
    t, known = phrases.t, {name: axis for axis in axes for name in (axis["name"], *axis["aliases"])}
    fields: dict[str, NumberField] = {}
    rows = ui.column().classes("w-full gap-2")

    def add(name: str, value: float) -> None:
        with rows, ui.row().classes("w-full items-center no-wrap gap-2") as row:
            fields[name] = axis_field(phrases, known[name], value)
            fields[name].field.classes("grow")

            def drop() -> None:
                del fields[name]
                row.delete()

            icon_button("delete", f"{t('legs.delete')}: {phrases.axis(name)}", drop)

    for name, value in targets.items():
        add(name, value)
    others = {axis["name"]: phrases.axis(axis["name"]) for axis in axes}
    more = (
        ui.select(others, label=t("legs.add_joint"), with_input=True)
        .props("dense outlined")
        .classes("w-full")
    )

    def take() -> None:
        if more.value and not any(known[name]["name"] == more.value for name in fields):
            add(more.value, known[more.value]["now"])
        more.value = None

    more.on_value_change(take)

    def get() -> dict[str, float]:
        held = {name: field.needed() for name, field in fields.items()}
        found = {name: value for name, value in held.items() if value is not None}
        if len(found) < len(held):
            raise _Refused
        return found

    return get
