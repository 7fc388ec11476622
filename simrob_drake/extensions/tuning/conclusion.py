"""What follows from the runs of a proof, in words."""

from collections import Counter
from collections.abc import Sequence
from statistics import median

import numpy as np
from scipy.stats import binomtest, quantile_test

from simrob_drake.base.messages import compound, join_texts, message
from simrob_drake.extensions.tuning.journal import COMPLETED, Row

START, WON = "start", "winner"  # what is compared: where a search began, and what it found
THOUGHT, NUMERICAL = message("tuning.as_thought", "as thought"), ("solver", "engine")
"""The runs without a doubt, and the doubts that change nothing but who integrates."""
_SURE = 0.95
_MOST = 0.9  # of the pairs of runs in which a winner must cost less


def conclusion(
    rows: Sequence[Row], undoubted: Sequence[str] = (), *, moved: bool = True
) -> tuple[bool, list[str]]:
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
    sure = message(
        "tuning.share_of_holding",
        "{low:.0f} to {high:.0f} %, 95 % sure",
        low=100 * share.low,
        high=100 * share.high,
    )
    held = message(
        "tuning.winner_holds",
        "{held} of {count} runs of the winner hold ({sure})",
        held=_held(own),
        count=len(own),
        sure=sure,
    )
    words: list[str] = [
        held
        + (
            message(
                "tuning.and_of_start",
                ", and {held} of {count} of the start.",
                held=_held(start),
                count=len(start),
            )
            if start
            else "."
        )
    ]
    worse = []
    for doubt in dict.fromkeys(row["doubt"] for row in own):
        ours, theirs = ([row for row in some if row["doubt"] == doubt] for some in (own, start))
        lost = len(ours) - _held(ours)
        if lost:
            others = (
                message(
                    "tuning.start_does_not", " (start {count})", count=len(theirs) - _held(theirs)
                )
                if start
                else ""
            )
            fallen = [row for row in ours if not _holds(row)]
            ends = join_texts(
                dict.fromkeys(
                    message("tuning.beyond_a_limit", "beyond a limit")
                    if _ended(row)
                    else str(row["ended"])
                    for row in fallen
                )
            )
            words.append(
                message(
                    "tuning.runs_in_doubt",
                    "{doubt}: {lost} of {count} do not{others}: {ends}.",
                    doubt=doubt,
                    lost=lost,
                    count=len(ours),
                    others=others,
                    ends=ends,
                )
            )
        if _held(ours) < (_held(theirs) if start else len(ours)):
            worse.append(doubt)
    cheaper = [_compared(name, own, start) for name in cost_columns(rows[0])] if start else []
    words += [sentence for _, sentence in cheaper]
    beyond = [str(row["beyond"]).split() for row in own if row.get("beyond")]
    count = Counter(name for names in beyond for name in names)
    named = ", ".join(f"{name} ({times})" for name, times in count.most_common())
    counted = message(
        "tuning.runs_beyond_bound",
        "{beyond} of {count} runs of the winner pass a bound of their verdict",
        beyond=len(beyond),
        count=len(own),
    )
    words += [compound("{counted}: {named}.", counted=counted, named=named)] if beyond else []
    words += (
        [
            message(
                "tuning.not_doubted", "Not doubted: {undoubted}.", undoubted=join_texts(undoubted)
            )
        ]
        if undoubted
        else []
    )
    proven = not worse and all(less for less, _ in cheaper) and (moved or not start)
    reasons = (
        [
            message(
                "tuning.less_sure_under", "it is less sure under {worse}", worse=join_texts(worse)
            )
        ]
        if worse
        else []
    )
    reasons += (
        [message("tuning.not_less_throughout", "it does not cost less throughout")]
        if not all(less for less, _ in cheaper)
        else []
    )
    reasons += (
        [message("tuning.no_other_move", "no run makes another move; a case of proof may")]
        if start and not moved
        else []
    )
    return proven, [
        message("tuning.proven", "Proven.")
        if proven
        else message(
            "tuning.not_proven", "Not proven: {reasons}.", reasons=join_texts(reasons, "; ")
        ),
        *words,
    ]


def _compared(name: str, own: Sequence[Row], start: Sequence[Row]) -> tuple[bool, str]:
    """Return whether the winner costs less, and by how much in a sentence."""
    pairs = [
        (ours, theirs)
        for ours, theirs in zip(own, start, strict=True)
        if _ended(ours) and _ended(theirs)
    ]
    if not pairs:
        return False, message(
            "tuning.no_comparable_runs", "No two runs can be compared by {name}.", name=name
        )
    costs = np.array([[ours[name], theirs[name]] for ours, theirs in pairs], dtype=float)
    gains = costs[:, 1] - costs[:, 0]
    after, before, gain = (float(np.median(values)) for values in (*costs.T, gains))
    interval = quantile_test(gains, p=0.5, alternative="greater").confidence_interval(_SURE)
    least = float(np.ravel(interval)[0])  # nan for a few
    error = _numerical_error(name, pairs)
    less = int(np.sum(gains > 0))
    part = (
        message("tuning.part_of_it", ", {part:.2f} of it", part=after / before)
        if before > 0 and after > 0
        else ""
    )
    sentence = message(
        "tuning.medians",
        "The {name} is {after:.4g} in the median, {before:.4g} at the start{part}",
        name=name,
        after=after,
        before=before,
        part=part,
    )
    sentence += message(
        "tuning.less_in_pairs", "; less in {less} of {pairs} pairs", less=less, pairs=len(pairs)
    )
    known = np.isfinite(least)
    sentence += (
        message(
            "tuning.by_least", ", by {least:.4g} or more in the median (95 % sure)", least=least
        )
        if known
        else message("tuning.too_few", ", too few to be sure")
    )
    if error is not None:
        sentence += message(
            "tuning.gain_differs",
            "; the gain of {gain:.4g} is another by {error:.4g} with other solvers and engines",
            gain=gain,
            error=error,
        )
    sure = less >= _MOST * len(pairs) and gain > (error or 0.0) and least > 0
    return sure, compound("{sentence}.", sentence=sentence)


def _numerical_error(name: str, pairs: Sequence[tuple[Row, Row]]) -> float | None:
    """Return by how much a gain is another one with other solvers or another engine, the largest of their medians."""
    gains: dict[str, dict[int, float]] = {}
    for ours, theirs in pairs:
        gains.setdefault(ours["doubt"], {})[ours["draw"]] = theirs[name] - ours[name]
    thought = gains.get(THOUGHT, {})
    errors = [
        median(
            abs(gain - thought[draw % len(thought)])
            for draw, gain in found.items()
            if draw % len(thought) in thought
        )
        for kind, found in gains.items()
        if kind in NUMERICAL and thought
    ]
    return max(errors, default=None)


def cost_columns(row: Row) -> list[str]:
    """Return the names of the costs in a row."""
    return [
        name for name in row if name == "cost" or (name.startswith("cost_") and name[5:].isdigit())
    ]


def _ended(row: Row) -> bool:
    return bool(row["ended"] == COMPLETED)


def _holds(row: Row) -> bool:
    return _ended(row) and not row.get("over_limits")


def _held(rows: Sequence[Row]) -> int:
    return sum(map(_holds, rows))
