"""The picture of a push map: a bar for each direction that was tried, nothing in between, and maps that say of what."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from simrob_drake.extensions.tuning.sweep import Sweep
from simrob_drake.extensions.tuning.sweep_folder import save_sweep_plots
from simrob_drake.extensions.tuning.walking_folder import PushMap, save_push_picture


@pytest.fixture
def figures(monkeypatch):
    found: list[Figure] = []

    def keep(figure, file, **_):
        found.append(figure)
        Path(file).touch()

    monkeypatch.setattr(Figure, "savefig", keep)
    return found


def rows(spec, names, withstood):
    """Return the rows of a map in which the push numbered i of a setting withstands i times a figure."""
    return [
        {
            "settings": name,
            "moment": 3.0 + 0.1 * moment,
            "ended": "completed" if (moment + turn) % 2 else "fall",
            "impulse_per_mass": withstood * (1 + moment + turn),
        }
        for name in names
        for moment in range(spec.phases)
        for turn in range(spec.directions)
    ]


@pytest.mark.parametrize("force", [None, 20.0])
@pytest.mark.parametrize("directions", [1, 4, 36])
def test_each_direction_has_a_bar_of_each_setting(directions, force, figures, tmp_path):
    spec = PushMap(
        station="zjudancer_dynamic",
        directions=directions,
        phases=3,
        force=force,
        variant={"gait.step_time": 0.5},
    )
    names = list(spec.settings)
    save_push_picture(spec, rows(spec, names, 0.1), tmp_path / "pushes.png")
    around, *maps = [axes for axes in figures[0].axes if axes.get_label() != "<colorbar>"]
    assert around.get_lines() == []
    assert len(around.patches) == directions * len(names)
    sides = [np.degrees(bar.get_x() + bar.get_width() / 2) for bar in around.patches]
    middles = np.mean(np.reshape(sides, (len(names), directions)), axis=0)
    np.testing.assert_allclose(middles, spec.turns, atol=1e-9)
    what = "part of the pushes withstood" if force else "impulse over mass [N·s/kg]"
    bars = [axes for axes in figures[0].axes if axes.get_label() == "<colorbar>"]
    assert [axes.get_ylabel() for axes in bars] == [what] * len(maps)
    if not force:
        assert [bar.get_height() for bar in around.patches[:directions]] == pytest.approx(
            [0.1 * (1 + turn) for turn in range(directions)]
        )


def test_the_bar_of_a_sweeps_map_says_what_it_tells(figures, tmp_path):
    sweep = Sweep(station="irb120_dynamic", vary={"servo.kp": "1,2", "servo.kd": "1,2"})
    gains = [(kp, kd) for kp in (1, 2) for kd in (1, 2)]
    runs = [
        {
            "number": number,
            "servo.kp": kp,
            "servo.kd": kd,
            "ended": "completed",
            "work": float(kp * kd),
        }
        for number, (kp, kd) in enumerate(gains)
    ]
    save_sweep_plots(sweep, runs, tmp_path)
    bars = [axes for figure in figures for axes in figure.axes if axes.get_label() == "<colorbar>"]
    assert "work [J]" in {axes.get_ylabel() for axes in bars}
