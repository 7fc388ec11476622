r"""How well a legged robot walked, computed from the recorded states of a run.

All figures are about the root link and the samples of the run, from its beginning to its end; SI units and radians.
"Ahead" is where the robot faced at the beginning, seen from above.

Under ``cenic`` torques are those of the second half of each step (see ``signals.Sampler``), so
peaks and work of walks come out a little low: by a tenth with steps of 10 ms.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from simrob_drake.base.frames import Vector, transform_from_xyz_quaternion
from simrob_drake.base.messages import message
from simrob_drake.blocks.servo import AT_LIMIT
from simrob_drake.parts.resolved import name_or_only
from simrob_drake.parts.station_plant import StationPlant, StationRobot
from simrob_drake.results.record.run import RecordedRun, fallen
from simrob_drake.results.record.torques import torque_shares
from simrob_drake.results.record.touch import legged

_SHORTEST_WAY = 0.01  # way below which a cost of transport means nothing [m]


def legged_robots(result: RecordedRun) -> list[str]:
    """Return the robots of a run that could walk: with feet, a free base and joints that are moved by torque."""
    return [robot.name for robot in legged(result.config, result.plant)]


@dataclass(frozen=True)
class Locomotion:
    """What became of a walk."""

    distance: float  # horizontal distance between the root's first and last place [m]
    # its parts ahead and to the left [m]
    ahead: float
    drift: float
    speed: float  # distance over the time of the run [m/s]
    yaw: float  # by how much it turned to the left, whole turns counted [rad]
    tilt: float  # largest angle of the root's z axis from the vertical [rad]
    smallest_height: float  # of the root over the ground beneath [m]
    fall_time: float | None  # when a fall monitor ended the run [s], or None
    # ``axis``, ``torque``, ``limit`` [N·m] and ``ratio``, where a motor gave the largest share of what it can at its
    # speed: that is :math:`|\tau| / \tau_{max}`, and more where the torque of the motor falls with its speed
    peak_torque: dict[str, Any]
    saturated: float  # part of the samples in which the busiest joint is at its limit
    work: float  # :math:`\int \sum_i |\tau_i \dot q_i| \, dt`, trapezoids between samples [J]
    cost_of_transport: float | None  # work over :math:`m g` times distance, or None below 1 cm
    foot_slip: dict[str, float]  # by link, see :func:`foot_slip` [m]

    @property
    def upright(self) -> bool:
        """Whether no fall ended the run."""
        return self.fall_time is None


def locomotion(result: RecordedRun, robot: str | None = None) -> Locomotion:
    """Return the measures of a legged robot's run.

    Args:
        result: a run that did not diverge.
        robot: its name; needed where there are several legged ones.

    Raises:
        UnknownName: no such legged robot.
        InvalidParameter: none named, and there is not just one.
    """
    name = name_or_only(robot, legged_robots(result), kind=message("results.legged_robot", "legged robot"))
    own = result.plant.robots[name]
    base = result.pose("base", name)
    way = base[-1, :2] - base[0, :2]
    heading = headings(result.plant, own, base)
    ahead = np.array([np.cos(heading[0]), np.sin(heading[0])])
    distance = float(np.linalg.norm(way))
    work = mechanical_work(result, name)
    plant = result.plant.plant
    weight = float(plant.CalcTotalMass(plant.CreateDefaultContext(), [own.instance]) * abs(result.config.gravity))  # N
    shares = torque_shares(result, own)
    axis = int(np.argmax(shares.max(axis=0)))
    busiest = int(np.argmax(shares[:, axis]))  # index of the sample
    return Locomotion(
        distance=distance,
        ahead=float(way @ ahead),
        drift=float(way @ [-ahead[1], ahead[0]]),
        speed=distance / result.simulated_time if result.simulated_time > 0 else 0.0,
        yaw=float(heading[-1] - heading[0]),
        tilt=float(tilts(base).max()),
        smallest_height=float((base[:, 2] - result.plant.ground.beneath(base[:, :3])).min()),
        fall_time=result.stop_time if fallen(result) == name else None,
        peak_torque={
            "axis": own.axes[axis],
            "torque": float(np.abs(result.axes("tau", name))[busiest, axis]),
            "limit": float(own.gains.torque_limit[axis]),
            "ratio": float(shares[busiest, axis]),
        },
        saturated=float((shares > AT_LIMIT).mean(axis=0).max()),
        work=work,
        cost_of_transport=work / (weight * distance) if distance > _SHORTEST_WAY else None,
        foot_slip=foot_slip(result, name),
    )


def tilts(base: Vector) -> Vector:
    """Return the angles (m,) of the z axis of poses (m, 7) from the vertical [rad]."""
    return np.asarray(np.arccos(np.clip(1.0 - 2.0 * (base[:, 4] ** 2 + base[:, 5] ** 2), -1.0, 1.0)))


def headings(station: StationPlant, robot: StationRobot, base: Vector) -> Vector:
    """Return where a robot faces, counterclockwise from x, without jumps, shape (m,) [rad], of its root's poses (m, 7).

    It faces across the line from its right to its left feet, as its tools are called, in the posture of zero angles;
    along its root's x where they do not tell left from right.
    """
    context = station.plant.CreateDefaultContext()
    robot.axis_map.set_positions(station.plant, context, np.zeros(len(robot.axes)))
    sides = {
        side: [frame.CalcPose(context, robot.root).translation() for name, frame in robot.tools.items() if side in name]
        for side in ("left", "right")
    }
    poses = [transform_from_xyz_quaternion(row).rotation().matrix() for row in base]
    forward = np.array([1.0, 0.0, 0.0])
    if sides["left"] and sides["right"]:
        across = np.mean(sides["left"], axis=0) - np.mean(sides["right"], axis=0)
        forward = np.cross(across, poses[0].T @ [0.0, 0.0, 1.0])
    seen = np.array(poses) @ forward
    return np.asarray(np.unwrap(np.arctan2(seen[:, 1], seen[:, 0])))


def mechanical_work(result: RecordedRun, robot: str) -> float:
    r"""Return :math:`\int \sum_i |\tau_i \dot q_i| \, dt` over a run [J]: joints that brake give nothing back."""
    power = np.abs(result.axes("tau", robot) * result.axes("v", robot)).sum(axis=1)
    return float(np.trapezoid(power, result.times))


def foot_slip(result: RecordedRun, robot: str) -> dict[str, float]:
    """Return how far each foot slid over the ground, by its link [m]: see ``Slide`` of a verdict."""
    return {link: slide.total for (owner, link), slide in result.touch.slides.items() if owner == robot}
