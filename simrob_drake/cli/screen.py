"""Where the commands write to: what stands in brackets there is a user's, and no markup."""

import sys

from rich.console import Console
from rich.text import Text

from simrob_drake.errors import shortened

_LONGEST = 2000
console = Console(markup=False, emoji=False, width=None if sys.stdout.isatty() else 160)
errors = Console(markup=False, emoji=False, stderr=True, soft_wrap=True)


def say(text: str | Text) -> None:
    """Write a line as it is, however long."""
    console.print(text, soft_wrap=True, highlight=False)


def tell(text: str) -> None:
    """Say something on the error stream, in one line."""
    print(f"simrob: {shortened(text, _LONGEST)}", file=sys.stderr, flush=True)
