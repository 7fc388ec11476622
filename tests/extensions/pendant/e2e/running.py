"""The pendant as a user starts it, in a process of its own, and a browser without a screen in front of it."""

import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Thread
from urllib.parse import urlsplit

ROOT = Path(__file__).parents[4]
_BROWSERS = ("chromium", "chromium-browser", "google-chrome")
_FLAGS = [
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
]
"""Three dimensions on a machine without a graphics card."""
_ADDRESS = re.compile(r"(http://\S+)")
_PATIENCE = (
    120.0  # s that it may take until the page can be opened, on a machine that does other things
)


def missing() -> str:
    """Return what a browser test lacks here; nothing if it can be run."""
    try:
        import nicegui  # noqa: F401
        import playwright.sync_api  # noqa: F401
    except ImportError as problem:
        return f"needs {problem.name}"
    return "" if browser_file() else f"needs a browser: {', '.join(_BROWSERS)}"


def browser_file() -> str | None:
    """Return the program of the browser, or None where there is none."""
    return next((found for name in _BROWSERS if (found := shutil.which(name))), None)


@contextmanager
def browser(**how) -> Iterator:
    """Run a browser without a screen."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=browser_file(), args=_FLAGS, **how)
        try:
            yield running
        finally:
            running.close()


class Running:
    """``simrob teach`` in a process of its own.

    Attributes:
        folder: where what is taught is kept.
    """

    def __init__(self, subject: str | Path, folder: Path, *options: str) -> None:
        self.subject, self.folder, self._options = str(subject), folder, options
        self._port = (
            0  # any at first, whoever else is there; then always this one, as its pages expect
        )
        self.start()

    def start(self) -> None:
        """Start it, and wait until the page can be opened."""
        command = [sys.executable, "-m", "simrob_drake.cli", "teach", self.subject, "--no-browser"]
        command += ["--port", str(self._port)]
        environment = {
            **os.environ,
            "PYTHONPATH": str(ROOT),
            "OPENBLAS_NUM_THREADS": "1",
            "COLUMNS": "200",
        }
        self._process = subprocess.Popen(
            [*command, "--folder", str(self.folder), *self._options],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env=environment,
        )
        self.said: list[str] = []
        lines: SimpleQueue[str] = SimpleQueue()
        Thread(target=self._listen, args=(lines,), daemon=True).start()
        while True:
            try:
                line = lines.get(timeout=_PATIENCE)
            except Empty as problem:
                self.stop()
                raise AssertionError(f"no page: {''.join(self.said)}") from problem
            if _ADDRESS.search(line):
                self._port = urlsplit(self.url).port
                return
            if not line:
                raise AssertionError(f"it ended: {''.join(self.said)}")

    def _listen(self, lines: "SimpleQueue[str]") -> None:
        for line in self._process.stdout:
            self.said.append(line)
            lines.put(line)
        lines.put("")

    @property
    def url(self) -> str:
        """The newest address of the page; each opens one browser."""
        return next(found[1] for line in reversed(self.said) if (found := _ADDRESS.search(line)))

    @property
    def pid(self) -> int:
        """The number of the server's process."""
        return self._process.pid

    @property
    def worker(self) -> int:
        """The number of the process in which the station runs."""
        children = [Path(f"/proc/{pid}") for pid in _children(self.pid)]
        return next(
            int(one.name) for one in children if b"spawn_main" in (one / "cmdline").read_bytes()
        )

    def kill(self) -> None:
        """Kill the server, as a power cut would."""
        self._process.kill()
        self._process.wait()

    def kill_worker(self) -> None:
        """Kill the process in which the station runs."""
        os.kill(self.worker, signal.SIGKILL)

    def stop(self) -> None:
        """End it as Ctrl+C does."""
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGINT)
            try:
                self._process.wait(timeout=10)
            except subprocess.TimeoutExpired:
                self.kill()


def _children(pid: int) -> list[str]:
    return [
        pid
        for task in Path(f"/proc/{pid}/task").iterdir()
        for pid in (task / "children").read_text().split()
    ]


@contextmanager
def running(subject: str | Path, folder: Path, *options: str) -> Iterator[Running]:
    """Run the pendant for a while."""
    pendant = Running(subject, folder, *options)
    try:
        yield pendant
    finally:
        pendant.stop()


def choose_from_end(page, menu: str, number: int) -> None:
    """Choose an option of a menu by its number from the end, 1 for the last; see `choose_option`."""
    from playwright.sync_api import TimeoutError as NotShown
    from playwright.sync_api import expect

    option = page.get_by_role("option").nth(-number)
    for _ in range(8):
        page.get_by_role("combobox", name=menu, exact=True).click()
        try:
            option.click(timeout=5_000)
        except NotShown:
            continue
        expect(page.get_by_role("listbox")).to_be_hidden()
        return
    raise AssertionError(f"the menu {menu} has no option {number} from its end")


def choose_option(page, menu: str, option: str, *, within: str = "body") -> None:
    """Choose an option of a menu, and see it chosen.

    A menu of a page that is still laid out may close at once: a user clicks again, and so does this.

    Args:
        menu: the menu's name.
        option: the option's whole name.
        within: the CSS selector of the part of the page where the menu shows what is chosen.
    """
    from playwright.sync_api import TimeoutError as NotShown
    from playwright.sync_api import expect

    chosen = page.locator(within).get_by_text(option, exact=True)
    for _ in range(8):
        if chosen.count():  # a test before has left it so, or the click was taken
            break
        page.get_by_role("combobox", name=menu, exact=True).click()
        with suppress(NotShown):
            page.get_by_role("option", name=option, exact=True).click(timeout=5_000)
            expect(page.get_by_role("listbox")).to_be_hidden()
            expect(chosen).to_be_visible()
    expect(chosen).to_be_visible()
