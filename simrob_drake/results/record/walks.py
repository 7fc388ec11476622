"""Measures of how well a legged robot walked, computed from the recorded signals of a run.

The measures count from the first to the last sample of the run; they are in SI units and radians. Positions, speed,
tilt and heading are those of the robot's *base*, its root link. The *heading* is the direction in which the robot
faces, seen from above. "Ahead" is its heading at the first sample.

With the scheme ``cenic``, the recorded torques are those of the second half of each step (see ``signals.Sampler``). So
the peaks and the work of walks are a little too low: by a tenth with steps of 10 ms.
"""

from dataclasses import dataclass
from typing import TypedDict

import numpy as np

from simrob_drake.base.frames import Vector, transform_from_xyz_quaternion
from simrob_drake.base.messages import message
from simrob_drake.blocks.servo import AT_LIMIT
from simrob_drake.parts.resolved import name_or_only
from simrob_drake.parts.station_plant import StationPlant, StationRobot
from simrob_drake.results.record.run import RecordedRun, robot_that_fell
from simrob_drake.results.record.torques import torque_shares
from simrob_drake.results.record.touch import robots_that_can_walk

_SHORTEST_WAY = 0.01
"""Distance below which no cost of transport is computed, since it would be meaningless [m]."""


class PeakTorque(TypedDict):
    r"""The sample at which a motor gave the largest share of the torque that it can give.

    Attributes:
        axis: name of the axis.
        torque: absolute value of the torque there [N m; N for an axis that slides].
        limit: torque limit of the axis at rest, in the same unit.
        ratio: the share, :math:`|\tau| / \tau_{max}`. It is larger than ``torque / limit`` if the torque of the motor
            falls with its speed.
    """

    axis: str
    torque: float
    limit: float
    ratio: float


@dataclass(frozen=True)
class Locomotion:
    r"""Measures of a walk.

    Attributes:
        distance: horizontal distance between the first and the last position of the base [m].
        ahead: the part of it ahead [m].
        drift: the part of it to the left [m].
        speed: distance divided by the time of the run [m/s].
        yaw: angle by which the robot turned to the left [rad]; a whole turn counts as 2 pi.
        tilt: largest angle between the z axis of the base and the vertical [rad].
        smallest_height: smallest height of the base over the ground beneath it [m].
        fall_time: time at which a monitor of falls of this robot ended the run [s]; None if no such monitor did.
        peak_torque: the axis and the sample with the largest share of what the motor can give.
        saturated: share of the samples at which a motor gives all the torque that it can, for the motor that does so
            most often.
        work: mechanical work of the motors [J], see :func:`mechanical_work`.
        cost_of_transport: work divided by weight and distance; None if the distance is not longer than 1 cm.
        foot_slip: distance that each foot slid over the ground, by the name of its link [m].
    """

    distance: float
    ahead: float
    drift: float
    speed: float
    yaw: float
    tilt: float
    smallest_height: float
    fall_time: float | None
    peak_torque: PeakTorque
    saturated: float
    work: float
    cost_of_transport: float | None
    foot_slip: dict[str, float]

    @property
    def upright(self) -> bool:
        """Whether no fall of this robot ended the run."""
        return self.fall_time is None


def legged_robots(result: RecordedRun) -> list[str]:
    """Names of the robots that have feet, a base that moves freely, and joints that are moved by torques."""
    return [robot.name for robot in robots_that_can_walk(result.config, result.plant)]


def locomotion(result: RecordedRun, robot: str | None = None) -> Locomotion:
    """Compute the measures of a legged robot's run.

    Args:
        result: a run that did not diverge.
        robot: name of the robot; may be None if the run has only one legged robot.

    Raises:
        UnknownName: there is no legged robot of this name.
        InvalidParameter: the name is None, and the run has several legged robots or none.
    """
    name = name_or_only(
        robot, legged_robots(result), kind=message("results.legged_robot", "legged robot")
    )
    station_robot = result.plant.robots[name]
    base = result.pose("base", name)
    # Headings are without jumps by whole turns, so that a robot that turns twice has turned by 4 pi.
    headings_of_base = headings(result.plant, station_robot, base)

    # The horizontal displacement, and unit vectors ahead and to the left.
    displacement = base[-1, :2] - base[0, :2]
    distance = float(np.linalg.norm(displacement))
    ahead = np.array([np.cos(headings_of_base[0]), np.sin(headings_of_base[0])])
    left = np.array([-ahead[1], ahead[0]])

    duration = result.simulated_time
    # Over the ground beneath the base, which may have steps and slopes.
    heights = base[:, 2] - result.plant.ground.beneath(base[:, :3])
    shares = torque_shares(result, station_robot)
    work = mechanical_work(result, name)
    return Locomotion(
        distance=distance,
        # Projections on the axes of the start: a robot that walks a curve drifts, although it never steps
        # aside.
        ahead=float(displacement @ ahead),
        drift=float(displacement @ left),
        speed=distance / duration if duration > 0 else 0.0,  # a run may end at its start
        yaw=float(headings_of_base[-1] - headings_of_base[0]),
        tilt=float(tilts(base).max()),
        smallest_height=float(heights.min()),
        fall_time=result.stop_time if robot_that_fell(result) == name else None,
        peak_torque=_peak_torque(result, station_robot, shares),
        # The share of the samples at the limit (0.999 of it, because of rounding) for each axis; the largest of them.
        saturated=float((shares > AT_LIMIT).mean(axis=0).max()),
        work=work,
        cost_of_transport=_cost_of_transport(result, station_robot, work, distance),
        foot_slip=foot_slip(result, name),
    )


def _peak_torque(result: RecordedRun, robot: StationRobot, shares: Vector) -> PeakTorque:
    """Find the axis and the sample at which a motor gave the largest share of what it can give; the first of equals.

    Args:
        result: the run.
        robot: the robot.
        shares: torques as shares of what the motors can give, at m samples and n axes, shape (m, n).
    """
    # The axis with the largest share, then the sample at which it has it.
    axis = int(np.argmax(shares.max(axis=0)))
    sample = int(np.argmax(shares[:, axis]))
    torques = result.axes("tau", robot.name)  # [N m or N], shape (m, n)
    return PeakTorque(
        axis=robot.axes[axis],
        torque=float(np.abs(torques)[sample, axis]),
        # The limit at rest, and not the smaller one at the speed of this sample.
        limit=float(robot.gains.torque_limit[axis]),
        ratio=float(shares[sample, axis]),
    )


def _cost_of_transport(
    result: RecordedRun, robot: StationRobot, work: float, distance: float
) -> float | None:
    """Compute the cost of transport W / (m g d). Returns None if the distance is too short for it.

    Args:
        result: the run.
        robot: the robot.
        work: mechanical work W of its motors [J].
        distance: distance d that it walked [m].
    """
    is_far_enough = distance > _SHORTEST_WAY
    if not is_far_enough:
        return None
    plant = result.plant.plant
    # The mass of the robot with the pieces that it carries, which belong to its model instance.
    mass = plant.CalcTotalMass(plant.CreateDefaultContext(), [robot.instance])
    weight = float(mass * abs(result.config.gravity))  # [N]
    return work / (weight * distance)


def tilts(base: Vector) -> Vector:
    """Angles between the z axes of poses (m, 7) x y z qw qx qy qz and the vertical, shape (m,) [rad]."""
    qx = base[:, 4]
    qy = base[:, 5]
    # The z entry of the z axis of a rotation by a unit quaternion. Rounding may bring it beyond 1.
    cosines = 1.0 - 2.0 * (qx**2 + qy**2)
    return np.asarray(np.arccos(np.clip(cosines, -1.0, 1.0)))


def headings(station: StationPlant, robot: StationRobot, base: Vector) -> Vector:
    """Headings of a robot: angles from the world's x axis, counterclockwise, without jumps by whole turns.

    The robot faces at a right angle to the line from its right to its left feet, at zero joint angles. The feet are its
    tools with "left" or "right" in their names. Without such tools the robot faces along the x axis of its base.

    Args:
        station: the plant with the robot.
        robot: the robot.
        base: poses of its base, shape (m, 7): x y z [m] qw qx qy qz.

    Returns:
        the headings, shape (m,) [rad].
    """
    # Which side is left follows from names, since bases of robots have their axes in any direction.
    left = _tools_at_zero(station, robot, "left")
    right = _tools_at_zero(station, robot, "right")
    rotations = [transform_from_xyz_quaternion(pose).rotation().matrix() for pose in base]
    forward = np.array([1.0, 0.0, 0.0])
    if left and right:
        # In the axes of the base: forward = left x up, with the vertical as it is at the first sample.
        # A robot with four feet has two on each side; the line joins the middles of both sides.
        to_left = np.mean(left, axis=0) - np.mean(right, axis=0)
        up = rotations[0].T @ [0.0, 0.0, 1.0]
        forward = np.cross(to_left, up)
    directions = np.array(rotations) @ forward  # in the world, shape (m, 3)
    # The projection on the ground, seen from above: the height of the direction has no effect on the angle.
    angles = np.arctan2(directions[:, 1], directions[:, 0])
    return np.asarray(np.unwrap(angles))


def _tools_at_zero(station: StationPlant, robot: StationRobot, side: str) -> list[Vector]:
    """Positions (3,) of tool frames in the frame of the robot's base, at zero joint angles [m].

    The list is empty if the robot has no tool with such a name.

    Args:
        station: the plant with the robot.
        robot: the robot.
        side: "left" or "right": text in the names of the tools that are meant.
    """
    context = station.plant.CreateDefaultContext()
    robot.axis_map.set_positions(station.plant, context, np.zeros(len(robot.axes)))
    # Poses relative to the root link do not depend on where the base floats.
    frames = [frame for name, frame in robot.tools.items() if side in name]
    return [frame.CalcPose(context, robot.root).translation() for frame in frames]


def mechanical_work(result: RecordedRun, robot: str) -> float:
    r"""Mechanical work of a robot's motors in a run, :math:`\int \sum_i |\tau_i \dot q_i| \, dt` [J].

    Joints that brake give no energy back, hence the absolute value. The integral is that of trapezoids between samples.

    Args:
        result: the run.
        robot: name of the robot, all of whose axes count.
    """
    # Power of all axes [W], shape (m,).
    power = np.abs(result.axes("tau", robot) * result.axes("v", robot)).sum(axis=1)
    return float(np.trapezoid(power, result.times))


def foot_slip(result: RecordedRun, robot: str) -> dict[str, float]:
    """Distance that each foot of a robot slid over the ground in a run, by the name of the foot's link [m].

    Empty for a robot that cannot walk, see `robots_that_can_walk`.
    """
    return {
        foot.link: slide.total for foot, slide in result.touch.slides.items() if foot.robot == robot
    }
