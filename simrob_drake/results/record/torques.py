"""Torques of a recorded run, compared with what the motors can give."""

import numpy as np

from simrob_drake.base.frames import Vector
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.results.record.run import RecordedRun


def torque_shares(run: RecordedRun, robot: StationRobot) -> Vector:
    """Absolute torques of a robot's axes as shares of what their motors can give.

    The motor of a dynamic station may have a torque that falls with its speed; otherwise the limit of the servo counts.
    The shares of fingers are 0: fingers press on what they hold as hard as they may. So are those of axes without a
    motor, whose limit counts as infinite.

    Args:
        run: a run of the robot's station.
        robot: the robot.

    Returns:
        the shares of n axes at m samples, shape (m, n). 1 is all that the motor can give.
    """
    torque = run.axes("tau", robot.name)
    if run.config.engine.moves_by_forces:
        shares = robot.gains.torque_shares(torque, run.axes("v", robot.name))
    else:
        # The torques of a kinematic station are those that its prescribed motion would need.
        shares = np.abs(torque) / robot.gains.judged_limit
    shares[:, list(robot.model.fingers)] = 0.0  # indices of their axes
    return shares
