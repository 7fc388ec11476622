"""What follows from the runs of a proof, in words."""

from collections import Counter
from collections.abc import Sequence
from statistics import median

from simrob_drake.tuning.trial import COMPLETED, Row

START, WON = "start", "winner"
"""What is compared: where a search began, and what it found."""
_MOST = 0.9  # of the pairs of runs in which a winner must cost less


def conclusion(rows: Sequence[Row]) -> tuple[bool, list[str]]:
    """Return whether a winner is proven, and sentences that say why.

    It is if no doubt ends more of its runs than of the start's, or any at all where there is no start, and if in nine
    of ten pairs of runs that both went to their ends it costs less.

    Args:
        rows: of the runs, each with ``of``, ``doubt``, ``draw``, ``ended``, and the costs if there is a start.
    """
    own = [row for row in rows if row["of"] == WON]
    start = [row for row in rows if row["of"] == START]
    held = f"{_held(own)} of {len(own)} runs of the winner hold"
    words = [held + (f", and {_held(start)} of {len(start)} of the start." if start else ".")]
    worse = []
    for doubt in dict.fromkeys(row["doubt"] for row in own):
        ours, theirs = ([row for row in some if row["doubt"] == doubt] for some in (own, start))
        lost = len(ours) - _held(ours)
        if lost:
            others = f" (start {len(theirs) - _held(theirs)})" if start else ""
            ends = ", ".join(dict.fromkeys(_why(row) for row in ours if not _holds(row)))
            words.append(f"{doubt}: {lost} of {len(ours)} do not{others}: {ends}.")
        if _held(ours) < (_held(theirs) if start else len(ours)):
            worse.append(doubt)
    cheaper = [_compared(name, own, start) for name in cost_columns(rows[0])] if start else []
    words += [sentence for _, sentence in cheaper]
    words += _beyond(own)
    proven = not worse and all(less for less, _ in cheaper)
    reasons = [f"it is less sure under {', '.join(worse)}"] if worse else []
    reasons += ["it does not cost less throughout"] if not all(less for less, _ in cheaper) else []
    return proven, ["Proven." if proven else f"Not proven: {'; '.join(reasons)}.", *words]


def _beyond(rows: Sequence[Row]) -> list[str]:
    """Return a sentence on the runs whose verdict names something beyond its bound, though they count as held."""
    beyond = [str(row["beyond"]).split() for row in rows if row.get("beyond")]
    count = Counter(name for names in beyond for name in names)
    named = ", ".join(f"{name} ({times})" for name, times in count.most_common())
    counted = f"{len(beyond)} of {len(rows)} runs of the winner pass a bound of their verdict"
    return [f"{counted}: {named}."] if beyond else []


def _compared(name: str, own: Sequence[Row], start: Sequence[Row]) -> tuple[bool, str]:
    """Return whether the winner costs less, and by how much in a sentence."""
    pairs = [(row[name], other[name]) for row, other in zip(own, start, strict=True) if _ended(row) and _ended(other)]
    if not pairs:
        return False, f"No two runs can be compared by {name}."
    less = sum(ours < theirs for ours, theirs in pairs)
    before, after = (median(values) for values in zip(*[(theirs, ours) for ours, theirs in pairs], strict=True))
    gain = f", {after / before:.2f} of it" if before > 0 and after > 0 else ""
    sentence = f"The {name} is {after:.4g} in the median, {before:.4g} at the start{gain}"
    return less >= _MOST * len(pairs), f"{sentence}; less in {less} of {len(pairs)} pairs."


def cost_columns(row: Row) -> list[str]:
    """Return the names of the costs in a row."""
    return [name for name in row if name == "cost" or (name.startswith("cost_") and name[5:].isdigit())]


def _ended(row: Row) -> bool:
    return bool(row["ended"] == COMPLETED)


def _holds(row: Row) -> bool:
    return _ended(row) and not row.get("over_limits")


def _held(rows: Sequence[Row]) -> int:
    return sum(map(_holds, rows))


def _why(row: Row) -> str:
    return "beyond a limit" if _ended(row) else str(row["ended"])
