"""What follows from the runs of a proof, in words."""

from collections import Counter
from collections.abc import Sequence
from statistics import median

import numpy as np
from scipy.stats import binomtest, quantile_test

from simrob_drake.extensions.tuning.journal import COMPLETED, Row

START, WON = "start", "winner"  # what is compared: where a search began, and what it found
THOUGHT, NUMERICAL = "as thought", ("solver", "engine")
"""The runs without a doubt, and the doubts that change nothing but who integrates."""
_SURE = 0.95
_MOST = 0.9  # of the pairs of runs in which a winner must cost less


def conclusion(rows: Sequence[Row], undoubted: Sequence[str] = (), *, moved: bool = True) -> tuple[bool, list[str]]:
    """Return whether a winner is proven, and sentences that say why.

    It is if no doubt ends more of its runs than of the start's, or any at all where there is no start, and if in nine
    of ten pairs of runs that both went to their ends it costs less: by more than other solvers and engines find
    otherwise, and surely so in the median. A winner over a start must have been tried under other moves, too. The rows
    have ``of``, ``doubt``, ``draw``, ``ended``, and the costs if there is a start; ``moved``: there were other moves
    than the search's, or could be none.
    """
    own = [row for row in rows if row["of"] == WON]
    start = [row for row in rows if row["of"] == START]
    share = binomtest(_held(own), len(own)).proportion_ci(_SURE, method="wilson")
    sure = f"{100 * share.low:.0f} to {100 * share.high:.0f} %, 95 % sure"
    held = f"{_held(own)} of {len(own)} runs of the winner hold ({sure})"
    words = [held + (f", and {_held(start)} of {len(start)} of the start." if start else ".")]
    worse = []
    for doubt in dict.fromkeys(row["doubt"] for row in own):
        ours, theirs = ([row for row in some if row["doubt"] == doubt] for some in (own, start))
        lost = len(ours) - _held(ours)
        if lost:
            others = f" (start {len(theirs) - _held(theirs)})" if start else ""
            fallen = [row for row in ours if not _holds(row)]
            ends = ", ".join(dict.fromkeys("beyond a limit" if _ended(row) else str(row["ended"]) for row in fallen))
            words.append(f"{doubt}: {lost} of {len(ours)} do not{others}: {ends}.")
        if _held(ours) < (_held(theirs) if start else len(ours)):
            worse.append(doubt)
    cheaper = [_compared(name, own, start) for name in cost_columns(rows[0])] if start else []
    words += [sentence for _, sentence in cheaper]
    beyond = [str(row["beyond"]).split() for row in own if row.get("beyond")]
    count = Counter(name for names in beyond for name in names)
    named = ", ".join(f"{name} ({times})" for name, times in count.most_common())
    counted = f"{len(beyond)} of {len(own)} runs of the winner pass a bound of their verdict"
    words += [f"{counted}: {named}."] if beyond else []
    words += [f"Not doubted: {', '.join(undoubted)}."] if undoubted else []
    proven = not worse and all(less for less, _ in cheaper) and (moved or not start)
    reasons = [f"it is less sure under {', '.join(worse)}"] if worse else []
    reasons += ["it does not cost less throughout"] if not all(less for less, _ in cheaper) else []
    reasons += ["no run makes another move; a case of proof may"] if start and not moved else []
    return proven, ["Proven." if proven else f"Not proven: {'; '.join(reasons)}.", *words]


def _compared(name: str, own: Sequence[Row], start: Sequence[Row]) -> tuple[bool, str]:
    """Return whether the winner costs less, and by how much in a sentence."""
    pairs = [(ours, theirs) for ours, theirs in zip(own, start, strict=True) if _ended(ours) and _ended(theirs)]
    if not pairs:
        return False, f"No two runs can be compared by {name}."
    costs = np.array([[ours[name], theirs[name]] for ours, theirs in pairs], dtype=float)
    gains = costs[:, 1] - costs[:, 0]
    after, before, gain = (float(np.median(values)) for values in (*costs.T, gains))
    interval = quantile_test(gains, p=0.5, alternative="greater").confidence_interval(_SURE)
    least = float(np.ravel(interval)[0])  # nan for a few
    error = _numerical_error(name, pairs)
    less = int(np.sum(gains > 0))
    part = f", {after / before:.2f} of it" if before > 0 and after > 0 else ""
    sentence = f"The {name} is {after:.4g} in the median, {before:.4g} at the start{part}"
    sentence += f"; less in {less} of {len(pairs)} pairs"
    known = np.isfinite(least)
    sentence += f", by {least:.4g} or more in the median (95 % sure)" if known else ", too few to be sure"
    if error is not None:
        sentence += f"; the gain of {gain:.4g} is another by {error:.4g} with other solvers and engines"
    sure = less >= _MOST * len(pairs) and gain > (error or 0.0) and least > 0
    return sure, f"{sentence}."


def _numerical_error(name: str, pairs: Sequence[tuple[Row, Row]]) -> float | None:
    """Return by how much a gain is another one with other solvers or another engine, the largest of their medians."""
    gains: dict[str, dict[int, float]] = {}
    for ours, theirs in pairs:
        gains.setdefault(ours["doubt"], {})[ours["draw"]] = theirs[name] - ours[name]
    thought = gains.get(THOUGHT, {})
    errors = [
        median(
            abs(gain - thought[draw % len(thought)]) for draw, gain in found.items() if draw % len(thought) in thought
        )
        for kind, found in gains.items()
        if kind in NUMERICAL and thought
    ]
    return max(errors, default=None)


def cost_columns(row: Row) -> list[str]:
    """Return the names of the costs in a row."""
    return [name for name in row if name == "cost" or (name.startswith("cost_") and name[5:].isdigit())]


def _ended(row: Row) -> bool:
    return bool(row["ended"] == COMPLETED)


def _holds(row: Row) -> bool:
    return _ended(row) and not row.get("over_limits")


def _held(rows: Sequence[Row]) -> int:
    return sum(map(_holds, rows))
