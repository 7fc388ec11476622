"""Cameras for pictures of a run: their direction, their distance, and their motion with a robot that walks.

All positions are in the world, with z upwards. An *azimuth* is the direction from a station to the eye of the camera,
seen from above, counterclockwise from the x axis. All cameras look down at the same angle. The *base* of a robot is its
root link, and its *heading* the direction in which it faces, seen from above.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Vector, xyz_quaternion_from_transform
from simrob_drake.base.messages import message
from simrob_drake.parts.controllers.section import ControllerSection
from simrob_drake.parts.station_plant import StationPlant
from simrob_drake.results.record.run import DIVERGED, RecordedRun
from simrob_drake.results.record.walks import headings, legged_robots

FIELD_OF_VIEW = np.deg2rad(35.0)
"""Vertical opening angle of the cameras [rad]. It is narrow, so that links keep their proportions."""

WINDOW_ASPECT = 1.4
"""Width over height of a browser window that still shows everything. Most windows are wider."""

PANE_ASPECT = 1.0
"""Width over height of a view that shares a page with other things."""

_ASIDE = float(np.deg2rad(-50.0))
"""Azimuth of the eye from the direction a robot faces [rad]: the eye is at the right of the robot's front."""

_ELEVATION = np.deg2rad(20.0)
"""Angle at which the cameras look down [rad]."""

_MARGIN = 1.12
"""Size of the picture, relative to what must be in it."""

_NEAREST = 0.1
"""Least distance of the camera from what it shows [m]."""

_RELIABLE = 0.9
"""Part of a diverging run, from its start, that must be in the picture. After that the robot may fly off."""

_WALK = 0.6
"""A robot is followed if its base goes farther than this many times its height."""

_SAMPLE_PERIOD = 0.02
"""Time between the positions of the camera [s]."""

_HALF_WINDOW = 25
"""Positions before and after that are averaged, one second in all, so that the camera does not sway with the steps."""

_WEIGHTS = np.full(2 * _HALF_WINDOW + 1, 1.0 / (2 * _HALF_WINDOW + 1))
"""Weights of a moving average."""

Displacement = Callable[[Vector], Vector]
"""Displacement of a robot or a camera since the start of a run, shape (k, 3) [m], at times of the run (k,) [s]."""


@dataclass(frozen=True)
class Camera:
    """A camera that looks from its eye to its target, with z upwards in the picture.

    Attributes:
        eye: position of the eye, shape (3,) [m].
        target: a point in the middle of the picture, shape (3,) [m].
    """

    eye: Vector
    target: Vector

    def translate(self, displacement: Vector) -> "Camera":
        """Copy the camera, with eye and target displaced by a vector (3,) [m]. It looks in the same direction."""
        return Camera(self.eye + displacement, self.target + displacement)


def side(station: StationPlant) -> float:
    """Azimuth from which a station is shown [rad]: from the right of its front.

    The first robot with feet determines where the front is. Without such a robot, the front is in the direction of x.
    """
    for robot in station.robots.values():
        if robot.feet is not None:
            context = station.plant.CreateDefaultContext()
            root = xyz_quaternion_from_transform(robot.root.CalcPoseInWorld(context))
            heading = float(headings(station, robot, root[np.newaxis])[0])
            return heading + _ASIDE
    return _ASIDE


def robots_to_follow(
    robots: Iterable[str], controllers: Mapping[str, ControllerSection]
) -> set[str]:
    """Names of the robots that the camera follows because their controllers request it (`camera_follows`).

    Args:
        robots: names of the robots of a station.
        controllers: the controllers of the station, by name.
    """
    names = list(robots)
    # A controller that names no robot belongs to the only one. In a station of several robots it belongs to no
    # particular robot, and does not count.
    only_robot = names[0] if len(names) == 1 else None
    sections = [section for section in controllers.values() if section.camera_follows]
    followed = {section.robot_name or only_robot for section in sections}
    return {name for name in names if name in followed}


def framed_time(result: RecordedRun) -> float:
    """Time up to which the motion of a run must be in the picture [s]: its end; of a run that diverged, 90 % of it."""
    share = _RELIABLE if result.stopped_by == DIVERGED else 1.0
    return result.start_time + share * result.simulated_time


def frame_times(end: float, frames_per_second: float, *, begin: float = 0.0) -> Vector:
    """Times of the frames of a motion, shape (k,) [s]. The last frame is at the end, and may follow sooner.

    Args:
        end: end of the motion [s].
        frames_per_second: rate of the frames [1/s].
        begin: time of the first frame [s].

    Raises:
        InvalidParameter: the rate is not positive.
    """
    if not (np.isfinite(frames_per_second) and frames_per_second > 0):
        raise InvalidParameter(
            "frames_per_second",
            frames_per_second,
            message("results.positive_rate", "a positive rate [1/s]"),
        )
    # Without the small number, an error of the arithmetic would give a second frame just before the last one.
    count = max(int(np.ceil((end - begin) * frames_per_second - 1e-9)), 0)
    return np.append(begin + np.arange(count) / frames_per_second, end)


def walked_displacement(result: RecordedRun) -> Displacement | None:
    """Displacement of a camera that follows a walking robot: that of the robot, without the sway of its steps.

    The camera also follows the height of the floor. A robot whose controller requests it is followed as well.

    Returns:
        the displacement. It is None if the camera does not move: the station has no such robot or several robots, or
            the robot never gets farther from its start than 0.6 times the initial height of its base.
    """
    followed = _followed_robot(result)
    if followed is None:
        return None
    base = result.pose("base", followed)
    begin = result.start_time
    end = framed_time(result)
    # Even samples, whatever the rate of the signals: the moving average below has a fixed count of them.
    interval_count = max(round((end - begin) / _SAMPLE_PERIOD), 1)
    times = np.linspace(begin, end, interval_count + 1)
    x = np.interp(times, result.times, base[:, 0])
    y = np.interp(times, result.times, base[:, 1])

    ground = result.plant.ground
    # Relative to the robot's size: 30 cm are a walk for a small robot, and a sway for a large one.
    height = base[0, 2] - ground.beneath(base[:1, :3])[0]
    distances = np.hypot(x - x[0], y - y[0])
    if distances.max() < _WALK * height:
        return None
    smooth_x = _moving_average(x - x[0])
    smooth_y = _moving_average(y - y[0])

    def displacement(at: Vector) -> Vector:
        """Displacement of the camera (k, 3) [m] at times (k,) [s]."""
        level = np.column_stack(
            [np.interp(at, times, smooth_x), np.interp(at, times, smooth_y), np.zeros(len(at))]
        )
        # The height of the floor, not of the base: a camera that went up and down with the base would hide a
        # fall.
        upwards = np.outer(ground.floor_heights(level), [0.0, 0.0, 1.0])
        return np.asarray(level + upwards)

    return displacement


def _moving_average(values: Vector) -> Vector:
    """Average each value (k,) with the 25 before and the 25 after it. Returns as many values.

    Beyond the ends, the first and the last value are repeated.
    """
    # Padding by half a window on both sides keeps the count of values.
    return np.convolve(np.pad(values, _HALF_WINDOW, mode="edge"), _WEIGHTS, "valid")


def base_distances(result: RecordedRun, times: Vector) -> Vector:
    """Horizontal distance of the followed robot's base from its start, shape (k,) [m].

    At the end of the run it is the distance that the run's text and summary give, sway and a fall included.

    Args:
        result: a run of a station with one robot, which is followed.
        times: times of the run, shape (k,) [s].
    """
    base = result.pose("base", _followed_robot(result))
    x = base[:, 0] - base[0, 0]
    y = base[:, 1] - base[0, 1]
    return np.asarray(np.interp(times, result.times, np.hypot(x, y)))


def _followed_robot(result: RecordedRun) -> str | None:
    """Name of the robot that a camera may follow: one that could walk, or whose controller requests it.

    A robot could walk if it has feet, a base that moves freely, and joints that are moved by torques.

    Returns None if there is no such robot, or if the station has several robots of any kind.
    """
    followed = {
        *legged_robots(result),
        *robots_to_follow(result.plant.robots, result.config.controllers),
    }
    # With several robots, a camera at one of them would lose the others.
    return followed.pop() if len(result.plant.robots) == 1 and followed else None


def camera_on(points: Vector, *, aspect: float, azimuth: float = _ASIDE) -> Camera:
    """Find the nearest camera that has all points in its picture, with a margin of 12 %.

    Args:
        points: the points, shape (m, 3) [m].
        aspect: width over height of the picture.
        azimuth: direction from the points to the eye, counterclockwise from x [rad].
    """
    axes = _camera_axes(azimuth)
    rotation = np.array([axes.right, axes.up, axes.forward])
    across = (points @ rotation.T)[:, :2]  # to the right and upwards in the picture, shape (m, 2)
    along = points @ axes.forward  # from the camera into the picture, shape (m,)
    # Tangents of half the opening angles, to the right and upwards.
    half = np.tan(FIELD_OF_VIEW / 2) / _MARGIN * np.array([aspect, 1.0])

    # An eye at (e, d), across and along, has a point at (a, s) in its picture if |a - e| <= half (s - d), which is
    #     e + half d <= a + half s   and   e - half d >= a - half s.
    # With low = min(a + half s) and high = max(a - half s) over all points, the nearest eye, with the largest d, is at
    #     e = (low + high) / 2   and   d = (low - high) / (2 half), the smaller d of both directions.
    low = (across + half * along[:, np.newaxis]).min(axis=0)
    high = (across - half * along[:, np.newaxis]).max(axis=0)
    # The second bound keeps the eye in front of the nearest point, also if all points are on one line of sight.
    depth = min(((low - high) / (2 * half)).min(), along.min() - _NEAREST)
    eye = np.append((low + high) / 2, depth)
    target = np.append(eye[:2], (along.min() + along.max()) / 2)
    return Camera(eye @ rotation, target @ rotation)


def aspect_of(points: Vector, *, azimuth: float = _ASIDE) -> float:
    """Width over height of points as a camera far away sees them; 1 if they have no height.

    Args:
        points: the points, shape (m, 3) [m].
        azimuth: direction from the points to the camera, counterclockwise from x [rad].
    """
    axes = _camera_axes(azimuth)
    rotation = np.array([axes.right, axes.up, axes.forward])
    width, height = np.ptp((points @ rotation.T)[:, :2], axis=0)
    return float(width / height) if height > 0 else 1.0


class _CameraAxes(NamedTuple):
    """Unit vectors of a camera in the world, shape (3,) each."""

    right: Vector
    up: Vector
    forward: Vector


def _camera_axes(azimuth: float) -> _CameraAxes:
    """Compute the axes of a camera that stands at an azimuth [rad] and looks down by the usual angle."""
    level = np.cos(_ELEVATION)
    rise = np.sin(_ELEVATION)
    forward = -np.array([level * np.cos(azimuth), level * np.sin(azimuth), rise])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    return _CameraAxes(right, np.cross(right, forward), forward)
