"""A robot's equations of motion, against the textbook's recursion and closed forms."""

from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from simrob_drake.base.constants import STANDARD_GRAVITY
from simrob_drake.base.errors import SimrobError
from simrob_drake.base.sections import validate_section
from simrob_drake.dynamics import Dynamics
from simrob_drake.kinematics import Chain
from simrob_drake.robots.catalog import RobotModel, load_robot, load_robot_file
from simrob_drake.robots.motors import Drives

RNG = np.random.default_rng(3)
POSTURES, SPEEDS, ACCELERATIONS = RNG.uniform(-3, 3, (3, 10, 6))


def newton_euler(
    robot: RobotModel, q: np.ndarray, v: np.ndarray, a: np.ndarray, gravity: float
) -> np.ndarray:
    """Return the torques of a motion by Luh, Walker and Paul's recursion in the frames of a classical table.

    Rotors count G² J about their joint alone, as in Corke's toolbox; friction is left out.
    """
    assert robot.dh is not None
    z, rows = np.array([0.0, 0.0, 1.0]), robot.dh.rows
    w, dw, dv = np.zeros(3), np.zeros(3), gravity * z  # a base that rises feels its weight
    turns, arms, forces, moments = [], [], [], []
    for row, angle, speed, gain in zip(rows, q, v, a, strict=True):
        c, s = np.cos(angle), np.sin(angle)
        ca, sa = np.cos(np.deg2rad(row.alpha_deg)), np.sin(np.deg2rad(row.alpha_deg))
        # of this frame in the one before
        turn = np.array([[c, -s * ca, s * sa], [s, c * ca, -c * sa], [0, sa, ca]])
        # from the origin before to this one, in this frame
        arm = np.array([row.a, row.d * sa, row.d * ca])
        w, dw = turn.T @ (w + speed * z), turn.T @ (dw + gain * z + np.cross(w, speed * z))
        dv = turn.T @ dv + np.cross(dw, arm) + np.cross(w, np.cross(w, arm))
        com, inertia = np.array(row.com), np.diag(row.inertia)
        of_com = dv + np.cross(dw, com) + np.cross(w, np.cross(w, com))
        turns, arms = [*turns, turn], [*arms, arm]
        forces, moments = (
            [*forces, row.mass * of_com],
            [*moments, inertia @ dw + np.cross(w, inertia @ w)],
        )
    force, moment, torques = np.zeros(3), np.zeros(3), []
    for index in reversed(range(len(rows))):
        com = np.array(rows[index].com)
        moment = (
            moment
            + np.cross(arms[index], force)
            + np.cross(arms[index] + com, forces[index])
            + moments[index]
        )
        force = force + forces[index]
        force, moment = turns[index] @ force, turns[index] @ moment
        torques.append(moment[2])
    return np.array(torques[::-1])


@pytest.fixture(scope="module")
def puma() -> Dynamics:
    return Dynamics.of_robot("puma560")


def reflected() -> np.ndarray:
    drives = load_robot("puma560").drives
    return np.array(drives.gear_ratio) ** 2 * np.array(drives.rotor_inertia)


def test_the_puma_is_the_textbooks(puma: Dynamics) -> None:
    """Inertia, Coriolis and gravity terms by the recursion, one by one, to 1e-9; rotors add G² J to the diagonal."""
    robot, nothing, units = load_robot("puma560"), np.zeros(6), np.eye(6)
    for q, v in zip(POSTURES, SPEEDS, strict=True):
        inertia = np.column_stack([newton_euler(robot, q, nothing, unit, 0.0) for unit in units])
        np.testing.assert_allclose(
            puma.inertia(q), inertia + np.diag(reflected()), rtol=0, atol=1e-9
        )
        coriolis = newton_euler(robot, q, v, nothing, 0.0)
        np.testing.assert_allclose(
            puma.coriolis(q, v) @ v, coriolis, rtol=0, atol=1e-9 * np.abs(coriolis).max()
        )
        gravity = newton_euler(robot, q, nothing, nothing, STANDARD_GRAVITY)
        np.testing.assert_allclose(puma.gravity(q), gravity, rtol=0, atol=1e-9)


def test_motors_change_the_inertia_by_their_own_times_the_gear_ratio_squared(
    puma: Dynamics,
) -> None:
    bare = Dynamics.of_robot(load_robot("puma560").with_drives(Drives(rotor_inertia=0.0)))
    difference = puma.inertia(POSTURES) - bare.inertia(POSTURES)

    np.testing.assert_allclose(
        difference, np.broadcast_to(np.diag(reflected()), (10, 6, 6)), rtol=0, atol=1e-9
    )
    # kg m², Corke's
    assert reflected() == pytest.approx([0.784, 2.325, 0.577, 0.191, 0.171, 0.194], abs=1e-3)


def test_the_terms_add_up_to_the_torques_with_friction(puma: Dynamics) -> None:
    drives, q, v, a = load_robot("puma560").drives, POSTURES, SPEEDS / 200, ACCELERATIONS
    terms = np.einsum("kij,kj->ki", puma.inertia(q), a) + np.einsum(
        "kij,kj->ki", puma.coriolis(q, v), v
    )
    friction = np.array(drives.damping) * v + np.array(drives.friction) * np.clip(
        v / drives.friction_speed, -1, 1
    )

    torque = puma.inverse_dynamics(q, v, a)

    np.testing.assert_allclose(torque, terms + puma.gravity(q) + friction, rtol=0, atol=1e-9)
    np.testing.assert_allclose(puma.forward_dynamics(q, v, torque), a, rtol=0, atol=1e-9)
    np.testing.assert_allclose(
        puma.torque_margin(q, v, a), puma.torque_limit - np.abs(torque), rtol=0, atol=0
    )


def test_the_coriolis_matrix_is_that_of_christoffel(puma: Dynamics) -> None:
    """dM/dt - 2 C is skew, and C is linear in the speeds; dM/dt by central differences to 1e-6."""
    q, v, step = POSTURES[0], SPEEDS[0], 1e-6
    rate = (puma.inertia(q + step * v) - puma.inertia(q - step * v)) / (2 * step)

    skew = rate - 2 * puma.coriolis(q, v)

    np.testing.assert_allclose(skew, -skew.T, rtol=0, atol=1e-6)
    np.testing.assert_allclose(
        puma.coriolis(q, 1e-3 * v), 1e-3 * puma.coriolis(q, v), rtol=0, atol=1e-10
    )


def test_the_jacobian_moves_the_tool_and_tells_where_it_cannot() -> None:
    arm, chain = Dynamics.of_robot("irb120"), Chain.of_robot(load_robot("irb120"))

    np.testing.assert_allclose(arm.jacobian(POSTURES), chain.jacobian(POSTURES), rtol=0, atol=1e-12)

    square = np.array([abs(np.linalg.det(jacobian)) for jacobian in arm.jacobian(POSTURES)])
    np.testing.assert_allclose(arm.manipulability(POSTURES), square, rtol=1e-9)
    # wrist: axes 4 and 6 are one line
    assert arm.manipulability([0, 0, 0, 0, 0, 0]) == pytest.approx(0, abs=1e-12)
    assert arm.manipulability([0, 0, 0, 0, 0, 0], "translation") > 0.01


ROD = {
    "limit_deg": [-180, 180],
    "effort": 20.0,
    "mass": 2.0,
    "com": [-0.25, 0, 0],
    "inertia": [1e-3, 0.04, 0.04],
}
"""Of half a metre, about a level axis."""


def rod(**more: object) -> RobotModel:
    dh = {
        "convention": "classical",
        "base": [0, 0, 1, 0, 0, np.pi / 2],
        "rows": [{**ROD, "a": 0.5}],
    }
    return validate_section(RobotModel, {"name": "rod", "folder": Path(), "dh": dh, **more}, "rod")


def test_a_rod_holds_what_its_closed_form_says() -> None:
    """Stretched out level: g m l/2 by its own weight, g l by each kilogram at its end; upright any load."""
    arm, g = Dynamics.of_robot(rod()), STANDARD_GRAVITY

    assert arm.gravity([0.0]) == pytest.approx([2.0 * g * 0.25])
    assert arm.payload([0.0]) == pytest.approx([(20.0 - 2.0 * g * 0.25) / (0.5 * g)])
    assert arm.payload([np.pi]) == pytest.approx(arm.payload([0.0]))  # on the other side
    assert arm.payload([np.pi / 2])[0] > 1e6

    # a load has the inertia m l², and what turns it does not act on its axis
    speeding = arm.payload([0.0], v=2.0, a=3.0)
    assert speeding == pytest.approx(
        [(20.0 - 2.0 * g * 0.25 - (0.04 + 2 * 0.25**2) * 3.0) / (0.5 * g + 0.5**2 * 3.0)]
    )
    assert abs(np.cos(arm.weakest_posture())) == pytest.approx([1.0])

    weak = rod(dh={**rod().model_dump()["dh"], "rows": [{**ROD, "a": 0.5, "effort": 4.0}]})
    assert Dynamics.of_robot(weak).payload([0.0]) == [0.0]


def test_the_weakest_posture_of_an_arm_is_none_better_than_a_thousand_others() -> None:
    arm, limits = Dynamics.of_robot("irb120"), load_robot("irb120").axis_limits
    others = arm.payload(np.random.default_rng(5).uniform(*limits, (1000, 6)))
    assert 0 < arm.payload(arm.weakest_posture()).min() <= others.min()


def test_drives_of_a_urdf_and_of_a_description_are_the_same(tmp_path: Path) -> None:
    """A URDF's own tags reach Drake; a description overrides them, axis by axis."""
    robot = rod(drives={"rotor_inertia": 1e-4, "gear_ratio": 100, "damping": 0.3, "friction": 2.0})
    file = tmp_path / "rod.urdf"

    file.write_bytes(ET.tostring(robot.element))
    text = file.read_text()
    assert all(tag in text for tag in ("drake:rotor_inertia", "drake:gear_ratio", 'friction="2"'))

    by_urdf, by_table = Dynamics.of_robot(file), Dynamics.of_robot(robot)
    for arm in (by_urdf, by_table):
        assert arm.inertia([0.0]) == pytest.approx(np.array([[0.04 + 2 * 0.25**2 + 1.0]]))
        assert arm.inverse_dynamics([np.pi / 2], [0.5]) == pytest.approx([0.3 * 0.5 + 2.0])
        # half of v_s
        assert arm.inverse_dynamics([np.pi / 2], [-0.005]) == pytest.approx([-0.3 * 0.005 - 1.0])

    (tmp_path / "robot.yaml").write_text(
        "urdf: rod.urdf\nroot: base_link\naxes: [joint_1]\ndrives: {gear_ratio: 10}\n"
    )
    described = Dynamics.of_robot(tmp_path / "robot.yaml")
    assert described.inertia([0.0]) == pytest.approx(np.array([[0.04 + 2 * 0.25**2 + 0.01]]))

    changed = load_robot("puma560").with_drives(Drives(friction={"joint_2": 1.0}))
    assert changed.friction.tolist()[:3] == [25.984, 1.0, 6.3642]
    assert load_robot_file(tmp_path / "robot.yaml").friction.tolist() == [2.0]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Dynamics.of_robot("puma56"), "puma560"),
        (lambda: Dynamics.of_robot("puma560", tool="grip"), "tool0"),
        (lambda: Dynamics.of_robot(3), "a name of `simrob list`"),  # type: ignore[arg-type]
        (lambda: Dynamics.of_robot("irb120").inertia([0, 0]), "6 finite numbers"),
        (
            lambda: Dynamics.of_robot("irb120").coriolis(np.zeros(6), np.zeros(2)),
            "an array of the shape of q",
        ),
        (lambda: Dynamics.of_robot("irb120").manipulability(np.zeros(6), "speed"), "rotation"),  # type: ignore[arg-type]
        (lambda: Dynamics.of_robot(rod(tools={})).payload([0.0]), "tool"),
        (lambda: Drives(gear_ratio=0.0), "gear_ratio: it must be a number from 1e-6 to 1e6"),
        (lambda: Drives(friction=[1.0, -1.0]), "friction: it must be a number from 0 to 1e9"),
    ],
)
def test_what_cannot_be_is_told(call, message) -> None:
    with pytest.raises((SimrobError, ValueError), match=message):
        call()
