"""A run at a glance, in a shell and in a notebook."""

import base64
import re
from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest
from matplotlib.image import imread

from simrob_drake import Arm, Runner, build_station, load_station, simulate
from simrob_drake.results.result import table_of
from simrob_drake.robots.catalog import load_robot


@pytest.fixture(scope="module")
def result():
    return simulate(load_station("irb120_dynamic"), duration=0.3, progress=False)


def test_a_shell_shows_three_lines(result):
    lines = repr(result).splitlines()

    assert lines[0] == "irb120_dynamic: ran to its end at 0.3 s"
    count = f"31 samples of {len(result.names)} columns to 0.3 s, "
    assert lines[1].startswith(count)
    assert lines[2] == "All within bounds"
    assert len(lines) == 3
    assert max(map(len, lines)) <= 100


@pytest.mark.long
def test_a_notebook_shows_the_film_strip_and_where_the_joints_ended(result):
    page = result._repr_html_()
    (strip,) = re.findall(r"base64,([A-Za-z0-9+/=]+)", page)

    assert imread(BytesIO(base64.b64decode(strip))).shape[0] > 360

    rows = [re.findall(r"<td>(.*?)</td>", row) for row in re.findall(r"<tr>(.*?)</tr>", page)][1:]
    assert [row[0] for row in rows] == [f"joint_{number}" for number in range(1, 7)]
    ends = [float(row[2]) for row in rows]
    np.testing.assert_allclose(ends, np.rad2deg(result.axes("q")[-1]), atol=5e-4)
    peaks = [abs(float(row[5])) for row in rows]
    np.testing.assert_allclose(peaks, np.abs(result.axes("tau")).max(axis=0), atol=5e-4)


@pytest.mark.long
def test_a_message_is_no_markup(result):
    page = replace(result, message="<script>alert(1)</script> & more")._repr_html_()
    assert "<script>" not in page
    assert "&lt;script&gt;alert(1)&lt;/script&gt; &amp; more" in page


def test_without_robots_the_pieces_are_told():
    ball = simulate(load_station("bouncing_ball"), duration=0.1, progress=False)
    (_, row) = table_of(ball)

    assert row[0] == "ball"
    assert float(row[3]) == pytest.approx(ball["piece.ball.z"][-1], abs=5e-5)
    assert float(row[4]) == pytest.approx(abs(ball["piece.ball.vz"][-1]), abs=5e-5)


def test_whatever_a_user_prints_takes_a_line_or_three(result):
    arm, plant = Arm("irb120_kinematic"), result.plant
    station = build_station("two_arms")
    things = [
        arm,
        arm.cell,
        arm.chain,
        arm.plan,
        arm.plan.move_abs_j([0.2] * 6),
        arm.move_abs_j([0.2] * 6),
    ]
    things += [
        result.config,
        result.final_state,
        plant,
        plant.robots["robot"],
        plant.robots["robot"].model,
    ]

    things += [
        station,
        station.ports,
        Runner("two_arms"),
        load_station("three_humanoids"),
        load_robot("humanoid"),
    ]

    for thing in things:
        for told in (repr(thing), str(thing), f"{thing}"):
            assert len(told.splitlines()) <= 3
            assert len(told) < 600, type(thing)
            assert " at 0x" not in told
    assert "tool load at 0.592 0 0.63 m, Rz Ry Rx 90 0 90 deg" in repr(Arm("irb120_kinematic"))
    assert (
        repr(load_station("irb120_dynamic").robots["robot"])
        == "RobotConfig(model='irb120', initial_deg=0.0)"
    )
