"""Where the commands write to, and what an interrupt by the user, Ctrl-C, does while files are written."""

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
from simrob_drake.base.remarks import SEVERITY_WORDS, Remark, Severity

_LONGEST = 2000

WIDTH = 80
"""Columns of an output that is no terminal, such as a file: what a page of text and most editors show."""


def _width_of(stream: TextIO) -> int | None:
    """Columns of an output stream, or None for a terminal, whose width rich finds."""
    return None if stream.isatty() else WIDTH


console = Console(markup=False, emoji=False, highlight=False, width=_width_of(sys.stdout))
errors = Console(markup=False, emoji=False, highlight=False, stderr=True, width=_width_of(sys.stderr))

SEVERITY_STYLES: dict[Severity, str] = {"success": "green", "note": "dim", "warning": "yellow", "failure": "red"}
"""Styles of rich for the severities of remarks. An output that is no terminal has no colours."""

_INDENT = " " * len("warning ")
_SETTINGS_INDENT = f"{_INDENT}  "
_LABEL_WIDTH = len("recording")

# Labels in front of paths and commands, see `say_place`.
NEXT = message("cli.next", "next")
PROGRAM = message("cli.program", "program")
RESULT = message("cli.result", "result")
ROBOT = message("cli.robot", "robot")
STATION = message("cli.station", "station")
TABLE = message("cli.table", "table")
WRITTEN = message("cli.written", "written")


def say(text: str | Text) -> None:
    """Write a line in the language of the output, however long it is."""
    console.print(translate(text) if isinstance(text, str) else text, soft_wrap=True)


def say_text(text: str, style: str = "", target: Console = console) -> None:
    """Write a text in the language of the output, wrapped at words.

    A word that is longer than a line, such as a path, is not broken. An empty text is an empty line.

    Args:
        text: the text.
        style: style of rich, such as ``green``; empty for the usual one.
        target: where it is written.
    """
    for line in _wrap(translate(text), target.width) or [""]:
        target.print(Text(line, style), soft_wrap=True)


def _wrap(text: str, width: int) -> list[str]:
    """Wrap a text to lines of a width. Words are not broken, and an option stays in one line with its setting."""
    whole_settings = keep_settings_whole(text)
    lines = textwrap.wrap(whole_settings, max(width, _NARROWEST), break_long_words=False, break_on_hyphens=False)
    return [line.replace(_NO_BREAK_SPACE, " ") for line in lines]


_NO_BREAK_SPACE = "\N{NO-BREAK SPACE}"

_SETTING = re.compile(r"--[\w-]+ (?:'[^']*'|[\w.]+=\S*)")
"""An option with its setting, such as ``--set servo.kp=500``; a setting in quotes may have spaces."""


def keep_settings_whole(text: str) -> str:
    """Join options and their settings by spaces at which no line ends, so that a user can copy them."""
    return _SETTING.sub(lambda found: found[0].replace(" ", _NO_BREAK_SPACE), text)


def say_place(label: str, place: object) -> None:
    """Write a label and a path, an address or a command, which is never broken, so that a user can copy it.

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
    target = errors if remark.severity in ("warning", "failure") else console
    word = Text(translate(SEVERITY_WORDS[remark.severity]), SEVERITY_STYLES[remark.severity])
    _say_hanging(target, word, remark.text)
    if remark.remedy is None or not with_remedy:
        return
    _say_hanging(target, Text(""), f"→ {translate(remark.remedy.text)}")
    settings = remark.remedy.settings
    if settings:
        options = " ".join(f"--set {_quoted_for_shell(setting)}" for setting in settings)
    else:
        options = f"--set {remark.remedy.key}=..." if remark.remedy.key else ""
    for line in _wrap(options, target.width - len(_SETTINGS_INDENT)):
        target.print(f"{_SETTINGS_INDENT}{line}", soft_wrap=True)


def _quoted_for_shell(setting: str) -> str:
    """Quote a setting that has spaces, so that a shell takes it as one argument."""
    return shlex.quote(setting) if " " in setting else setting


def _say_hanging(target: Console, word: Text, text: str) -> None:
    """Write a word and a text. The text is wrapped at words, and all of its lines begin at the same column."""
    lines = _wrap(translate(text), target.width - len(_INDENT)) or [""]
    target.print(Text.assemble(word, " " * (len(_INDENT) - len(word)), lines[0]), soft_wrap=True)
    for line in lines[1:]:
        target.print(f"{_INDENT}{line}", soft_wrap=True)


_NARROWEST = 20
"""Least columns of a wrapped text. A narrower terminal wraps it once more."""


_WIDER_THAN_ANY_TABLE = 10_000  # count of characters


def table(headings: Sequence[str], *rows: Sequence[str | Text], title: str = "", numbers: bool = True) -> Table:
    """Make a table in the language of the output.

    Args:
        headings: headings of the columns.
        rows: cells of each row, as many as there are headings.
        title: title above the table. None is shown if it is empty.
        numbers: whether the columns hold numbers. Then all columns but the first are aligned to the right.
    """
    shown_title = Text(translate(title)) if title else None
    found = Table(box=None, pad_edge=False, title=shown_title)
    for index, heading in enumerate(headings):
        justify: Literal["left", "right"] = "right" if numbers and index else "left"
        # A word that is longer than its column goes on in the next line.
        found.add_column(Text(translate(heading)), justify=justify, overflow="fold")
    for row in rows:
        # Cells are texts of rich, for which [s] is no mark-up.
        cells = [Text(translate(cell)) if isinstance(cell, str) else cell for cell in row]
        found.add_row(*cells)
    # Two spaces between columns become one, before the name of a joint is broken.
    unlimited = console.options.update(max_width=_WIDER_THAN_ANY_TABLE)
    found.collapse_padding = Measurement.get(console, unlimited, found).maximum > console.width
    return found


def progress_note(text: str) -> AbstractContextManager[object]:
    """Context manager that shows a text on the error stream, in the language of the output, while work goes on."""
    return errors.status(Text(translate(text)))


def tell(text: str) -> None:
    """Write an error on the error stream: on one line for scripts, wrapped at words for a user at a terminal."""
    line = f"simrob: {shortened(translate(text), _LONGEST)}"
    if sys.stderr.isatty():
        line = "\n".join(_wrap(line, errors.width))
    print(line, file=sys.stderr, flush=True)


class Interrupted(Exception):
    """Raised when the user interrupts a command. Its text describes what is left of the work. No command catches it."""


@contextmanager
def finished_first(work: str) -> Iterator[Callable[[], bool]]:
    """Context manager that finishes work although the user interrupts it.

    Args:
        work: the work, such as "the files of runs/a".

    Yields:
        a function that returns whether the user interrupted the work.

    Raises:
        Interrupted: the user interrupted the work twice, and it was abandoned.
    """
    times = 0

    def hear(*_: object) -> None:
        nonlocal times
        times += 1
        if times == 1:
            tell(
                message(
                    "cli.being_finished",
                    "interrupted; {work} are being finished, interrupt again to abandon them",
                    work=work,
                )
            )
        elif times == 2:  # what comes then must not keep it from tidying up
            raise KeyboardInterrupt

    if current_thread() is not main_thread() or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield lambda: False
        return
    signal.signal(signal.SIGINT, hear)
    try:
        yield lambda: times > 0
    except KeyboardInterrupt:
        text = message("cli.abandoned", "interrupted; {work} are abandoned, nothing was saved", work=work)
        raise Interrupted(text) from None
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
