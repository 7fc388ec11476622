"""How readable the package's code is, by numbers: ``python -m tests.readability [--worst N] [PACKAGE ...]``.

The measures point at places that a reader should look at. They are bounds, not goals: a number that improves while
the text gets harder to read is a loss. ``make lint`` fails if a package of ``LIMITED`` exceeds a bound of ``BOUNDS``.

Without arguments, every package has one row. With ``--worst N``, the densest functions, the docstrings that break a
rule and the names that are participles are listed as well, N of each.
"""

import argparse
import ast
import io
import re
import sys
import tokenize
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

PACKAGE = Path(__file__).parents[1] / "simrob_drake"

LIMITED = (
    "walking",
    "blocks",
    "parts",
    "stations",
    "programs",
    "results",
    "robots",
    "kinematics",
    "simulation",
    "base",
    "cli",
    "importer",
)
"""Packages that have been rewritten in open code. The others follow one by one."""

SHORTEST_BODY = 8
"""Functions with fewer lines than this have no density: a single expression would decide it."""

UNPACKED_AT_ONCE = 3
"""More names than this on the left side of an assignment have to be counted to be understood."""

RIDDLES = {
    "it opens with a relative clause": (
        r"^(return|yield|tell|give|say)?\s*(what|where|how|who|whose|which|that|those)\b"
    ),
    "it opens with 'it', 'all' or 'by'": r"^(it|all|by)\b",
    "it opens with a preposition": r"^(of|in|with|without|between|from|for|as|at) ",
    "it opens with 'let'": r"^let ",
    "things do not tell, say, know or mind": r"\b(tells?|told|says?|knows?|minds?|asks?) ",
    "a thing is no person": r"\b(who|whoever|whom|nobody|somebody)\b",
    "a special value needs a sentence": r"; none[: ]|^none:",
    "a pronoun needs a noun": r"\b(there are none|if any does|as it is|as they are|that there (is|are))\b",
    "a word of this house, not of the field": (
        r"\b(lets? go|keeps? its feet|stands? for|lies? in|anyhow|likewise|beside)\b"
    ),
}
"""Rules that the first paragraph of a docstring breaks, with the expressions that find it, whatever its case."""

PARTICIPLE = re.compile(
    r"_?[a-z]+(ed|en|wn|ought)|_?(bent|built|held|kept|left_out|lost|made|met|sent|told|together|apart)"
)
"""Names of functions that are one participle or adverb say what was done, but not what they compute or do."""

NO_PARTICIPLES = {
    "feed",
    "seed",
    "speed",
    "need",
    "even",
    "open",
    "screen",
    "token",
    "then",
    "when",
    "listen",
    "own",
}
"""Verbs and nouns that end like participles."""


class Bound(NamedTuple):
    """Bound of a measure.

    Attributes:
        label: heading of the measure's column.
        value: the bound.
        is_largest: whether larger values exceed the bound; otherwise smaller ones do.
    """

    label: str
    value: float
    is_largest: bool = True


BOUNDS = {
    "median_density": Bound("nodes/line", 11.0),
    "dense_density": Bound("p90", 15.5),
    "tuple_assignments": Bound("a, b = x, y", 1.0),
    "unpackings": Bound("unpackings", 0.5),
    "comments": Bound("comments", 8.0, is_largest=False),
    "line_length": Bound("p90 line", 88.0),
    "riddles": Bound("riddles %", 1.0),
    "participles": Bound("participles %", 1.0),
}
"""Bound of each measure, by the name of its property of `Measures`."""

LOOSER: dict[str, dict[str, float]] = {
    "base": {"participles": 3.7},
}
"""Bounds of packages that do not keep all of `BOUNDS` yet: they may get stricter, never looser."""


class Place(NamedTuple):
    """A place in the code that a reader should look at.

    Attributes:
        where: file, line and name.
        why: what a measure found there.
        value: how far it is from the usual; larger is worse.
    """

    where: str
    why: str
    value: float = 0.0


@dataclass
class Measures:
    """Counts over some files, and the measures that follow from them."""

    code_lines: int = 0
    comment_count: int = 0
    tuple_count: int = 0
    unpacking_count: int = 0
    docstring_count: int = 0
    function_count: int = 0
    lengths: list[int] = field(default_factory=list)
    dense_functions: list[Place] = field(default_factory=list)
    riddle_places: list[Place] = field(default_factory=list)
    participle_places: list[Place] = field(default_factory=list)

    @property
    def median_density(self) -> float:
        """Median over all functions of the syntax-tree nodes per line of the body."""
        return self._density_quantile(0.5)

    @property
    def dense_density(self) -> float:
        """Density (nodes per line) that one function in ten exceeds."""
        return self._density_quantile(0.9)

    @property
    def tuple_assignments(self) -> float:
        """Assignments ``a, b = x, y`` per 1000 lines of code."""
        return 1000 * self.tuple_count / max(self.code_lines, 1)

    @property
    def unpackings(self) -> float:
        """Unpackings of more than three names per 1000 lines of code."""
        return 1000 * self.unpacking_count / max(self.code_lines, 1)

    @property
    def comments(self) -> float:
        """Comments per 100 lines of code."""
        return 100 * self.comment_count / max(self.code_lines, 1)

    @property
    def line_length(self) -> float:
        """Length that one line in ten exceeds."""
        return float(np.quantile(self.lengths, 0.9)) if self.lengths else 0.0

    @property
    def riddles(self) -> float:
        """Docstrings that break a rule, in per cent."""
        return 100 * len(self.riddle_places) / max(self.docstring_count, 1)

    @property
    def participles(self) -> float:
        """Functions that are named by one participle, in per cent."""
        return 100 * len(self.participle_places) / max(self.function_count, 1)

    def _density_quantile(self, quantile: float) -> float:
        densities = [place.value for place in self.dense_functions]
        return float(np.quantile(densities, quantile)) if densities else 0.0


def measure(files: Iterable[Path]) -> Measures:
    """Measure some Python files together."""
    measures = Measures()
    for file in files:
        _add_file(measures, file)
    return measures


def _add_file(measures: Measures, file: Path) -> None:
    """Add the counts of one file to the measures."""
    source = file.read_text(encoding="utf-8")
    tree = ast.parse(source)
    docstring_lines = set[int]()
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            docstring_lines |= _add_docstring(measures, node, file)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            _add_function(measures, node, file)
        if isinstance(node, ast.Assign):
            _add_assignment(measures, node)
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        measures.comment_count += token.type == tokenize.COMMENT
    for number, line in enumerate(source.splitlines(), start=1):
        is_code = (
            line.strip() and not line.lstrip().startswith("#") and number not in docstring_lines
        )
        if is_code:
            measures.code_lines += 1
            measures.lengths.append(len(line))


def _add_docstring(
    measures: Measures,
    node: ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef,
    file: Path,
) -> set[int]:
    """Count the docstring of a node, and judge its first paragraph. Returns the numbers of its lines."""
    text = ast.get_docstring(node)
    if not text:
        return set()
    statement = node.body[0]
    lines = set(range(statement.lineno, (statement.end_lineno or statement.lineno) + 1))
    if isinstance(node, ast.Module):
        return lines
    measures.docstring_count += 1
    summary = " ".join(text.split("\n\n")[0].split())
    for rule, pattern in RIDDLES.items():
        if re.search(pattern, summary, re.IGNORECASE):
            measures.riddle_places.append(Place(f"{_place(file, node)}: {summary}", rule))
            break
    return lines


def _add_function(
    measures: Measures, node: ast.FunctionDef | ast.AsyncFunctionDef, file: Path
) -> None:
    """Count a function, judge its name, and add its density if its body is long enough."""
    measures.function_count += 1
    if PARTICIPLE.fullmatch(node.name) and node.name.strip("_") not in NO_PARTICIPLES:
        measures.participle_places.append(
            Place(_place(file, node), "name it by a verb, or by the noun of its value")
        )
    body = node.body[1:] if ast.get_docstring(node) else node.body
    if not body:
        return
    height = (node.end_lineno or 0) - body[0].lineno + 1
    if height >= SHORTEST_BODY:
        nodes = sum(1 for statement in body for _ in ast.walk(statement))
        density = nodes / height
        measures.dense_functions.append(
            Place(_place(file, node), f"{density:.1f} nodes a line", density)
        )


def _add_assignment(measures: Measures, node: ast.Assign) -> None:
    """Count an assignment of a tuple to a tuple, and an unpacking of many names."""
    target = node.targets[0]
    if isinstance(target, ast.Tuple):
        measures.tuple_count += isinstance(node.value, ast.Tuple)
        measures.unpacking_count += len(target.elts) > UNPACKED_AT_ONCE


def _place(file: Path, node: ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef) -> str:
    """File, line and name of a class or function."""
    shown = file.relative_to(PACKAGE.parent) if file.is_relative_to(PACKAGE.parent) else file
    return f"{shown}:{node.lineno} {node.name}"


def packages() -> dict[str, list[Path]]:
    """Files of each package and each extension, by a name such as ``walking`` or ``extensions/rapid``."""
    found: dict[str, list[Path]] = {}
    for file in sorted(PACKAGE.rglob("*.py")):
        parts = file.relative_to(PACKAGE).parts[:-1]
        depth = 2 if parts[:1] == ("extensions",) else 1
        found.setdefault("/".join(parts[:depth]) or ".", []).append(file)
    return found


def exceeded(name: str, measures: Measures) -> Iterator[str]:
    """Yield the bounds that a package exceeds, in words."""
    looser = LOOSER.get(name, {})
    for measure_name, bound in BOUNDS.items():
        limit = looser.get(measure_name, bound.value)
        value = getattr(measures, measure_name)
        is_beyond = value > limit if bound.is_largest else value < limit
        if is_beyond:
            side = "at most" if bound.is_largest else "at least"
            yield f"{name}: {bound.label} is {value:.1f}; it must be {side} {limit:g}"


def _row(name: str, measures: Measures) -> str:
    """Row of the table with the measures of a package."""
    values = [f"{getattr(measures, measure_name):>13.1f}" for measure_name in BOUNDS]
    return f"{name:24}{''.join(values)}"


def _print_worst(measures: Measures, count: int) -> None:
    """Print the places of a package that a reader should look at first."""
    densest = sorted(measures.dense_functions, key=lambda place: -place.value)
    for places in (densest, measures.riddle_places, measures.participle_places):
        for place in places[:count]:
            print(f"  {place.where}  [{place.why}]")


def main(arguments: list[str] | None = None) -> int:
    """Print the table. Returns 1 if a package exceeds a bound that it has to keep, else 0."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "packages", nargs="*", help="packages to measure, such as walking; by default all"
    )
    parser.add_argument(
        "--worst", type=int, default=0, help="places to list for each package and measure"
    )
    parser.add_argument(
        "--quiet", action="store_true", help="print only the bounds that are exceeded"
    )
    options = parser.parse_args(arguments)
    known = packages()
    unknown = sorted(set(options.packages) - set(known))
    if unknown:
        parser.error(f"unknown package {', '.join(unknown)}; there are {', '.join(known)}")
    failures = list[str]()
    if not options.quiet:
        print(f"{'':24}{''.join(f'{bound.label:>13}' for bound in BOUNDS.values())}")
    for name in options.packages or known:
        measures = measure(known[name])
        if not options.quiet:
            print(_row(name, measures))
        _print_worst(measures, options.worst)
        if name in LIMITED:
            failures += exceeded(name, measures)
    for failure in failures:
        print(failure, file=sys.stderr)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
