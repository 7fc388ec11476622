"""Motors of servos in an exported MJCF file: what it has of them, and what it cannot say."""

from pathlib import Path

import numpy as np
import pytest

from simrob_drake.base.errors import SimrobError
from simrob_drake.extensions.mujoco.built import BuiltStation, check_sayable
from simrob_drake.stations.load import load_station
from simrob_drake.stations.resolve import resolve
from tests.stations.test_motors import FASTEST, KD, KP, MOTOR, STALL, angles_by_hand, joint  # noqa: F401  # joint: a fixture


def test_plain_mjcf_has_motors_as_dampers_beside_servos(joint: Path) -> None:  # noqa: F811
    mujoco = pytest.importorskip("mujoco")
    config = load_station(joint, MOTOR)
    with pytest.raises(
        SimrobError, match=r"servo\.motor is given; it must be none, or a whole damper"
    ):
        check_sayable(config, resolve(config).robots)
    built = BuiltStation.of(
        load_station(joint, {**MOTOR, "servo.realization": "implicit"}), step=1e-3
    )
    data = mujoco.MjData(built.model)
    angles = [0.0]
    told = []
    data.ctrl[:] = np.deg2rad(230)
    for count in range(1, 1201):
        mujoco.mj_step(built.model, data)
        if count % 2 == 0:
            angles.append(data.qpos[0])
            mujoco.mj_forward(built.model, data)
            told.append((*built.output("torque", data.sensordata[np.newaxis])[0], data.qvel[0]))
    assert np.abs(np.array(angles) - angles_by_hand(np.inf)).max() < 8e-3
    torque, speed = np.array(told).T
    share = np.abs(torque + STALL / FASTEST * speed) / STALL
    assert 0.99 < share.max() < 1 + 1e-9


def test_a_bus_is_not_exported(joint: Path) -> None:  # noqa: F811
    station = load_station(joint, {"servo.bus": {"latency": 0.02}, "servo.realization": "implicit"})
    with pytest.raises(SimrobError, match=r"servo\.bus: .* commands without delay; leave it out"):
        check_sayable(station, resolve(station).robots)
