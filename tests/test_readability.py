"""The measures of readability, on small files whose values are counted by hand; and the bounds of the packages."""

from pathlib import Path

import pytest

from tests.readability import BOUNDS, LIMITED, Measures, exceeded, main, measure, packages

SAMPLE = '''"""A module."""


def moved(a, b):
    """Return where it is; None: it is nowhere."""
    # The comment counts once.
    first, second = a, b
    one, two, three, four = a
    return first


class Arm:
    """An arm with joints."""
'''


@pytest.fixture
def sample(tmp_path: Path) -> Measures:
    file = tmp_path / "sample.py"
    file.write_text(SAMPLE)
    return measure([file])


def test_lines_comments_and_unpackings_are_counted(sample: Measures) -> None:
    # def, two assignments, return, class: blank lines, docstrings and comments are no code.
    assert sample.code_lines == 5
    assert sample.comments == pytest.approx(100 * 1 / 5)
    assert sample.tuple_assignments == pytest.approx(1000 * 1 / 5)
    assert sample.unpackings == pytest.approx(1000 * 1 / 5)


def test_riddles_and_participles_are_found(sample: Measures) -> None:
    # of the function and the class; modules do not count
    assert sample.riddles == pytest.approx(100 * 1 / 2)
    assert sample.participles == pytest.approx(100.0)
    assert "moved" in sample.riddle_places[0].where


@pytest.mark.parametrize(
    "summary",
    [
        "Return what a joint does.",
        "Where feet are.",
        "Of the mesh; 0.001 for millimetres.",
        "Let the sources give other trajectories.",
        "The block that tells the speed of it.",
        "A robot whom nobody moves.",
        "The limit; None: there is no limit.",
        "The robot as it is.",
    ],
)
def test_each_rule_finds_its_riddle(tmp_path: Path, summary: str) -> None:
    file = tmp_path / "riddle.py"
    file.write_text(f'def limit():\n    """{summary}"""\n')
    assert measure([file]).riddles == 100.0


@pytest.mark.parametrize(
    "summary", ["Compute the foothold of the swing leg.", "Joint positions, shape (n,) [rad]."]
)
def test_plain_sentences_are_no_riddles(tmp_path: Path, summary: str) -> None:
    file = tmp_path / "plain.py"
    file.write_text(f'def foothold():\n    """{summary}"""\n')
    assert measure([file]).riddles == 0.0


def test_density_is_nodes_of_the_body_per_line(tmp_path: Path) -> None:
    body = "\n".join(["    pass"] * 10)
    file = tmp_path / "even.py"
    file.write_text(f"def wait():\n{body}\n")

    measures = measure([file])

    assert measures.median_density == 1.0
    assert measures.dense_density == 1.0


def test_a_short_function_has_no_density(tmp_path: Path) -> None:
    file = tmp_path / "short.py"
    file.write_text("def wait():\n    return sum(x * x for x in range(10) if x % 2)\n")
    assert measure([file]).dense_functions == []


def test_every_bound_that_is_exceeded_is_reported(sample: Measures) -> None:
    reported = "\n".join(exceeded("walking", sample))
    for measure_name in ("tuple_assignments", "unpackings", "riddles", "participles"):
        assert BOUNDS[measure_name].label in reported
    assert "comments" not in reported  # one in five lines is more than the bound asks for


def test_the_rewritten_packages_keep_their_bounds(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*LIMITED]) == 0
    assert set(LIMITED) <= packages().keys()
    assert "walking" in capsys.readouterr().out


def test_an_unknown_package_is_an_error_with_the_known_ones(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit):
        main(["walkin"])
    error = capsys.readouterr().err
    assert "walkin" in error
    assert "walking" in error
