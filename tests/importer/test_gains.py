"""First gains: what they hold, how they damp, and that a run does what they promise."""

import numpy as np
import pytest

from simrob_drake.base.constants import LARGEST_GAIN
from simrob_drake.base.files import models_root
from simrob_drake.importer.gains import first_gains
from simrob_drake.importer.importing import import_robot
from simrob_drake.robots.catalog import load_robot_from_urdf
from simrob_drake.robots.parse import lone_robot
from simrob_drake.simulation import simulate
from simrob_drake.stations.draft import draft_station
from simrob_drake.stations.load import load_station

ARMS = ["irb120", "double_pendulum", "irb120_on_belt"]


def mass_matrices(robot, count):
    """Yield mass matrices at random postures, in the order of the axes."""
    lone, random = lone_robot(robot, collision=False), np.random.default_rng(7)
    lower, upper = (np.clip(limit, -np.pi, np.pi) for limit in robot.axis_limits)
    context, places = lone.plant.CreateDefaultContext(), lone.axes.velocity_places
    for _ in range(count):
        lone.axes.set_positions(lone.plant, context, random.uniform(lower, upper))
        yield lone.plant.CalcMassMatrix(context)[np.ix_(places, places)]


@pytest.mark.parametrize("name", ARMS)
def test_every_mode_of_the_coupled_axes_is_damped(name):
    """M q'' + D q' + K q = 0: no mode overshoots by more than 0.1 %, which a damping ratio below 0.91 would."""
    robot = load_robot_from_urdf(models_root() / name / f"{name}.urdf")
    gains, size = first_gains(robot), len(robot.axes)
    for mass in mass_matrices(robot, 20):
        forces = -np.hstack([np.diag(gains.kp), np.diag(gains.kd)])
        poles = np.linalg.eigvals(
            np.vstack([np.eye(2 * size)[size:], np.linalg.solve(mass, forces)]),
        )
        assert (-poles.real / np.abs(poles)).min() > 0.91


def changed(urdf, *, axis="0 0 1", inertia="0.01", damping="0"):
    """Return the one-joint arm with other figures; its axis stands upright, so that gravity does not move it."""
    urdf = urdf.replace('"0 1 0"', f'"{axis}"').replace('damping="0.1"', f'damping="{damping}"')
    return urdf.replace('"0.01"', f'"{inertia}"')


@pytest.mark.parametrize("inertia", [0.01, 1e-6])
def test_a_joint_without_load_has_the_frequency_and_is_critically_damped(
    one_joint_urdf, write_urdf, inertia
):
    """However light: nothing is rounded up, or kd / kp, by which a joint lags behind, would be a second."""
    gains = first_gains(load_robot_from_urdf(write_urdf(changed(one_joint_urdf, inertia=inertia))))
    assert gains.kp == pytest.approx([30**2 * inertia], rel=0.05)
    assert gains.kd == pytest.approx([2 * 30 * inertia], rel=0.05)


def test_weight_lets_a_joint_sag_by_a_degree_and_an_axis_that_slides_by_a_millimetre(
    one_joint_urdf, write_urdf
):
    (kp,) = first_gains(load_robot_from_urdf(write_urdf(changed(one_joint_urdf, axis="0 1 0")))).kp

    assert kp == pytest.approx(1.0 * 9.81 * 0.1 / np.deg2rad(1.0), rel=0.05)

    sliding = changed(one_joint_urdf).replace("revolute", "prismatic")
    assert first_gains(load_robot_from_urdf(write_urdf(sliding))).kp == pytest.approx(
        [9.81 / 1e-3], rel=0.05
    )


def test_a_light_joint_with_damping_of_its_own_keeps_up(one_joint_urdf, write_urdf, tmp_path):
    """The damping of 0.5 N·m·s/rad holds it back by v b / kp, at the 25 deg/s of its first move by 0.83 deg."""
    urdf = write_urdf(changed(one_joint_urdf, inertia=1e-4, damping=0.5))
    (file := tmp_path / "first.yaml").write_text(draft_station(urdf))
    result = simulate(load_station(file), progress=False)

    error = np.rad2deg(np.abs(result.axes("q_ref") - result.axes("q")))

    assert error.max() == pytest.approx(np.rad2deg(np.abs(result.axes("v")).max()) / 30, rel=0.02)
    assert error[-1].max() < 1e-3


def test_a_joint_that_its_damping_holds_gets_the_largest_gain_and_the_report_names_it(
    one_joint_urdf, tmp_path
):
    """Some published files fix a joint by a damping of 1e11: 30 rad/s times that is no gain that a servo accepts."""
    (tmp_path / "arm").mkdir()
    source = tmp_path / "arm" / "arm.urdf"
    source.write_text(changed(one_joint_urdf, damping="1e11"))

    report = import_robot(source, tmp_path / "imported").report

    assert first_gains(load_robot_from_urdf(source)).kp == [LARGEST_GAIN]
    assert any("no servo can move shoulder" in entry.text for entry in report.entries)

    load_station_text = draft_station(tmp_path / "imported" / "arm.urdf", folder=tmp_path)
    (tmp_path / "station.yaml").write_text(load_station_text)

    assert load_station(tmp_path / "station.yaml").mode == "dynamic"
