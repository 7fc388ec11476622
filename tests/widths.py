"""How wide the output of a command is."""

COLUMNS = 80
"""Columns that every line of an output fits in."""


def too_wide(text: str) -> list[str]:
    """Find lines that are wider than a screen. A path or an address alone on its line is not broken, and may be so."""
    return [line for line in text.splitlines() if len(line) > COLUMNS and len(line.split()) > 1]
