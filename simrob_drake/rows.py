"""Many rows, worked on in parts."""

_PART = 1000


def parts(count: int) -> list[slice]:
    """Cut rows into parts of a thousand, so that what is computed of each takes little memory at once."""
    return [slice(first, first + _PART) for first in range(0, count, _PART)]
