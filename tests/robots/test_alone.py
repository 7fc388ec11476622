"""A robot alone in a plant."""

from copy import deepcopy

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant

from simrob_drake.robots.catalog import load_robot
from simrob_drake.robots.parse import add_urdf, lone_robot


def test_the_robot_stands_at_its_home_posture():
    robot = load_robot("irb120")
    lone = lone_robot(robot)

    context = lone.plant.CreateDefaultContext()

    np.testing.assert_allclose(lone.plant.GetPositions(context), np.deg2rad([0, 0, 0, 0, 90, 0]))

    tool = lone.plant.GetFrameByName("tool0").CalcPoseInWorld(context).translation()
    np.testing.assert_allclose(tool, [0.302, 0.0, 0.558], atol=1e-9)


def test_axes_turn_in_their_sense():
    robot = load_robot("irb120")
    axes = {name: axis.model_copy(update={"sign": -1}) for name, axis in robot.axes.items()}
    lone = lone_robot(robot.model_copy(update={"axes": axes}))
    context = lone.plant.CreateDefaultContext()

    lone.axes.set_positions(lone.plant, context, np.full(6, 0.3))

    np.testing.assert_allclose(lone.plant.GetPositions(context), np.full(6, -0.3))


def test_a_free_base_can_move():
    lone = lone_robot(load_robot("irb120"), floating=True)

    assert lone.plant.num_velocities() == 6 + 6
    velocities = np.arange(12.0)
    np.testing.assert_array_equal(lone.axes.velocities(velocities), np.arange(6.0, 12.0))


def test_size_is_the_spread_of_the_links():
    lone = lone_robot(load_robot("irb120").model_copy(update={"home_deg": 0.0}))
    # the highest joint above the foot, facts of the arm
    assert lone.size == pytest.approx(0.63, abs=1e-9)


def test_gears_that_drake_does_not_heed_make_no_noise(caplog):
    robot = load_robot("irb120")
    element = deepcopy(robot.element)
    gears = element.findall("transmission/actuator/mechanicalReduction")
    for gear in gears:
        gear.text = "50"
    plant = MultibodyPlant(0.0)

    with caplog.at_level("WARNING", logger="drake"):
        add_urdf(plant, element, name="arm", where="arm.urdf", collision=False)

    assert caplog.records == []
    assert len(gears) == 6
    # what was given stays
    assert element.findall("transmission/actuator/mechanicalReduction") == gears
