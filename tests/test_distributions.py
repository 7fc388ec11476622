"""Distributions over keys: their values, where each lies among them, and cases drawn of several at once."""

import json
import pickle

import numpy as np
import pytest

from simrob_drake.base.distributions import Choice, Normal, Uniform, parse_distribution
from simrob_drake.base.errors import SimrobError
from simrob_drake.base.sampling import Draws, draw_case
from simrob_drake.base.sections import validate_section

MIXED = {
    "kp": {"low": 10, "high": 1000, "log": True},
    "mass": {"mean": 1, "deviation": 0.1, "low": 0.9},
    "steps": {"low": 1, "high": 4, "integer": True},
    "kind": {"values": ["continuous", "discrete"]},
    "step": {"low": 1e-3, "high": 5e-3, "when": {"kind": "discrete"}},
}


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("0.5,1,2", [0.5, 1, 2]),
        ("cenic,discrete", ["cenic", "discrete"]),
        ("[0, 0, 1],[0, 0, 2]", [[0, 0, 1], [0, 0, 2]]),
        ("lin:0:1:5", [0, 0.25, 0.5, 0.75, 1]),
        ("lin:1:0:3", [1, 0.5, 0]),
        ("log:10:1000:3", pytest.approx([10, 100, 1000])),
    ],
)
def test_values_are_listed_or_spread_over_a_range(text, values):
    assert parse_distribution("key", text).values == values


@pytest.mark.parametrize(
    "text",
    [
        *(
            "",
            "1,null",
            "[1",
            "uniform:2:1",
            "uniform:1",
            "normal:0:-1",
            "uniform:0:1:5",
            "loguniform:0:1",
        ),
        *(
            "integer:0:1.5",
            "log:0:1:3",
            "log:-1:1:3",
            "lin:1:1:3",
            "lin:0:1:1",
            "lin:0:1:2.5",
            "lin:0:1",
        ),
    ],
)
def test_values_that_are_none_are_refused(text):
    with pytest.raises(SimrobError, match="--vary gain"):
        parse_distribution("--vary gain", text)


@pytest.mark.parametrize(
    ("section", "told"),
    [
        ({"low": 2, "high": 1}, "vary.kp: low must be less than high"),
        ({"low": 0, "high": 1, "log": True}, "vary.kp: low must be positive"),
        ({"low": 1, "high": 2, "start": 3}, "vary.kp: start must be between"),
        (
            {"low": 1.5, "high": 4, "integer": True},
            "vary.kp: low, high and start must be integers",
        ),
        ({"lo": 2, "high": 1}, "vary.kp.lo: unknown key; did you mean 'low'"),
        ({"mean": 1}, "vary.kp.deviation: this key is required"),
        ({"mean": 1, "deviation": 1, "low": 2}, "vary.kp: mean must be between"),
        ({"values": []}, "vary.kp.values: needs at least 1 value, not 0"),
        (
            {"low": 1, "high": 2, "when": {"servo": 1}},
            "kp.when.servo must be a key that comes before kp",
        ),
        (3, "vary.kp: must be a section with keys among"),
        ("uniform:2:1", "vary.kp: must be a range with LOW less than HIGH"),
    ],
)
def test_sections_that_are_none_are_refused_in_a_line(section, told):
    with pytest.raises(SimrobError, match=told):
        validate_section(Draws, {"vary": {"kp": section}}, "study.yaml")


@pytest.mark.parametrize(
    "one",
    [
        Uniform(low=0.1, high=1000),
        Uniform(low=0.1, high=1000, log=True),
        Normal(mean=3, deviation=0.5),
        Normal(mean=3, deviation=0.5, low=2.9, high=4),
    ],
)
def test_a_value_lies_at_the_part_of_the_draws_that_it_was_taken_from(one):
    assert one.part(one.quantile(0.3)) == pytest.approx(0.3)

    values = [one.quantile(part) for part in (-1, 0, 0.5, 1, 2)]
    assert values == sorted(values)
    assert all(one.holds(value) for value in (*values, one.first))
    assert not one.holds(float("nan"))
    assert not one.holds("1")

    source = np.random.default_rng(1)
    draws = [one.draw(source) for _ in range(2000)]

    assert np.mean([one.part(value) for value in draws]) == pytest.approx(0.5, abs=0.03)


@pytest.mark.parametrize(
    "single",
    [
        Normal(mean=1, deviation=0),
        Normal(mean=1, deviation=0, low=0, high=2),
        Normal(mean=1, deviation=0, low=0, high=1),
        Normal(mean=1, deviation=0.5, low=1, high=1),
    ],
)
def test_a_single_value_lies_in_the_middle_of_all_draws(single):
    assert single.quantile(0.1) == single.quantile(0.9) == 1
    assert single.part(1) == 0.5


def test_ranges_begin_where_they_are_told_or_in_their_middle():
    assert Uniform(low=0.1, high=1000).first == pytest.approx(500.05)
    assert Uniform(low=0.1, high=1000, log=True).first == pytest.approx(10)
    assert Uniform(low=1, high=4, start=2, integer=True).first == 2
    assert Choice(values=["a", "b"]).first == "a"


@pytest.mark.parametrize("log", [False, True])
def test_each_whole_number_and_each_choice_has_its_part(log):
    whole, names = Uniform(low=1, high=4, integer=True, log=log), Choice(values=["a", "b", "c"])
    values = [whole.quantile(part) for part in np.linspace(0, 1, 401)]

    assert values == sorted(values)
    assert all(type(value) is int for value in values)
    if not log:
        assert [values.count(one) for one in (1, 2, 3, 4)] == pytest.approx([100] * 4, abs=1)
    assert [whole.quantile(whole.part(value)) for value in (1, 2, 3, 4)] == [1, 2, 3, 4]
    assert [names.quantile(names.part(value)) for value in "abc"] == ["a", "b", "c"]
    assert not whole.holds(1.5)


@pytest.mark.parametrize(
    ("text", "mean", "deviation"), [("normal:3:0.5", 3, 0.5), ("uniform:2:4", 3, 1 / 3**0.5)]
)
def test_draws_are_those_of_their_distribution_and_of_their_seed(text, mean, deviation):
    one = parse_distribution("key", text)
    values = [one.draw(np.random.default_rng(seed)) for seed in range(2000)]

    assert np.mean(values) == pytest.approx(mean, abs=0.05)
    assert np.std(values) == pytest.approx(deviation, rel=0.05)
    plain = np.random.default_rng(7)
    assert values[7] == (plain.uniform(2, 4) if text.startswith("u") else plain.normal(3, 0.5))


@pytest.mark.parametrize("sampling", ["sobol", "latin", "random"])
def test_draws_spread_over_all_keys_and_leave_out_what_does_not_apply(sampling):
    cases = validate_section(
        Draws, {"vary": MIXED, "sampling": sampling, "count": 32, "seed": 3}, "file"
    ).draws()

    assert len(cases) == 32
    assert all(("step" in case) == (case["kind"] == "discrete") for case in cases)
    assert all(
        10 <= case["kp"] <= 1000 and case["mass"] >= 0.9 and case["steps"] in (1, 2, 3, 4)
        for case in cases
    )
    # half of all: of the even ones to the last
    below = np.mean([case["kp"] < 100 for case in cases])
    assert below == (pytest.approx(0.5, abs=0.3) if sampling == "random" else 0.5)

    again = Draws(vary=MIXED, sampling=sampling, count=32, seed=3)
    assert again.draws() == cases
    assert again.model_copy(update={"seed": 4}).draws() != cases


def test_a_grid_has_every_combination_once():
    space = {key: MIXED[key] for key in ("steps", "kind", "step")}
    cases = Draws(vary=space, sampling="grid", count=3).draws()

    assert len(cases) == 3 * (1 + 3)
    assert {"steps": 1, "kind": "continuous"} in cases
    assert {"steps": 4, "kind": "discrete", "step": 5e-3} in cases
    assert Draws().draws() == [{}]
    with pytest.raises(SimrobError, match="at most 100000 cases"):
        Draws(vary={"a": "uniform:0:1", "b": "uniform:0:1"}, sampling="grid", count=1000)


def test_a_draw_of_a_source_takes_the_same_numbers_whatever_applies():
    space = Draws(vary={**MIXED, "last": "uniform:0:1"}).vary
    found = [draw_case(space, np.random.default_rng(seed)) for seed in range(20)]

    assert {"step" in one for one in found} == {True, False}

    without = {key: one for key, one in space.items() if key != "kind"}
    without["kind"] = Choice(values=["continuous"])

    fixed = {key: without[key] for key in space}
    assert [draw_case(fixed, np.random.default_rng(seed))["last"] for seed in range(20)] == [
        one["last"] for one in found
    ]


def test_a_distribution_is_written_as_it_was_read():
    given = {"vary": {**MIXED, "gravity": "uniform:1.6:9.8", "damping": "log:1:100:3"}}
    space = validate_section(Draws, given, "file")

    written = space.model_dump(mode="json")["vary"]

    assert json.loads(json.dumps(written)) == given["vary"]
    assert validate_section(Draws, {"vary": written}, "file") == space
    assert pickle.loads(pickle.dumps(space)) == space
    assert space.vary["gravity"].text == "uniform:1.6:9.8"
