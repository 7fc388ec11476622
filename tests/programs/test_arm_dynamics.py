"""The dynamics of an arm with what it carries, and of its planned moves."""

import numpy as np
import pytest

from simrob_drake import Arm, load_station


def test_a_planned_move_takes_the_torques_that_a_run_tells() -> None:
    """To 1e-9, for both follow the same spline; the run's come from Drake's block and its own pieces."""
    arm = Arm("irb120_kinematic")
    plan = arm.plan.move_abs_j([0.3, 0.4, 0.2, -0.5, 0.9, 0.3], duration=0.5)
    result = arm.cell.run(plan)

    torques = arm.dynamics.inverse_dynamics(*plan.motion(result.times))

    np.testing.assert_allclose(torques, result.axes("tau"), rtol=0, atol=1e-9)

    margins = arm.dynamics.torque_margin(*plan.motion(result.times))
    limits = arm.cell.robot("robot").gains.torque_limit

    np.testing.assert_allclose(margins, limits - np.abs(result.axes("tau")), rtol=0, atol=1e-9)


def test_what_is_in_the_hand_is_no_longer_to_spare() -> None:
    """A point mass at the tool centre point takes as much off the payload as it weighs."""
    tcp = list(
        load_station("irb120_kinematic", {"pieces.load.tcp": [0.05, 0, 0.1, 0, 0, 0]})
        .pieces["load"]
        .tcp
        or []
    )
    held = {"pieces.load.tcp": tcp, "pieces.load.com": tcp[:3], "pieces.load.inertia": [0, 0, 0]}
    arms = [
        Arm(load_station("irb120_kinematic", {**held, "pieces.load.mass": mass}))
        for mass in (1.0, 4.0)
    ]
    posture = [0.1, 0.6, 0.3, 0.4, 0.7, 0.2]

    light, heavy = (arm.dynamics.payload(posture) for arm in arms)

    loaded = np.isfinite(light) & (light < 1e6)
    assert loaded[1:5].all()
    np.testing.assert_allclose(light[loaded] - heavy[loaded], 3.0, rtol=0, atol=1e-9)
    with pytest.raises(ValueError, match="6 finite numbers"):
        arms[0].dynamics.gravity([0.0])
