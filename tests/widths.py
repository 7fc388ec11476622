"""How wide the output of a command is."""

COLUMNS = 80
"""Columns that every line of an output fits in."""


def too_wide(text: str) -> list[str]:
    """Find lines that are wider than a screen. A path, an address or a command alone on its line is never broken."""
    wide = [line for line in text.splitlines() if len(line) > COLUMNS]
    return [line for line in wide if len(line.split()) > 1 and not line.startswith("simrob ")]
