"""Where the commands write to: what stands in brackets there is a user's, and no markup."""

import sys

from rich.console import Console

console = Console(markup=False, emoji=False, width=None if sys.stdout.isatty() else 160)
errors = Console(markup=False, emoji=False, stderr=True, soft_wrap=True)


def tell(text: str) -> None:
    """Say something on the error stream, in one line."""
    print(f"simrob: {' '.join(text.split())}", file=sys.stderr, flush=True)
