"""The teach pendant in a browser: ``python -m tests.benchmarks.teach [RUNS]``.

From a click on Test to the first moving frame, how soon a click is answered while a run goes on, frames a second in the
view, and what many runs leave in memory. It needs a browser, and a machine that does nothing else.
"""

from __future__ import annotations

import re
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from tests.extensions.pendant.e2e.running import Running, browser, missing, running

RUNS = 100
_CLICKS = 60
_TESTS = 10
_WATCH = """() => {
  window.frames = [];
  let moved = false;
  const handle = viewer.handle_command.bind(viewer);
  viewer.handle_command = (command) => {
    moved ||= command.type === "set_transform";
    return handle(command);
  };
  const render = viewer.renderer.render.bind(viewer.renderer);
  viewer.renderer.render = (...given) => {
    const drawn = render(...given);
    if (moved) window.frames.push(performance.timeOrigin + performance.now());
    moved = false;
    return drawn;
  };
}"""
"""Notes in the view when a frame is drawn in which something has moved [ms]."""
_PRESS = """(button) => {
  button.click();
  return performance.timeOrigin + performance.now();
}"""
_ANSWER = """(button) => new Promise((resolve) => {
  const began = performance.now();
  const look = () => document.querySelector(".q-dialog") ? resolve(performance.now() - began) : setTimeout(look, 1);
  button.click();
  look();
})"""
"""How long it takes until the server has opened a window in the page [ms]."""


def pendant(runs: int = RUNS) -> Table:
    """Measure the pendant with the humanoid."""
    table = Table(
        "the teach pendant", "median", "95 % keep", "worst", title="humanoid_dynamic in a browser"
    )
    with (
        tempfile.TemporaryDirectory() as folder,
        running("humanoid", Path(folder)) as server,
        browser() as chromium,
    ):
        page = chromium.new_page(viewport={"width": 1400, "height": 1000})
        page.goto(server.url)
        page.get_by_role("button", name="Play", exact=True).and_(page.locator(":enabled")).wait_for(
            timeout=60_000
        )
        view = page.locator("iframe").element_handle().content_frame()
        view.wait_for_function("typeof viewer !== 'undefined' && viewer.renderer")
        time.sleep(2)  # until the robot is drawn
        view.evaluate(_WATCH)
        first, rates = _tests(page, view)
        _row(table, "from Test to the first moving frame [ms]", first)
        _row(table, "frames a second in the view", rates, high_is_good=True)
        _row(table, "a click answered while a run goes on [ms]", _clicks(page))
        table.add_row(
            f"left in memory by {runs} runs [MB]", f"{_memory(page, server, runs):.0f}", "", ""
        )
    return table


def _tests(page: Any, view: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return the time to the first moving frame [ms], and the frames a second, of tests of one second each."""
    firsts, rates = [], []
    for number in range(_TESTS):
        _set_elbow(page, 30 if number % 2 == 0 else 0)
        view.evaluate("() => { window.frames = []; }")
        pressed = page.get_by_role("button", name="2. Test").evaluate(_PRESS)
        view.wait_for_function("window.frames.length > 1")
        _wait(page)
        frames = np.array(view.evaluate("window.frames"))
        firsts.append(frames[0] - pressed)
        rates.append((len(frames) - 1) / np.ptp(frames) * 1e3)
    return np.array(firsts), np.array(rates)


def _clicks(page: Any) -> np.ndarray:
    """Return how soon clicks are answered while a walk goes on [ms]."""
    page.get_by_role("spinbutton", name="Steps").fill("60")
    page.get_by_role("button", name="Walk").click()
    answered = []
    asked = page.get_by_role("button", name=re.compile("^Keys"))
    for _ in range(_CLICKS):
        answered.append(asked.evaluate(_ANSWER))
        page.get_by_role("button", name="Close").click()
        page.locator(".q-dialog").wait_for(state="detached")
    stop = page.get_by_role("button", name="Stop")
    if stop.is_enabled():  # else the walk was over before
        stop.click()
    _wait(page)
    return np.array(answered)


def _memory(page: Any, server: Running, runs: int) -> float:
    """Return by how much server and run grow in so many tests [MB]; some before count as the beginning."""
    page.get_by_role("combobox", name="Speed", exact=True).click()
    page.get_by_role("option", name="fastest").click()
    before = 0.0
    warm = max(runs // 10, 5)
    for number in range(runs + warm):
        if number == warm:
            before = _used(server)
        _set_elbow(page, 30 if number % 2 == 0 else 0)
        page.get_by_role("button", name="2. Test").click()
        _wait(page)
        page.get_by_role("button", name="Discard move").click()
        _wait(page)
    return _used(server) - before


def _used(server: Running) -> float:
    """Return what server and run hold in memory [MB]."""
    statuses = [Path(f"/proc/{pid}/status").read_text() for pid in (server.pid, server.worker)]
    return sum(int(re.search(r"VmRSS:\s+(\d+)", status)[1]) for status in statuses) / 1e3


def _set_elbow(page: Any, angle: int) -> None:
    page.get_by_role("spinbutton", name=re.compile("left elbow: fore-arm up")).fill(str(angle))
    page.get_by_text("To be tested: ").wait_for()


def _wait(page: Any) -> None:
    page.wait_for_timeout(100)
    page.get_by_role("button", name="Stop").and_(page.locator(":disabled")).wait_for(timeout=60_000)


def _row(table: Table, name: str, values: np.ndarray, *, high_is_good: bool = False) -> None:
    ends = (0.05, 0.0) if high_is_good else (0.95, 1.0)
    table.add_row(name, *(f"{np.quantile(values, share):.0f}" for share in (0.5, *ends)))


if __name__ == "__main__":
    if why := missing():
        sys.exit(f"it {why}")
    Console(markup=False, width=120).print(pendant(int(sys.argv[1]) if sys.argv[1:] else RUNS))
