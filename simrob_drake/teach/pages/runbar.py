"""The bar that runs what is taught: play, pause, tick, stop, pace, and the way back through all that was run."""

from nicegui import ui

from simrob_drake.programs.timeline import GRID
from simrob_drake.teach.pages.elements import follow, icon_button, set_label
from simrob_drake.teach.pendant import Pendant

PACES = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0)
_FASTEST = "max"


def build(pendant: Pendant) -> None:
    """Build the bar, and the line of messages below it."""
    session, t = pendant.session, pendant.t
    with ui.element("div").classes("pendant-run").props("role=toolbar") as bar:
        set_label(bar, t("run.bar"))
        start = icon_button("skip_previous", t("run.start"), lambda: session.rewind(0.0), keys="Home")
        play = icon_button("play_arrow", t("run.play"), lambda: _play(pendant), keys="Space")
        tick = icon_button("redo", t("run.tick"), lambda: _tick(pendant), keys=".")
        stop = icon_button("stop", t("run.stop"), session.stop, keys="Shift+S")
        scrubber = ui.slider(min=0.0, max=1.0, step=0.05)
        scrubber.on("update:model-value", lambda event: session.rewind(float(event.args)), throttle=0.1)
        set_label(scrubber, t("run.scrub"))
        clock = ui.label().classes("pendant-time")
        _pace(pendant)
    message = ui.label().classes("pendant-message").props("role=status aria-live=polite")

    def phase() -> None:
        running = session.phase == "running"
        play.props["icon"] = "pause" if running else "play_arrow"
        set_label(play, t("run.pause" if running else "run.play"))
        can = session.phase in ("idle", "running", "paused") and not (_at_end(pendant) and session.pending)
        play.set_enabled(can)
        stop.set_enabled(session.phase in ("running", "paused"))
        tick.set_enabled(can and not running)
        start.set_enabled(session.reach > 0.0)
        time()

    def time() -> None:
        scrubber.props["max"] = max(session.reach, _grid(pendant))
        scrubber.props["step"] = _grid(pendant)
        scrubber.value = session.time
        running = session.phase == "running"
        clock.text = t("run.time", time=f"{session.time:.2f}", reach=f"{session.reach:.2f}") + (
            f"  {t('run.ratio', ratio=f'{session.ratio:.1f}')}" if running else ""
        )

    def tell() -> None:
        notice = session.message
        message.text = t(f"notice.{notice.key}", **notice.fills) if notice.key else t.of_engine(str(notice))
        message.classes(add="pendant-wrong" if notice.wrong else "", remove="" if notice.wrong else "pendant-wrong")

    follow(session, phase, "phase", "program", "description")
    follow(session, time, "tick")
    follow(session, tell, "message")


def _grid(pendant: Pendant) -> float:
    return pendant.session.program.grid or GRID


def _at_end(pendant: Pendant) -> bool:
    """Tell whether nothing runs, and no moment is shown that was run before others."""
    session = pendant.session
    return session.phase == "idle" and session.time >= session.reach - _grid(pendant) / 2


def _play(pendant: Pendant) -> None:
    """Pause, go on, or run all from the start, whichever comes next."""
    session = pendant.session
    if session.phase == "running":
        session.pause()
    elif _at_end(pendant):
        session.simulate()
    else:
        session.go_on()


def _tick(pendant: Pendant) -> None:
    """Go on for one tick, from a pause or from what comes next."""
    if pendant.session.phase == "paused":
        pendant.session.one_tick()
    else:
        _play(pendant)
        pendant.session.pause()  # at its first tick


def _pace(pendant: Pendant) -> None:
    session, t = pendant.session, pendant.t
    options = {**{str(pace): f"{pace:g} ×" for pace in PACES}, _FASTEST: t("run.fastest")}
    paces = {**{str(pace): pace for pace in PACES}, _FASTEST: None}
    select = ui.select(options, label=t("run.pace")).props("dense options-dense outlined").style("min-width: 6.5rem")

    def chosen(value: str) -> None:
        if paces[value] != session.pace:  # else it was shown, not chosen
            session.set_pace(paces[value])

    select.on_value_change(lambda event: chosen(event.value))

    def show() -> None:
        select.set_value(str(session.pace) if session.pace is not None else _FASTEST)

    follow(session, show, "phase")
