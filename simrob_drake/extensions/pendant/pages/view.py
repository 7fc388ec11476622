"""What shows a run, where bodies can be dragged; a pad that pushes them; and the bar that plays it, and goes back."""

from asyncio import wrap_future
from base64 import b64encode
from collections.abc import Mapping
from functools import partial
from pathlib import Path

from nicegui import background_tasks, ui

from simrob_drake.extensions.pendant.pages import drive, hand
from simrob_drake.extensions.pendant.pages.elements import (
    NumberField,
    allow,
    follow,
    icon_button,
    name_value_text,
    set_keys,
    set_label,
)
from simrob_drake.extensions.pendant.pages.words import Words
from simrob_drake.extensions.pendant.pendant import PushFields
from simrob_drake.extensions.pendant.push_sides import SIDES
from simrob_drake.extensions.pendant.session import Session
from simrob_drake.programs.timeline import GRID


def build(session: Session, t: Words) -> None:
    """Build the view of a session's run."""
    with ui.element("div").classes("pendant-view") as place:
        opening = ui.label(t("why.opening")).classes("pendant-opening")
        ghost = ui.label().classes("pendant-ghost")

    def tell() -> None:
        opening.set_visibility(session.phase == "opening")
        run = session.run.ghost
        ghost.set_visibility(run is not None)
        if run is not None:
            ghost.text = t("shell.ghost", run=t("run.earlier", number=run.number))

    follow(session, tell, "phase", "history", "tick")

    async def show() -> None:
        can = await ui.run_javascript("window.hasWebGL()", timeout=10.0)
        with place:
            _frame(session, t) if can else _stills(session, t)
            drive.build(session, t)

    ui.timer(0.0, show, once=True)


def _frame(session: Session, t: Words) -> None:
    frame = ui.element("iframe").props(f"id={hand.FRAME} src=view/")
    frame.props["title"] = t("shell.view")
    frame.on("load", js_handler="(event) => window.viewShown(event.target)")
    frame.on("load", hand.build(session, t))


def _stills(session: Session, t: Words) -> None:
    """Show each run as a strip of pictures when it has ended, and why."""
    with ui.element("div").classes("pendant-still"):
        ui.label(t("shell.no_webgl"))
        strip = ui.element("img")
        strip.props["alt"] = t("shell.view")

    async def draw() -> None:
        file = await wrap_future(session.exports.film_strip())
        if file is not None:
            strip.props["src"] = (
                f"data:image/png;base64,{b64encode(Path(file).read_bytes()).decode()}"
            )

    drawn = session.run.ending

    def show() -> None:
        nonlocal drawn
        if session.phase == "idle" and session.run.ending is not drawn:
            drawn = session.run.ending
            background_tasks.create(draw())

    follow(session, show, "phase")


_MOST = 10_000.0
"""Largest force of a push [N]."""
_LONGEST = 60.0
"""Longest push [s]."""
_UNTIL_OPEN = 0.4
"""Time that the pad of pushes takes to open [s]."""


def build_pad(session: Session, t: Words, kept: PushFields) -> None:
    """Build the pad with which bodies are pushed; its buttons act while a run goes on.

    Args:
        session: the session of the page's user.
        t: texts in the language of the page.
        kept: the fields as the user left them. They are the same when the page is loaded again.
    """
    fold = ui.expansion(t("push.title"), icon="back_hand", value=kept.is_open).bind_value_to(
        kept, "is_open"
    )
    with fold.classes("w-full").props("dense"):
        with ui.row().classes("w-full items-start gap-2"):
            body = (
                ui.select([], label=t("push.body"), with_input=True)
                .props("dense outlined")
                .classes("w-44")
            )
            force = NumberField(t, t("push.force"), kept.force, low=0.0, high=_MOST, unit=" N")
            duration = NumberField(
                t, t("push.duration"), kept.duration, low=0.01, high=_LONGEST, unit=" s", step=0.05
            )
            for field, name in ((force, "force"), (duration, "duration")):
                field.field.classes("w-28").bind_value_to(kept, name)
        with ui.row().classes("w-full items-center gap-1") as pad:
            set_label(pad.props("role=group"), t("push.pad"))
            buttons = {
                side: ui.button(side).props("outline no-caps dense").classes("px-2")
                for side in SIDES
            }
        ui.label(t("push.hint")).classes("text-xs opacity-70")

    def push(side: str) -> None:
        """Push the chosen body towards a side, if all fields are filled in."""
        size = force.needed()
        seconds = duration.needed()
        if size is not None and seconds is not None and body.value:
            session.push(body.value, (size * SIDES[side]).tolist(), seconds)

    for side, button in buttons.items():
        button.on_click(partial(push, side))
    _build_jump(fold, body, t)

    def show_bodies() -> None:
        """Offer the bodies of the station."""
        bodies = list(session.description.get("bodies", ()))
        if bodies != body.options:
            first = session.book.robot if session.book.robot in bodies else next(iter(bodies), None)
            body.set_options(bodies, value=kept.body if kept.body in bodies else first)
        show_sides()

    def show_sides() -> None:
        """Say on each button where the side of the chosen body points."""
        kept.body = body.value or kept.body
        _name_sides(buttons, session.description.get("push_sides", {}).get(body.value, {}), t)

    def show_phase() -> None:
        """Allow the buttons while a run goes on."""
        for button in buttons.values():
            allow(button, _unless(session, t, *_RUNS))

    body.on_value_change(show_sides)
    follow(session, show_bodies, "description")
    follow(session, show_phase, "phase")


def _build_jump(fold: ui.expansion, body: ui.select, t: Words) -> None:
    """Build the button that opens the pad of pushes and puts the focus there. It is seen when it has the focus itself.

    Args:
        fold: the part of the page with the pad.
        body: the first field of the pad.
        t: texts in the language of the page.
    """

    def jump() -> None:
        """Open the pad, and put the focus on its first field."""
        fold.set_value(True)
        # The field is seen only after the pad has been opened.
        ui.timer(_UNTIL_OPEN, lambda: body.run_method("focus"), once=True)

    button = ui.button(t("push.jump"), on_click=jump).props("dense no-caps")
    set_keys(button.classes("pendant-jump"), "Alt+U")


def _name_sides(buttons: Mapping[str, ui.button], words: Mapping[str, str], t: Words) -> None:
    """Write on the buttons of a pad where the sides of a body point.

    Args:
        buttons: the buttons, by side, such as ``+x``.
        words: where the sides point, by side, such as ``left``. Sides that are oblique have no word.
        t: texts in the language of the page.
    """
    for side, button in buttons.items():
        text = f"{side} {t('push.' + words[side])}" if side in words else side
        button.text = text
        set_label(button, t("push.along", side=text))


PACES = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0)
_FASTEST = "max"


def build_bar(session: Session, t: Words) -> None:
    """Build the bar that plays a run, stops it and goes back in it."""
    with ui.element("div").classes("pendant-run").props("role=toolbar") as bar:
        set_label(bar, t("run.bar"))
        start = icon_button(
            "skip_previous",
            t("run.start"),
            lambda: session.rewind(0.0),
            keys="Home",
            t=t,
            is_tip_above=True,
        )
        play = icon_button(
            "play_arrow",
            t("run.play"),
            lambda: _play(session),
            keys="Space",
            t=t,
            is_tip_above=True,
        )
        tick = icon_button(
            "keyboard_tab", t("run.tick"), lambda: _tick(session), keys=".", t=t, is_tip_above=True
        )
        stop = icon_button(
            "stop", t("run.stop"), session.stop, keys="Shift+S", t=t, is_tip_above=True
        )
        scrubber = ui.slider(min=0.0, max=1.0, step=0.05)
        scrubber.on(
            "update:model-value", lambda event: session.rewind(float(event.args)), throttle=0.1
        )
        set_label(scrubber, t("run.scrub"))
        state = ui.label().classes("pendant-state")
        # Both have their place also when they are empty: the bar keeps its height, and the view its size.
        with ui.element("div").classes("pendant-clock"):
            clock = ui.label().classes("pendant-time")
            ratio = ui.label().classes("pendant-ratio")
        name_value_text(scrubber, clock)
        _pace(session, t)

    def phase() -> None:
        running = session.phase == "running"
        play.props["icon"] = "pause" if running else "play_arrow"
        set_label(play, t("run.pause" if running else "run.play"))
        undecided = t("why.undecided") if _at_end(session) and session.book.pending else ""
        cannot = _unless(session, t, "idle", *_RUNS) or undecided
        allow(play, cannot)
        allow(stop, _unless(session, t, *_RUNS))
        allow(tick, cannot or (t("why.running") if running else ""))
        allow(
            start,
            _unless(session, t, "idle", *_RUNS)
            or ("" if session.run.reach > 0.0 else t("why.at_start")),
        )
        shown = session.run.shown
        state.text = (
            t(f"phase.{session.phase}") if shown is None else t("run.earlier", number=shown.number)
        )
        time()

    def time() -> None:
        first, last = session.run.span
        scrubber.props["min"], scrubber.props["max"] = first, max(last, first + _grid(session))
        scrubber.props["step"] = _grid(session)
        scrubber.value = session.run.time
        running = session.phase == "running"
        times = {"time": t.decimals(session.run.time, 2), "reach": t.decimals(last, 2)}
        clock.text = t("run.time", **times)
        ratio.text = t("run.ratio", ratio=t.decimals(session.run.ratio, 1)) if running else ""

    follow(session, phase, "phase", "program", "description")
    follow(session, time, "tick")


_RUNS = "running", "paused"


def _unless(session: Session, t: Words, *phases: str) -> str:
    """Return why something cannot be done that can in some phases; nothing in these."""
    return "" if session.phase in phases else t(f"why.{session.phase}")


def _grid(session: Session) -> float:
    return session.book.program.grid or GRID


def _at_end(session: Session) -> bool:
    """Tell whether nothing runs, and no moment was gone back to; where what came next was discarded is an end, too."""
    run = session.run
    goes_on = run.shown is None and run.rewound and run.time < run.reach - _grid(session) / 2
    return session.phase == "idle" and not goes_on


def _play(session: Session) -> None:
    """Pause, go on, or run all from the start, whichever comes next."""
    if session.phase == "running":
        session.pause()
    elif _at_end(session):
        session.simulate()
    else:
        session.go_on()


def _tick(session: Session) -> None:
    """Go on for one tick, from a pause or from what comes next."""
    if session.phase == "paused":
        session.one_tick()
    else:
        _play(session)
        session.pause()  # at its first tick


def _pace(session: Session, t: Words) -> None:
    options = {**{str(pace): f"{t.figure(pace)} ×" for pace in PACES}, _FASTEST: t("run.fastest")}
    select = (
        ui.select(options, label=t("run.pace"))
        .props("dense options-dense outlined")
        .style("min-width: 6.5rem")
    )

    def chosen(value: str) -> None:
        pace = None if value == _FASTEST else float(value)
        if pace != session.client.pace:  # else it was shown, not chosen
            session.set_pace(pace)

    select.on_value_change(lambda event: chosen(event.value))

    def show() -> None:
        select.set_value(str(session.client.pace) if session.client.pace is not None else _FASTEST)

    follow(session, show, "phase")
