r"""Estimate of a robot's base from an IMU at its root link, the encoders of its joints and its feet on the ground.

A complementary filter of the base's position p and velocity v in the world's axes, after Bloesch et al., "State
estimation for legged robots" (RSS 2012). The accelerometer's specific force f predicts, over a period T, with the
orientation R̄ midway between two samples,

.. math:: a_k = \bar R (f_k - b_{k-1}) + g, \quad p^-_k = p_{k-1} + T v_{k-1} + \tfrac12 T^2 a_k, \quad
    v^-_k = v_{k-1} + T a_k .

The points of the feet that touch the ground do not move. If such a point i was at :math:`r_{k-1}` from the base and is
now at :math:`r_k`, the base has moved by :math:`r_{k-1} - r_k`, which differs from the prediction by :math:`e_i`. The
weight :math:`w_i` of a point depends on two things. First, how low the point was, now and at the sample before: its
share c is e times smaller for each 3 mm above the lowest point (with force sensors, above the lowest point of its foot,
and times the part of ``force`` that acts on the foot). Second, how still the point is, compared with a speed s:

.. math:: w_i = \frac{c_{i,k}\, c_{i,k-1}}{1 + |e_i|^2 / (s T)^2}, \quad
    e = \min\left(1, \sum w_i\right) \frac{\sum w_i e_i}{\sum w_i}, \quad
    p_k = p^-_k + e, \quad v_k = v^-_k + K e, \quad b_k = b_{k-1} - \frac{K}{\tau_b} \bar R^\top e

with :math:`K = (1 - e^{-T/\tau})/T`. So a foot that slips, swings or lands counts little, and the accelerometer's bias
b is learnt with the time constant :math:`\tau_b` = 1 s. A foot that is a ball rolls: its point is the one that was
lowest at the sample before. On level ground, the height approaches the one at which the lowest points are at z = 0,
with a time constant of 1 s.

The orientation is that of the IMU, which is the true one, so the yaw does not drift. It would if the angular velocities
of a gyroscope were integrated.
"""

import math
import weakref
from collections.abc import Mapping
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from pydantic import Field
from pydrake.systems.framework import DiagramBuilder

from simrob_drake.base.errors import InvalidParameter, Unsuitable, one_of
from simrob_drake.base.frames import Vector, rotation_of, xyz_quaternion_from_transform
from simrob_drake.base.messages import compound, message
from simrob_drake.base.sections import Boolean, Positive
from simrob_drake.base.signals import POSE, QUANTITY_WORDS, VELOCITY, Panel, Signal
from simrob_drake.blocks.sampled import Changes, Named, SampledBlock
from simrob_drake.parts.resolved import ResolvedRobot, StationContents, name_or_only
from simrob_drake.parts.sensors.sensor import SampledSensor, axis_names
from simrob_drake.parts.site import Site
from simrob_drake.parts.soles import shares_by_height
from simrob_drake.parts.station_plant import StationRobot

# Time constant with which the accelerometer's bias is learnt [s].
_BIAS_TIME = 1.0
# Time constant with which the height approaches level ground [s].
_LEVEL_TIME = 1.0
# Inputs of the estimator, and the purpose (key of `reads`) of the sensor that gives each.
_READS = {
    "position": "encoders",
    "orientation": "imu",
    "angular_velocity": "imu",
    "specific_force": "imu",
}
# Columns, their units, and the plotted quantity of the outputs.
_PARTS = {"base_pose": POSE, "base_velocity": VELOCITY}


class LegOdometry(SampledSensor):
    """Pose and velocity of a robot's base, estimated from an IMU at its root link and encoders: `base_pose.<sensor>`.

    The estimate begins at the base's pose in the station file, at rest. It is as late as the samples of its sensors,
    and one sample more.
    """

    kind: Literal["leg_odometry"]
    robot: str | None = None
    """Robot whose base is estimated; the only robot if it is left out."""
    reads: dict[str, str] = Field(default_factory=dict)
    """Sensors that it reads: `imu` and `encoders` (the only ones of these kinds if they are left out), and optionally
    force sensors of all feet, by the feet's links: `{imu: chest, left_foot: left, right_foot: right}`."""
    force: Positive | None = None
    """Force from which a foot counts in full [N]; if left out, the robot's weight over the count of its feet."""
    slip: Positive = 0.07
    """Speed over the ground at which a point of the feet counts half as much as at rest [m/s]."""
    velocity_time: Positive = 0.1
    """Time constant τ with which the velocity follows the feet [s]."""
    level: Boolean | None = None
    """Whether the ground is level, at z = 0, which keeps the height from drifting; left out, whether the floor is."""

    def read(self, sensors: Mapping[str, Any]) -> dict[str, str]:
        """Find the sensors that it reads: those that the section names, and the only IMU and encoders of the station.

        Args:
            sensors: sections of the station's sensors, by name.

        Returns:
            The names of the sensors by their purpose: `imu`, `encoders` and the links of those feet for which the
            section names a force sensor. If it names no IMU or encoders, this purpose is missing unless the station has
            exactly one sensor of the kind.
        """
        found = dict[str, str]()
        for kind in ("imu", "encoders"):
            names = _names_of_kind(sensors, kind)
            if len(names) == 1:
                found[kind] = names[0]
        return found | self.reads

    def check(self, key: str, station: StationContents) -> None:
        """Check that the robot stands on feet of its own, and that the sensors exist and fit.

        Args:
            key: key of the sensor in the station.
            station: contents of the station.

        Raises:
            SimrobError: the robot does not exist or does not stand on feet of its own; ``reads`` has another key than
                ``imu``, ``encoders`` and links of feet; a sensor does not exist, is of another kind, or is not named
                though it is not the only one of its kind; the IMU is not at the root link; the encoders are those of
                another robot; one of both samples at another rate; or only some feet have a force sensor.
        """
        robot = station.robot(self.robot, key)
        if not robot.floats or robot.feet is None:
            raise Unsuitable(
                key,
                message(
                    "parts.not_on_own_feet",
                    "{robot} has no feet, or its base is fixed",
                    robot=robot.name,
                ),
                message("parts.robot_on_own_feet", "name a robot that stands on its own feet"),
            )
        kind_of_purpose = {
            "imu": "imu",
            "encoders": "encoders",
            **dict.fromkeys(robot.feet.links, "force"),
        }
        # The dictionary has each purpose once: IMU and encoders are checked also if the section does not name them.
        for purpose in dict.fromkeys(["imu", "encoders", *self.reads]):
            one_of(
                message("parts.input_for", "input for {key}.reads", key=key),
                purpose,
                kind_of_purpose,
            )
            kind = kind_of_purpose[purpose]
            where = f"{key}.reads.{purpose}"
            name_or_only(
                self.reads.get(purpose),
                _names_of_kind(station.sensors, kind),
                kind=message(
                    "parts.sensor_of_kind",
                    "sensor of kind {kind} for {where}",
                    kind=kind,
                    where=where,
                ),
                key=where,
            )
        # If the force on one foot is measured, the shares of all feet depend on their forces, see `_shares`.
        feet = [foot for foot in robot.feet.links if foot in self.reads]
        if feet and len(feet) < len(robot.feet.links):
            raise Unsuitable(
                f"{key}.reads",
                message(
                    "parts.with_feet",
                    "it names force sensors for {feet} only",
                    feet=", ".join(feet),
                ),
                message("parts.all_feet_or_none", "name force sensors for all feet, or for none"),
            )
        self._check_sensors(key, station, robot)

    def _check_sensors(self, key: str, station: StationContents, robot: ResolvedRobot) -> None:
        """Check that IMU and encoders are at the robot, and sample as often as the estimator.

        Args:
            key: key of the sensor in the station.
            station: contents of the station.
            robot: the robot.

        Raises:
            InvalidParameter: the IMU is not at the root link, the encoders are those of another robot, or a rate
                differs.
        """
        read = self.read(station.sensors)
        root = f"{robot.prefix}{robot.model.root}"
        imu = station.sensors[read["imu"]]
        encoders = station.sensors[read["encoders"]]
        # The equations need the accelerations of the base's own origin. An IMU without a frame is at the root link.
        if imu.frame not in (None, root):
            raise InvalidParameter(
                f"sensors.{read['imu']}.frame",
                imu.frame,
                message("parts.root_for", "{root} for {key}, or left out", root=root, key=key),
            )
        if station.robot(encoders.robot, key) is not robot:
            raise InvalidParameter(
                f"sensors.{read['encoders']}.robot",
                encoders.robot,
                message("parts.of_robot_for", "{robot} for {key}", robot=robot.name, key=key),
            )
        for kind, sensor in (("imu", imu), ("encoders", encoders)):
            if sensor.rate != self.rate:
                expected = message(
                    "parts.rate_of_sensor",
                    "{rate:g} Hz, the rate of sensors.{read}, whose samples must each count once",
                    rate=sensor.rate,
                    read=read[kind],
                )
                raise InvalidParameter(
                    f"{key}.rate", compound("{rate:g} Hz", rate=self.rate), expected
                )

    def wire(self, builder: DiagramBuilder, site: Site, name: str) -> None:
        """Add ``base_pose.<sensor>`` (7: x y z [m] qw qx qy qz) and ``base_velocity.<sensor>`` (6) [m/s, rad/s].

        The velocity is the linear one of the root link, then the angular one, in the world's axes.

        Args:
            builder: builder of the diagram.
            site: the station under construction.
            name: name of the sensor.
        """
        robot = site.robot(self.robot)
        read = self.read(site.station.sensors)
        soles = Soles(robot)
        force = None
        # Without force sensors, only the heights of the points say which feet stand.
        if any(foot in read for foot in soles.feet):
            weight = robot.plant.CalcTotalMass(soles.scratch, [robot.instance]) * float(
                np.linalg.norm(soles.gravity)
            )
            force = self.force or weight / len(soles.feet)
        block = BaseEstimator(
            self,
            soles,
            start=xyz_quaternion_from_transform(robot.base),
            force=force,
            level=not site.station.ground.incline if self.level is None else self.level,
        )
        signals = {}
        heading = message("parts.leg_odometry_of", "leg odometry '{name}'", name=name)
        for output, (components, units, quantity) in _PARTS.items():
            columns = axis_names(output, name, components)
            panel = Panel(
                f"odometry_{name}", heading, QUANTITY_WORDS[output], quantity, columns[:3]
            )
            signals[output] = Signal(columns, units, "estimate", part=name, panel=panel)

        # Outputs of the sensors that it reads, by the names of the block's input ports.
        source_names = {port: f"{port}.{read[purpose]}" for port, purpose in _READS.items()}
        source_names |= {foot: f"force.{read[foot]}" for foot in soles.feet if foot in read}
        # A sensor in a loop has a port; the outputs of others are computed after the run, like this sensor then.
        sources = {**site.outputs.after_run, **site.outputs}
        inputs = {port: sources[output] for port, output in source_names.items()}
        self._add_block(
            builder,
            site,
            name,
            block=block,
            title=message("parts.block_leg_odometry", "Leg odometry"),
            inputs=inputs,
            signals=signals,
            robot=robot,
        )


def _names_of_kind(sensors: Mapping[str, Any], kind: str) -> list[str]:
    """Names of the sensors of a kind, in the order of the station."""
    return [name for name, sensor in sensors.items() if sensor.kind == kind]


class Soles:
    """The k points of a robot's feet that touch the ground, and their positions for postures of the robot.

    A point is the corner of a sole, or the middle of a ball foot.

    Attributes:
        scratch: a context of the plant, as work space.
        gravity: gravity g in the world, shape (3,) [m/s²].
        size: count n of the robot's axes.
        feet: slice of the points of each foot among all points, by the foot's link.
        radius: radius of the ball feet [m]; 0 for corners.
        arms: positions of the points in the frames of their links, with a 1 as fourth entry, shape (k, 4) [m].
    """

    def __init__(self, robot: StationRobot) -> None:
        """Collect the points of a robot's feet. Its plant is only used to compute postures."""
        assert robot.feet is not None  # the sensor's section has checked it
        plant = robot.plant
        self._plant = weakref.proxy(plant)
        self._axes = robot.axis_map
        self.size = len(robot.axes)
        self.gravity = plant.gravity_field().gravity_vector()
        self.scratch = plant.CreateDefaultContext()
        self._positions = plant.GetPositions(self.scratch)
        self._root = robot.root.index()
        self._links = [
            plant.GetFrameByName(link, robot.instance).index() for link in robot.feet.links
        ]

        has_balls = bool(robot.feet.points)
        self.radius = robot.feet.radius if has_balls else 0.0
        if has_balls:
            points_of_feet = [np.array(robot.feet.points[link]) for link in robot.feet.links]
        else:
            points_of_feet = [robot.feet.support_points(link) for link in robot.feet.links]
        # The points of all feet follow one another: those of foot i are the points ends[i] to ends[i + 1].
        counts = [len(points) for points in points_of_feet]
        ends = np.cumsum([0, *counts]).tolist()
        self.feet = {
            link: slice(begin, end)
            for link, (begin, end) in zip(robot.feet.links, pairwise(ends), strict=True)
        }
        self._foot_of_point = np.repeat(range(len(counts)), counts)
        arms = np.concatenate(points_of_feet)
        self.arms = np.column_stack([arms, np.ones(len(arms))])

    def poses(self, position: Vector, root_rotation: Vector) -> Vector:
        """Compute the pose of each point's link from the root link, in the world's axes.

        Args:
            position: finite positions of the axes, shape (n,) [rad or m].
            root_rotation: rotation of the root link to the world, shape (3, 3).

        Returns:
            The poses as matrices, shape (k, 3, 4). Their product with `arms` gives the points.
        """
        plant = self._plant
        self._positions[self._axes.position_places] = self._axes.signs * position
        plant.SetPositions(self.scratch, self._positions)
        root = plant.get_frame(self._root)
        poses = [
            plant.CalcRelativeTransform(self.scratch, root, plant.get_frame(link))
            for link in self._links
        ]
        link_poses = root_rotation @ np.array([pose.GetAsMatrix34() for pose in poses])
        return np.asarray(link_poses[self._foot_of_point])


class BaseEstimator(SampledBlock):
    """Estimate the pose and the velocity of a base, by the equations of this module.

    A sample with an input that is not finite is skipped: the base continues at its velocity, and the feet count again
    from the second sample after it.

    Ports:
        in  ``position`` (n) [rad or m]; ``orientation`` (4) of the root link, qw qx qy qz; ``angular_velocity`` (3)
        [rad/s] and ``specific_force`` (3) [m/s²] in its axes; if forces are used, the force on each foot (3) [N], by
        the name of its link.
        out ``base_pose`` (7): x y z [m] qw qx qy qz; ``base_velocity`` (6): linear, then angular, in the world's axes
        [m/s, rad/s].
    """

    def __init__(
        self,
        section: LegOdometry,
        soles: Soles,
        *,
        start: Vector,
        force: float | None = None,
        level: bool = False,
    ) -> None:
        """Create the block.

        Args:
            section: section of the sensor.
            soles: points of the feet.
            start: pose of the base at the start, shape (7,).
            force: force from which a foot counts in full [N]. If it is None, forces are not used.
            level: whether the ground is the plane z = 0.
        """
        period = 1 / section.rate
        feet = {} if force is None else dict.fromkeys(soles.feet, 3)
        self._reads = {
            "position": soles.size,
            "orientation": 4,
            "angular_velocity": 3,
            "specific_force": 3,
            **feet,
        }
        points = len(soles.arms)
        super().__init__(
            period=period,
            reads=self._reads,
            memory={
                "base_pose": start,
                "base_velocity": np.zeros(6),
                "bias": np.zeros(3),  # of the accelerometer
                # The lowest points of the feet: in their links, with a 1 as fourth entry; ...
                "lowest": np.zeros(4 * points),
                # ... and from the base, in the world's axes.
                "places": np.zeros(3 * points),
                "shares": np.zeros(points),  # c of each point; zero before the first sample
            },
            gives=("base_pose", "base_velocity"),
            delay=section.delay_samples,
        )
        self._soles = soles
        self._force = force
        self._squared_slip = (section.slip * period) ** 2
        self._velocity_gain = (1 - math.exp(-period / section.velocity_time)) / period  # K
        self._bias_gain = self._velocity_gain / _BIAS_TIME
        self.level = level
        self._height_share = 1 - math.exp(-period / _LEVEL_TIME) if level else 0.0

    def sample(self, memory: Named, read: Named) -> Changes:
        """Compute the estimate at this sample.

        Args:
            memory: memory before the sample.
            read: inputs of the block.

        Returns:
            The new values of the memory.
        """
        pose = memory["base_pose"]
        velocity = memory["base_velocity"][:3]
        soles = self._soles
        period = self.period
        measured = {name: read[name] for name in self._reads}
        # A sum is not finite if one of its terms is not. Then the base continues at its velocity. With shares of 0, the
        # feet do not count at the next sample.
        if not math.isfinite(np.concatenate([*measured.values()]).sum()):
            position = pose[:3] + period * velocity
            return {
                "base_pose": np.concatenate([position, pose[3:]]),
                "shares": np.zeros(len(soles.arms)),
            }

        # The sum of two quaternions of the same sign is the rotation midway between them.
        orientation = measured["orientation"]
        last_orientation = pose[3:]
        same_sign = math.copysign(1.0, last_orientation @ orientation)
        middle_rotation = rotation_of(last_orientation + same_sign * orientation).matrix()
        rotation = rotation_of(orientation).matrix()

        # The prediction: the change of the velocity, T a, and the step of the position, T (v + T a / 2).
        bias = memory["bias"]
        velocity_change = period * (
            middle_rotation @ (measured["specific_force"] - bias) + soles.gravity
        )
        step = period * (velocity + velocity_change / 2)
        new_velocity = velocity + velocity_change

        # The lowest points now: in their links, and from the base along the world's axes. That of a ball is a radius
        # below its middle, along the world's z axis, which in the axes of its link is the third row of the rotation.
        poses = soles.poses(measured["position"], rotation)
        lowest = soles.arms.copy()
        lowest[:, :3] -= soles.radius * poses[:, 2, :3]
        places = _transform_points(poses, soles.arms)
        places[:, 2] -= soles.radius
        shares = self._shares(places[:, 2], measured)

        # The errors e_i: the base moves opposite to the points that were lowest at the sample before.
        last_places = memory["places"].reshape(places.shape)
        last_lowest = memory["lowest"].reshape(lowest.shape)
        errors = last_places - _transform_points(poses, last_lowest) - step
        weights = (
            shares * memory["shares"] / (1.0 + (errors * errors).sum(axis=1) / self._squared_slip)
        )
        total = float(weights.sum())
        if total > 0:
            # e = min(1, W) / W sum(w_i e_i) with the sum W of the weights: feet that hardly count correct only a part.
            # The product error @ R is R' error.
            trust = min(total, 1.0)
            error = trust / total * (weights @ errors)
            step = step + error
            new_velocity = new_velocity + self._velocity_gain * error
            bias = bias - self._bias_gain * (error @ middle_rotation)
            # On level ground, the mean height of the points approaches zero.
            mean_height = pose[2] + step[2] + weights @ places[:, 2] / total
            step[2] -= trust * self._height_share * mean_height
        return {
            "base_pose": np.concatenate([pose[:3] + step, orientation]),
            "base_velocity": np.concatenate(
                [new_velocity, rotation @ measured["angular_velocity"]]
            ),
            "bias": bias,
            "lowest": lowest.ravel(),
            "places": places.ravel(),
            "shares": shares,
        }

    def _shares(self, heights: Vector, read: Named) -> Vector:
        """Compute the share c of each point from its height and the force on its foot, shape (k,).

        Args:
            heights: heights of the points, shape (k,) [m].
            read: measured values, with the force on each foot (3) [N] if forces are used.
        """
        if self._force is None:
            return shares_by_height(heights, heights.min())
        # Within each foot by the heights of its points, and among the feet by their forces.
        shares = np.empty(len(heights))
        for foot, own_points in self._soles.feet.items():
            own_heights = heights[own_points]
            force = read[foot]
            load = min(math.sqrt(force @ force) / self._force, 1.0)
            shares[own_points] = load * shares_by_height(own_heights, own_heights.min())
        return shares


def _transform_points(poses: Vector, points: Vector) -> Vector:
    """Transform points (k, 4), with a 1 as fourth entry, by poses (k, 3, 4). The result has the shape (k, 3)."""
    return np.asarray((poses @ points[:, :, np.newaxis])[:, :, 0])
