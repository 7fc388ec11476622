"""Blocks for robots: trajectories through waypoints, and what pursues a path."""

import numpy as np
import pytest
from scipy.interpolate import BPoly, CubicHermiteSpline
from test_mechanics import FIGURES, TOUCH
from test_slx_signals import Plant

from slx_files import BRICK, REVOLUTE, WORLD, Level, write_model  # isort: skip
from simrob_drake import load_station, simulate
from simrob_drake.extensions.simulink.importing import import_simulink

TIGHT = {"solver.accuracy": 1e-7, "solver.max_step": 0.005}
CORE = "robotcorelib"


def moved(tmp_path, kind, output, **parameters):
    """Two hinges, an inertia of 1 kg m² each, on which an output of a trajectory of two coordinates acts as torque."""
    plant = Plant()
    clock = plant.chain("Clock", "Clock")
    made = plant.block(f"{CORE}/{kind}", "Way", **parameters)
    plant.wire(clock, f"{made}#in:1")
    plant.drive(*plant.split(f"{made}#out:{output}"))
    imported = import_simulink(write_model(tmp_path / "a.slx", plant, stop="3"), tmp_path / "out")
    assert imported.fidelity == "mechanics complete"
    told = any("speed rises for a third" in entry.text for entry in imported.report.entries)
    assert told == (kind.startswith("Trapezoidal") and parameters["NumParams"] < 2)
    return simulate(load_station(imported.station, TIGHT), duration=3.0, progress=False)


def parts_of(way, figures):
    """How long a trapezoid lasts and rises, by bisection over its rise where its length alone does not tell it."""
    lasts, rising, peak, rate = (figures.get(key) for key in ("End Time", "Acceleration Time", "Peak Velocity",
                                                             "Acceleration"))  # fmt: skip
    if len(figures) < 2:
        lasts = lasts or (1.5 * way / peak if peak else 1.0)
        return lasts, lasts / 3
    if rising is None and lasts is None:
        rising = peak / rate
    if rising is None:
        low, high = 0.0, lasts / 2
        for _ in range(200):
            rising = (low + high) / 2
            speed = peak or rate * rising
            if peak is None:
                low, high = (rising, high) if speed * (lasts - rising) < way else (low, rising)
            else:
                low, high = (rising, high) if speed * (lasts - rising) > way else (low, rising)
    speed = peak or (rate * rising if rate else way / (lasts - rising))
    return lasts or way / speed + rising, rising


@pytest.mark.parametrize("figures", [
    {}, {"End Time": "0.8"}, {"Peak Velocity": "[2; 3]"}, {"End Time": "0.8", "Peak Velocity": "[1.9; 3.1]"},
    {"End Time": "0.8", "Acceleration": "20"}, {"Acceleration": "20", "Acceleration Time": "[0.1 0.12; 0.15 0.11]"},
    {"End Time": "[1 0.9]", "Acceleration Time": "0.2"}, {"Peak Velocity": "2", "Acceleration": "9"},
    {"Acceleration Time": "0.1", "Peak Velocity": "3"},
], ids=", ".join)  # fmt: skip
def test_a_trapezoid_of_speed(tmp_path, figures):
    """Its accelerations as torques on an inertia of 1 kg m² give its speeds, which the torques' integral is."""
    sides = {"End Time": "EndTime", "Peak Velocity": "PeakVelocity", "Acceleration": "Acceleration",
             "Acceleration Time": "AccelTime"}  # fmt: skip
    given = {sides[name]: text for name, text in figures.items()}
    if figures.get("End Time") == "[1 0.9]":
        given["EndTime"] = "[1 0.9; 1 0.9]"
    choices = {f"Parameter{place}": name for place, name in enumerate(figures, start=1)}
    points = np.array([[0.0, 1.0, 0.2], [0.5, -1.0, 0.3]])
    given |= {
        "Waypoints": "[0 1 0.2; 0.5 -1 0.3]",
        "WaypointSource": "Internal",
        "ParameterSource": "Internal",
    }
    kind = "Trapezoidal Velocity Profile Trajectory"
    result = moved(tmp_path, kind, 3, NumParams=len(figures), **given, **choices)
    for row, name in enumerate("AB"):
        times, speeds = [0.0], [0.0]
        for place, way in enumerate(np.diff(points[row])):
            own = {}
            for key in figures:
                shaped = np.array([[float(one) for one in line.split()] for line in
                                   given[sides[key]].strip("[]").split(";")])  # fmt: skip
                own[key] = float(np.broadcast_to(shaped, (2, 2))[row, place])
            lasts, rising = parts_of(abs(way), own)
            times += [times[-1] + rising, times[-1] + lasts - rising, times[-1] + lasts]
            speeds += [way / (lasts - rising)] * 2 + [0.0]
        np.testing.assert_allclose(
            result[f"v.{name}"], np.interp(result.times, times, speeds), atol=2e-3
        )
        ends = np.interp(times[3], result.times, result[f"q.{name}"]) + points[row, 0]
        assert ends == pytest.approx(points[row, 1], abs=2e-3)


@pytest.mark.parametrize("method", ["Cubic Polynomial", "Quintic Polynomial"])
def test_a_polynomial_through_waypoints(tmp_path, method):
    """The torque that its accelerations are moves an inertia of 1 kg m² along it, up to its end."""
    times, slopes, bends = (
        [0.0, 0.7, 1.5],
        [[0.0, 1.0, 0.0], [0.0, -0.5, 0.0]],
        [[0.0, 2.0, -1.0], [1.0, 0.0, 0.0]],
    )
    points = [[0.0, 1.0, 0.2], [0.5, -1.0, 0.3]]
    result = moved(tmp_path, "Polynomial Trajectory", 3, Method=method, Waypoints="[0 1 0.2; 0.5 -1 0.3]",
                   TimePoints="[0 0.7 1.5]", VelocityBoundaryCondition="[0 1 0; 0 -0.5 0]", WaypointSource="Internal",
                   AccelerationBoundaryCondition="[0 2 -1; 1 0 0]", ParameterSource="Internal")  # fmt: skip
    for row, name in enumerate("AB"):
        columns = [points[row], slopes[row], bends[row]]
        known = [[column[place] for column in columns] for place in range(3)]
        exact = (
            CubicHermiteSpline(times, *columns[:2])
            if "Cubic" in method
            else BPoly.from_derivatives(times, known)
        )
        now = result.times[result.times <= 1.5]
        found = result[f"q.{name}"][: now.size] + points[row][0]
        np.testing.assert_allclose(found, exact(now), atol=1e-3)


@pytest.mark.parametrize(("kind", "wrong"), [
    ("Polynomial", {"Method": "B-Spline"}), ("Polynomial", {"TimePoints": "[1 1]"}),
    ("Polynomial", {"VelocityBoundaryCondition": "[1 2 3]"}), ("Trapezoidal Velocity Profile", {"Waypoints": "[]"}),
    ("Trapezoidal Velocity Profile", {"NumParams": "1", "Parameter1": "End Time", "EndTime": "0"}),
    ("Trapezoidal Velocity Profile", {"NumParams": "1", "Parameter1": "Peak Velocity", "PeakVelocity": "0"}),
])  # fmt: skip
def test_what_makes_no_trajectory_is_left_open(tmp_path, kind, wrong):
    plant = Plant()
    clock = plant.chain("Clock", "Clock")
    made = plant.chain(
        f"{CORE}/{kind} Trajectory", "Way", clock, **{"Waypoints": "[0 1; 0 1]", **wrong}
    )
    plant.drive(*plant.split(made))
    imported = import_simulink(write_model(tmp_path / "a.slx", plant), tmp_path / "out")
    assert imported.fidelity == "2 drives lost; 1 control block left open"


class Pursuer:
    """Pursues a path by the point nearest to it, of the segment that it was on and those within sight."""

    def __init__(self, path, ahead):
        self.path, self.ahead, self.point, self.segment = np.array(path), ahead, None, 0

    def look(self, place):
        last = len(self.path) - 1
        if self.point is None:
            candidates = [(self.path[k], self.path[k + 1], k) for k in range(last)]
        else:
            candidates = [(self.point, self.path[self.segment + 1], self.segment)]
            gone = np.linalg.norm(self.path[self.segment + 1] - self.point)
            for k in range(self.segment + 1, last):
                if gone > self.ahead:
                    break
                candidates.append((self.path[k], self.path[k + 1], k))
                gone += np.linalg.norm(self.path[k + 1] - self.path[k])
        found = []
        for start, end, k in candidates:
            way = end - start
            part = np.clip((place - start) @ way / max(way @ way, 1e-30), 0, 1)
            found.append((np.linalg.norm(place - start - part * way), k, start + part * way))
        _, self.segment, self.point = min(found, key=lambda one: one[0])
        left, here, k = self.ahead, self.point, self.segment
        while k < last and np.linalg.norm(self.path[k + 1] - here) < left:
            left -= np.linalg.norm(self.path[k + 1] - here)
            here, k = self.path[k + 1], k + 1
        if k == last:
            return self.path[-1]
        way = self.path[k + 1] - here
        return here + left * way / np.linalg.norm(way)


def test_a_pure_pursuit_of_a_path(tmp_path):
    """Angles of two hinges as x and y, and the turn rate as torque on one of them: the path is looked at each 0.1 s."""
    plant = Plant()
    pose = plant.chain(
        "Mux", "Pose", *plant.positions, plant.chain("Constant", "Heading", Value="0.3"), Inputs="3"
    )
    sampled = plant.chain("ZeroOrderHold", "Looks", pose, SampleTime="0.1")
    path = plant.chain(
        "Constant", "Path", Value="[0 0; 0.2 0.05; 0.4 0.5; 0.1 0.6; -0.3 0.6; 0.14 0.03]"
    )
    made = plant.block("robotalgslib/Pure Pursuit", "Pursuit", DesiredLinearVelocity="0.5", LookaheadDistance="0.3",
                       MaxAngularVelocity="5")  # fmt: skip
    plant.wire(sampled, f"{made}#in:1")
    plant.wire(path, f"{made}#in:2")
    plant.drive(f"{made}#out:1", f"{made}#out:2")
    imported = import_simulink(write_model(tmp_path / "a.slx", plant), tmp_path / "out")
    assert imported.fidelity == "mechanics complete"
    result = simulate(load_station(imported.station, TIGHT), duration=2.0, progress=False)
    pursuer, turns = (
        Pursuer([[0, 0], [0.2, 0.05], [0.4, 0.5], [0.1, 0.6], [-0.3, 0.6], [0.14, 0.03]], 0.3),
        set(),
    )
    place, speed = np.zeros(2), np.zeros(2)
    for step in range(20):
        to = pursuer.look(place) - place
        rate = float(np.clip(2 * np.sin(np.arctan2(to[1], to[0]) - 0.3) / 0.3, -5, 5))
        turns.add(pursuer.segment)
        push = np.array([0.5, rate])
        place, speed = place + 0.1 * speed + 0.005 * push, speed + 0.1 * push
        found = [np.interp(0.1 * (step + 1), result.times, result[f"q.{name}"]) for name in "AB"]
        np.testing.assert_allclose(found, place, atol=1e-3)
    assert turns >= {0, 1, 2}


def test_wheels_of_two_sizes_stand_on_their_own(tmp_path):
    """A cart whose balls of 0.1 m and 0.05 m touch the floor 0.4 m apart stands at a slant."""
    level = Level()
    world, joint = level.block(WORLD, "World"), level.block("sm_lib/Joints/6-DOF Joint", "Free",
        PzPositionTargetSpecify="on", PzPositionTargetValue="0.1")  # fmt: skip
    body = level.block(BRICK, "Body", BasedOnType="Mass", Mass="2", BrickDimensions="[0.1 0.1 0.1]")
    ground = level.block("sm_lib/Curves and Surfaces/Infinite Plane", "Ground")
    level.connect(f"{world}#rconn:1", f"{joint}#lconn:1", f"{ground}#lconn:1")
    level.connect(f"{joint}#rconn:1", f"{body}#rconn:1")
    touched = []
    for x, y, radius in ((0.2, 0.2, 0.1), (0.2, -0.2, 0.1), (-0.2, 0.0, 0.05)):
        at = level.block("sm_lib/Frames and\nTransforms/Rigid\nTransform", f"At {x} {y}",
                         TranslationMethod="Cartesian", TranslationCartesianOffset=f"[{x} {y} 0]")  # fmt: skip
        hinge = level.block(REVOLUTE, f"Hinge {x} {y}")
        ball = level.block("sm_lib/Body Elements/Spherical Solid", f"Ball {x} {y}", SphereRadius=radius,
                           BasedOnType="Mass", Mass="0.1", ExportEntireGeometry="on")  # fmt: skip
        touch = level.block(TOUCH, f"Touch {x} {y}", **FIGURES)
        level.connect(f"{joint}#rconn:1", f"{at}#lconn:1")
        level.connect(f"{at}#rconn:1", f"{hinge}#lconn:1")
        level.connect(f"{hinge}#rconn:1", f"{ball}#rconn:1")
        level.connect(f"{ball}#lconn:1", f"{touch}#lconn:1")
        level.connect(f"{ground}#rconn:1", f"{touch}#rconn:1")
        touched.append(touch)
    imported = import_simulink(write_model(tmp_path / "a.slx", level), tmp_path / "out")
    result = simulate(imported.station, duration=1.5, progress=False)
    slant = np.arcsin((0.1 - 0.05) / 0.4)  # its front is higher
    pose = result.pose("base")[-1]
    assert 2 * np.arcsin(abs(pose[5])) == pytest.approx(slant, abs=2e-3)
    assert pose[2] == pytest.approx(0.075, abs=1e-3)


def test_a_motion_that_is_quicker_than_rows_has_more_of_them(tmp_path):
    """A step through a lag of 2 ms comes to 1 - exp(-t / 2 ms)."""
    plant = Plant(motion=True)
    step = plant.chain("Step", "Step", Time="0.1025", SampleTime="0")
    lag = plant.chain("TransferFcn", "Lag", step, Numerator="[1]", Denominator="[0.002 1]")
    plant.drive(lag, lag)
    imported = import_simulink(write_model(tmp_path / "a.slx", plant), tmp_path / "out")
    (table,) = (tmp_path / "out").glob("*.csv")
    rows = np.loadtxt(table, delimiter=",", skiprows=1)
    times = np.linspace(0.103, 0.15, 471)
    exact = 1 - np.exp(-(times - 0.1025) / 0.002)
    np.testing.assert_allclose(np.interp(times, rows[:, 0], rows[:, 1]), exact, atol=0.01)
    assert imported.fidelity == "mechanics complete"
    assert len(rows) < 400
