"""Forms for the moves of a program: a walk, targets of joints, and any other as it stands in the file."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from nicegui import ui

from simrob_drake.errors import SimrobError
from simrob_drake.programs.moves import MOST_AMPLITUDE, MOST_STEPS, MOVE_TIME
from simrob_drake.teach.form import as_text
from simrob_drake.teach.pages.buttons import icon_button
from simrob_drake.teach.pages.fields import NumberField
from simrob_drake.teach.pages.joints import axis_field
from simrob_drake.teach.pages.phrases import Content, Phrases
from simrob_drake.teach.pages.words import Words
from simrob_drake.yaml_files import parse_yaml

SHORTEST, LONGEST = 0.05, 600.0
"""Durations of moves that fields take [s]."""
_STEPS = 4  # of a walk, at first

Read = Callable[[], dict[str, Any] | None]
"""Gives what a form holds, as a program's file has it; None where a field is wrong, which then says so."""


def duration_field(t: Words, value: float = MOVE_TIME) -> NumberField:
    """Build a field for the duration of a move [s]."""
    return NumberField(t, t("legs.duration"), value, low=SHORTEST, high=LONGEST, unit=" s", step=0.1)


def walk_form(phrases: Phrases, gaits: Sequence[str], walk: Mapping[str, Any] | None = None) -> Read:
    """Build a form for what a walk is; ``walk`` is what it holds at first."""
    t, given = phrases.t, dict(walk or {})
    steps = NumberField(t, t("legs.steps"), given.get("steps", _STEPS), low=-MOST_STEPS, high=MOST_STEPS, whole=True)
    amplitude = NumberField(
        t, t("legs.amplitude"), given.get("amplitude", 1.0), low=-MOST_AMPLITUDE, high=MOST_AMPLITUDE, step=0.1
    )
    choices: dict[str | None, str] = {None: t("legs.usual_gait"), **{gait: phrases.name(gait) for gait in gaits}}
    gait = ui.select(choices, value=given.get("gait"), label=t("legs.gait")).props("dense outlined options-dense")
    steps.field.classes("w-20")
    amplitude.field.classes("w-24")
    gait.classes("w-36")

    def read() -> dict[str, Any] | None:
        count, size = steps.needed(), amplitude.needed()
        if count is None or size is None:
            return None
        return {**given, "steps": count, "amplitude": size, "gait": gait.value}

    return read


def move_form(phrases: Phrases, robot: Content, move: Content) -> Read:
    """Build a form for a move of a robot of the description; ``move`` is what it holds at first."""
    if "target_deg" in move:
        return _targets_form(phrases, robot["axes"], move)
    if "walk" in move:
        with ui.row().classes("items-start gap-2"):
            walk = walk_form(phrases, robot["gaits"], move["walk"])
        return lambda: None if (content := walk()) is None else {"walk": content}
    return yaml_form(phrases.t, move)


def yaml_form(t: Words, content: Content) -> Read:
    """Build a form for something as a file has it."""
    field = (
        ui.input(t("legs.as_yaml"), value=as_text(content).removeprefix("{").removesuffix("}"))
        .props("outlined")
        .classes("w-full")
    )

    def read() -> dict[str, Any] | None:
        try:
            read = parse_yaml("{" + field.value + "}", t("legs.as_yaml"))
        except SimrobError as problem:
            field.error = str(problem)
            return None
        return read if isinstance(read, dict) else None

    return read


def _targets_form(phrases: Phrases, axes: Sequence[Content], move: Content) -> Read:
    """Build a form for targets of axes, to which others can be added, and a duration."""
    t, known = phrases.t, {name: axis for axis in axes for name in (axis["name"], *axis["aliases"])}
    fields: dict[str, NumberField] = {}
    rows = ui.column().classes("w-full gap-2")

    def add(name: str, value: float) -> None:
        with rows, ui.row().classes("w-full items-center no-wrap gap-2") as row:
            fields[name] = axis_field(phrases, known[name], value, titled=True)
            fields[name].field.classes("grow")

            def drop() -> None:
                del fields[name]
                row.delete()

            icon_button("delete", f"{t('legs.delete')}: {phrases.axis(name)}", drop)

    for name, value in move["target_deg"].items():
        add(name, value)
    others = {axis["name"]: phrases.axis(axis["name"]) for axis in axes}
    more = ui.select(others, label=t("legs.add_joint"), with_input=True).props("dense outlined").classes("w-full")

    def take() -> None:
        if more.value and not any(known[name]["name"] == more.value for name in fields):
            add(more.value, known[more.value]["now"])
        more.value = None

    more.on_value_change(take)
    duration = duration_field(t, move["duration"])

    def read() -> dict[str, Any] | None:
        targets, seconds = {name: field.needed() for name, field in fields.items()}, duration.needed()
        if None in targets.values() or seconds is None:
            return None
        return {"target_deg": targets, "duration": seconds}

    return read
