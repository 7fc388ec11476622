"""Where to look at a run from, and when: from which side, how near, beside a robot that walks, frame by frame."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from simrob_drake.base.errors import InvalidParameter
from simrob_drake.base.frames import Vector, xyz_quaternion_from_transform
from simrob_drake.base.messages import message
from simrob_drake.parts.controllers.section import ControllerSection
from simrob_drake.parts.station_plant import StationPlant
from simrob_drake.results.record.run import DIVERGED, RecordedRun
from simrob_drake.results.record.walks import headings, legged_robots

FIELD_OF_VIEW = np.deg2rad(35.0)  # vertical opening of the cameras [rad]; narrow, so that links keep their proportions
WINDOW_ASPECT = 1.4  # width over height of a browser window that still shows all: most are wider
PANE_ASPECT = 1.0  # likewise of a view beside other things on a page

_ASIDE = float(np.deg2rad(-50.0))  # of the eye from where a robot faces: it stands to the right of its front
_ELEVATION = np.deg2rad(20.0)
_MARGIN = 1.12  # how much wider than what moves the picture is
_NEAREST = 0.1  # how near a camera goes [m]
_TRUSTED = 0.9  # the part of a diverging run that is framed: then the robot may fly off
_WALK = 0.6  # a base that goes further than so many times its height is followed
_EVERY = 0.02  # s between the places of the camera
_HALF = 25  # places before and after, of which the camera takes the mean: a second in all, so that it does not sway
_MEAN = np.full(2 * _HALF + 1, 1.0 / (2 * _HALF + 1))

Way = Callable[[Vector], Vector]  # how far something has gone at the times (k,) [s] of a run: shape (k, 3) [m]


@dataclass(frozen=True)
class Camera:
    """Where an eye is and where it looks, shape (3,) [m] each; z is up in the picture."""

    eye: Vector
    target: Vector

    def moved(self, way: Vector) -> "Camera":
        """Return the camera with eye and target moved by the same way, shape (3,) [m]."""
        return Camera(self.eye + way, self.target + way)


def side(station: StationPlant) -> float:
    """Return the direction [rad] from which to look at a station: its front quarter.

    The first legged robot tells where the front is; other robots face x.
    """
    for robot in station.robots.values():
        if robot.feet is not None:
            context = station.plant.CreateDefaultContext()
            root = xyz_quaternion_from_transform(robot.root.CalcPoseInWorld(context))
            return float(headings(station, robot, root[np.newaxis])[0]) + _ASIDE
    return _ASIDE


def robots_to_follow(robots: Iterable[str], controllers: Mapping[str, ControllerSection]) -> set[str]:
    """Names of the robots whose controllers ask that the camera goes with them (`camera_follows`).

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
    """Return up to when a run is to be in the picture [s]."""
    share = _TRUSTED if result.stopped_by == DIVERGED else 1.0
    return result.start_time + share * result.simulated_time


def frame_times(end: float, frames_per_second: float, *, begin: float = 0.0) -> Vector:
    """Return the times of a motion's frames from ``begin`` to ``end`` [s]; raises InvalidParameter: a wrong rate."""
    if not (np.isfinite(frames_per_second) and frames_per_second > 0):
        raise InvalidParameter(
            "frames_per_second", frames_per_second, message("results.positive_rate", "a positive rate [1/s]")
        )
    count = max(int(np.ceil((end - begin) * frames_per_second - 1e-9)), 0)
    return np.append(begin + np.arange(count) / frames_per_second, end)


def walked_way(result: RecordedRun) -> Way | None:
    """Return how far a camera beside a walking robot goes: the robot's way over the floor, without the sway of steps.

    A robot whose controller asks for it is followed as well. None where the camera stands still: with no such robot,
    with several, or for a way that is short for its size.
    """
    followed = _followed_robot(result)
    if followed is None:
        return None
    base = result.pose("base", followed)
    begin = result.start_time
    end = framed_time(result)
    times = np.linspace(begin, end, max(round((end - begin) / _EVERY), 1) + 1)
    places = [np.interp(times, result.times, column) for column in base[:, :2].T]
    ground = result.plant.ground
    height = base[0, 2] - ground.beneath(base[:1, :3])[0]
    if np.hypot(*(column - column[0] for column in places)).max() < _WALK * height:
        return None
    smooth = [np.convolve(np.pad(column - column[0], _HALF, mode="edge"), _MEAN, "valid") for column in places]

    def way(at: Vector) -> Vector:
        gone = np.column_stack([*(np.interp(at, times, column) for column in smooth), np.zeros(len(at))])
        return np.asarray(gone + np.outer(ground.floor_heights(gone), [0.0, 0.0, 1.0]))

    return way


def base_distances(result: RecordedRun, times: Vector) -> Vector:
    """Horizontal distance of the followed robot's base from its start, at times (k,) [s] of a run, shape (k,) [m].

    At the end of the run it is the distance that the run's text and summary give, sway and a fall included.
    """
    base = result.pose("base", _followed_robot(result))
    distances = np.hypot(*(base[:, :2] - base[0, :2]).T)
    return np.interp(times, result.times, distances)


def _followed_robot(result: RecordedRun) -> str | None:
    """Name of the robot that a camera may follow. Returns None if there is no such robot, or there are several."""
    followed = {*legged_robots(result), *robots_to_follow(result.plant.robots, result.config.controllers)}
    return followed.pop() if len(result.plant.robots) == 1 and followed else None


def camera_on(points: Vector, *, aspect: float, azimuth: float = _ASIDE) -> Camera:
    """Return the nearest camera at ``azimuth`` from x [rad] with all points (m, 3) [m] in a picture of an aspect."""
    axes = _camera_axes(azimuth)
    across, along = (points @ axes.T)[:, :2], points @ axes[2]
    half = np.tan(FIELD_OF_VIEW / 2) / _MARGIN * np.array([aspect, 1.0])
    # An edge of the picture is a plane through the eye; these are the planes that just touch the points.
    low = (across + half * along[:, np.newaxis]).min(axis=0)
    high = (across - half * along[:, np.newaxis]).max(axis=0)
    depth = min(((low - high) / (2 * half)).min(), along.min() - _NEAREST)
    eye = np.append((low + high) / 2, depth)
    target = np.append(eye[:2], (along.min() + along.max()) / 2)
    return Camera(eye @ axes, target @ axes)


def aspect_of(points: Vector, *, azimuth: float = _ASIDE) -> float:
    """Return the width over the height of points as a camera sees them; 1 where all are one point."""
    width, height = np.ptp((points @ _camera_axes(azimuth).T)[:, :2], axis=0)
    return float(width / height) if height > 0 else 1.0


def _camera_axes(azimuth: float) -> Vector:
    """Return right, up and forward of a camera as rows, shape (3, 3)."""
    level, rise = np.cos(_ELEVATION), np.sin(_ELEVATION)
    forward = -np.array([level * np.cos(azimuth), level * np.sin(azimuth), rise])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    return np.array([right, np.cross(right, forward), forward])
