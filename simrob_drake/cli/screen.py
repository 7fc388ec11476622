"""Output of the commands on the screen, and interrupts by the user (Ctrl-C) while files are written.

Results go to the output stream (``console``), warnings and errors to the error stream (``errors``). Texts are messages:
each function here translates them into the language of the output. Texts are wrapped at words. Paths, addresses and
commands are never broken, so that a user can copy them.
"""

import re
import shlex
import signal
import sys
import textwrap
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from threading import current_thread, main_thread
from typing import Literal, TextIO

from rich.console import Console
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

from simrob_drake.base.errors import shortened
from simrob_drake.base.messages import message, translate
from simrob_drake.base.remarks import SEVERITY_WORDS, Remark, Remedy, Severity

_LONGEST = 2000
"""Largest count of characters of an error. A message may quote a user's file, which may be one long line."""

WIDTH = 80
"""Columns of an output that is no terminal, such as a file: what a page of text and most editors show."""


def _width_of(stream: TextIO) -> int | None:
    """Columns of an output stream, or None for a terminal, whose width rich finds."""
    return None if stream.isatty() else WIDTH


# Paths and units have brackets and colons, so rich must not take them for mark-up or emojis.
console = Console(markup=False, emoji=False, highlight=False, width=_width_of(sys.stdout))
errors = Console(
    markup=False, emoji=False, highlight=False, stderr=True, width=_width_of(sys.stderr)
)

SEVERITY_STYLES: dict[Severity, str] = {
    "success": "green",
    "note": "dim",
    "warning": "yellow",
    "failure": "red",
}
"""Styles of rich for the severities of remarks. An output that is no terminal has no colours."""

# The longest word of a severity, with a space behind it. Longer words of another language are followed by no space.
_INDENT = " " * len("warning ")
"""Indentation of the text of a remark."""

_SETTINGS_INDENT = f"{_INDENT}  "
"""Indentation of the settings of a remedy."""

_LABEL_WIDTH = len("recording")
"""Width of the longest of the labels of :func:`say_place`."""

# Labels in front of paths and commands, see `say_place`.
NEXT = message("cli.next", "next")
PROGRAM = message("cli.program", "program")
RESULT = message("cli.result", "result")
ROBOT = message("cli.robot", "robot")
STATION = message("cli.station", "station")
TABLE = message("cli.table", "table")
WRITTEN = message("cli.written", "written")


def say(text: str | Text) -> None:
    """Write a text in the language of the output as one line, however long it is."""
    # A text of rich has been translated by its caller.
    line = translate(text) if isinstance(text, str) else text
    console.print(line, soft_wrap=True)


def say_text(text: str, style: str = "", target: Console = console) -> None:
    """Write a text in the language of the output, wrapped at words.

    A word that is longer than a line, such as a path, is not broken. An empty text is an empty line.

    Args:
        text: the text.
        style: style of rich, such as ``green``; empty for the usual one.
        target: where it is written.
    """
    lines = _wrap(translate(text), target.width) or [""]
    for line in lines:
        target.print(Text(line, style), soft_wrap=True)


def _wrap(text: str, width: int) -> list[str]:
    """Wrap a text to lines of a width. Words are not broken, and an option stays in one line with its setting."""
    whole_settings = keep_settings_whole(text)
    # Words are not broken at hyphens: they may be options or paths.
    lines = textwrap.wrap(
        whole_settings,
        max(width, _NARROWEST),
        break_long_words=False,
        break_on_hyphens=False,
    )
    # The no-break spaces have done their work. A shell would not take them for spaces.
    return [line.replace(_NO_BREAK_SPACE, " ") for line in lines]


_NO_BREAK_SPACE = "\N{NO-BREAK SPACE}"

_SETTING = re.compile(r"--[\w-]+ (?:'[^']*'|[\w.]+=\S*)")
"""An option with its setting, such as ``--set servo.kp=500``; a setting in quotes may have spaces."""


def keep_settings_whole(text: str) -> str:
    """Join options and their settings by spaces at which no line ends, so that a user can copy them."""
    return _SETTING.sub(lambda found: found[0].replace(" ", _NO_BREAK_SPACE), text)


def say_place(label: str, place: object) -> None:
    """Write a label, and next to it a path, an address or a command, unbroken, so that a user can copy it.

    A place that does not fit next to its label is written on a line of its own.

    Args:
        label: the label, a message. If it is empty, the place belongs to the label of the line above.
        place: the path, address or command.
    """
    # Labels take the width of the longest one, so that the places of one output line up.
    shown_label = translate(label)
    line = f"{shown_label:{_LABEL_WIDTH}} {place}"
    if len(line) <= console.width:
        say(line)
        return
    if shown_label:
        say(shown_label)
    say(str(place))


def say_warning(text: str, word: str = SEVERITY_WORDS["warning"]) -> None:
    """Write a warning on the error stream, with a coloured word before it. Further lines are indented."""
    _say_hanging(errors, Text(translate(word), SEVERITY_STYLES["warning"]), text)


def say_remark(remark: Remark, *, with_remedy: bool = True) -> None:
    """Write a remark about a run: warnings and failures on the error stream, with their remedy in lines of its own.

    Args:
        remark: the remark.
        with_remedy: whether the remedy is written. Several remarks may have the same one.
    """
    # A script that reads the output stream gets the results alone.
    target = errors if remark.severity in ("warning", "failure") else console
    word = translate(SEVERITY_WORDS[remark.severity])
    _say_hanging(target, Text(word, SEVERITY_STYLES[remark.severity]), remark.text)
    remedy = remark.remedy
    if remedy is None or not with_remedy:
        return
    _say_hanging(target, Text(""), f"→ {translate(remedy.text)}")
    # The options have lines of their own, so that a user can copy them.
    width = target.width - len(_SETTINGS_INDENT)
    for line in _wrap(_options_of_remedy(remedy), width):
        target.print(f"{_SETTINGS_INDENT}{line}", soft_wrap=True)


def _options_of_remedy(remedy: Remedy) -> str:
    """Write the options ``--set`` with which a remedy is tried: ``--set servo.kp=500``.

    If the remedy names a key of the station without a value, the user is to choose it: ``--set servo.kp=...``. Empty if
    the remedy names no key.
    """
    if remedy.settings:
        return " ".join(f"--set {_quoted_for_shell(setting)}" for setting in remedy.settings)
    return f"--set {remedy.key}=..." if remedy.key else ""


def _quoted_for_shell(setting: str) -> str:
    """Quote a setting that has spaces, so that a shell takes it as one argument."""
    return shlex.quote(setting) if " " in setting else setting


def _say_hanging(target: Console, word: Text, text: str) -> None:
    """Write a word and a text. The text is wrapped at words, and all of its lines begin at the same column.

    Args:
        target: where it is written.
        word: the word with its style; empty to write only the text, in its column.
        text: the text, a message.
    """
    lines = _wrap(translate(text), target.width - len(_INDENT)) or [""]
    gap = " " * (len(_INDENT) - len(word))
    target.print(Text.assemble(word, gap, lines[0]), soft_wrap=True)
    for line in lines[1:]:
        target.print(f"{_INDENT}{line}", soft_wrap=True)


_NARROWEST = 20
"""Least columns of a wrapped text. A narrower terminal wraps it once more."""


_WIDER_THAN_ANY_TABLE = 10_000
"""Count of columns with which rich measures the width that a table would like to have."""


def table(
    headings: Sequence[str], *rows: Sequence[str | Text], title: str = "", numbers: bool = True
) -> Table:
    """Make a table in the language of the output.

    Args:
        headings: headings of the columns.
        rows: cells of each row, as many as there are headings.
        title: title above the table. None is shown if it is empty.
        numbers: whether the columns hold numbers. Then all columns but the first are aligned to the right.
    """
    shown_title = Text(translate(title)) if title else None
    result = Table(box=None, pad_edge=False, title=shown_title)
    for index, heading in enumerate(headings):
        # The first column names the row, also in a table of numbers.
        is_name = index == 0
        justify: Literal["left", "right"] = "right" if numbers and not is_name else "left"
        # A word that is longer than its column goes on in the next line.
        result.add_column(Text(translate(heading)), justify=justify, overflow="fold")
    for row in rows:
        # Cells are texts of rich, for which [s] is no mark-up.
        cells = [Text(translate(cell)) if isinstance(cell, str) else cell for cell in row]
        result.add_row(*cells)
    # If the table is too wide, two spaces between columns become one, before the name of a joint is broken.
    unlimited = console.options.update(max_width=_WIDER_THAN_ANY_TABLE)
    required_width = Measurement.get(console, unlimited, result).maximum
    result.collapse_padding = required_width > console.width
    return result


def progress_note(text: str) -> AbstractContextManager[object]:
    """Context manager that shows a text on the error stream, in the language of the output, while work goes on."""
    return errors.status(Text(translate(text)))


def say_error(text: str) -> None:
    """Write an error on the error stream: on one line for scripts, wrapped at words for a user at a terminal."""
    line = f"simrob: {shortened(translate(text), _LONGEST)}"
    # A terminal would break the line within words.
    if sys.stderr.isatty():
        line = "\n".join(_wrap(line, errors.width))
    print(line, file=sys.stderr, flush=True)


class Interrupted(Exception):
    """Raised when the user interrupts a command.

    Its text describes what is left of the work. Only :func:`simrob_drake.cli.app.run_command` catches it.
    """


@contextmanager
def finished_first(work: str) -> Iterator[Callable[[], bool]]:
    """Context manager that finishes work although the user interrupts it once. A second interrupt abandons the work.

    Where this code does not handle interrupts (in another thread, or in a process with its own handling of Ctrl-C), the
    work is done as it would be without this context manager.

    Args:
        work: the work, such as "the files of runs/a".

    Yields:
        a function that returns whether the user interrupted the work.

    Raises:
        Interrupted: the user interrupted the work twice, and it was abandoned.
    """
    interrupt_count = 0

    def count_interrupt(*_: object) -> None:
        """Handle SIGINT: show at the first interrupt that the work goes on, abandon the work at the second one."""
        nonlocal interrupt_count
        interrupt_count += 1
        if interrupt_count == 1:
            text = message(
                "cli.being_finished",
                "interrupted; {work} are being finished, interrupt again to abandon them",
                work=work,
            )
            say_error(text)
        # A third interrupt must not disturb the clean-up after the second one.
        elif interrupt_count == 2:
            raise KeyboardInterrupt

    # Python allows handlers of signals in the main thread only. A handler other than Python's own belongs to the
    # caller.
    is_main_thread = current_thread() is main_thread()
    has_default_handler = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if not (is_main_thread and has_default_handler):
        yield lambda: False
        return
    signal.signal(signal.SIGINT, count_interrupt)
    try:
        # The count changes while the body runs, so a function is yielded instead of its present value.
        yield lambda: interrupt_count > 0
    except KeyboardInterrupt:
        text = message(
            "cli.abandoned", "interrupted; {work} are abandoned, nothing was saved", work=work
        )
        raise Interrupted(text) from None
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
