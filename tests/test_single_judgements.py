"""Judgements that two places made differently are made once: arms, quaternions of files, points that stand."""

import numpy as np
import pytest

from simrob_drake import load_station
from simrob_drake.base.frames import has_wrong_norm, rotation_of
from simrob_drake.cli.robots import show_robot
from simrob_drake.parts.soles import shares_by_height
from simrob_drake.programs.program import Program
from simrob_drake.programs.whole_program import goes_on_legs
from simrob_drake.robots.catalog import load_robot


@pytest.mark.parametrize(
    ("name", "changes", "is_arm"),
    [
        ("irb120", {}, True),
        ("irb120", {"base": "floating"}, False),
        ("irb120", {"tools": {}}, False),
        ("humanoid", {}, False),
        ("humanoid", {"base": "fixed"}, False),
    ],
)
def test_arms(name, changes, is_arm, capsys):
    """What runs programs as an arm is what gets a payload; before, a humanoid whose base is fixed got one."""
    model = load_robot(name).model_copy(update=changes)

    show_robot(model)

    assert model.is_arm is is_arm
    assert goes_on_legs(model, Program()) is not is_arm
    assert ("payload" in capsys.readouterr().out) is is_arm


def test_norms_of_quaternions():
    """Published quaternions have three decimals or more; a zero is no rotation."""
    assert not has_wrong_norm(np.array([0.707, 0.707, 0.0, 0.0]))
    assert has_wrong_norm(np.array([1.0, 1.0, 0.0, 0.0]))
    assert has_wrong_norm(np.array([0.998, 0.0, 0.0, 0.0]))
    assert has_wrong_norm(np.zeros(4))
    np.testing.assert_allclose(
        rotation_of(np.array([2.0, 2.0, 0.0, 0.0])).matrix()[1], [0.0, 0.0, -1.0], atol=1e-15
    )


def test_shares_of_points_by_height():
    shares = shares_by_height(np.array([0.1, 0.103, 0.2]), 0.1)

    np.testing.assert_allclose(shares, [1.0, np.exp(-1.0), 0.0], atol=1e-14)


def test_a_gravity_of_another_unit_is_compared_with_that_of_stations():
    """A station's gravity is 9.80665 m/s² unless given, and 9806.65 is a thousand times that."""
    from simrob_drake.stations.plausibility import plausibility_findings
    from simrob_drake.stations.resolve import resolve

    config = load_station("bouncing_ball", {"gravity": 9806.65})

    texts = [finding.text for finding in plausibility_findings(config, resolve(config))]
    assert texts == ["gravity: 9806.65 m/s² is 1e+03 times that of the Earth; were mm/s² meant?"]
