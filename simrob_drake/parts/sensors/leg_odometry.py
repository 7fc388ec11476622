r"""Where a robot on its feet is and how it moves, as an IMU at its root link and the encoders of its joints tell.

A complementary filter of the base's position p and velocity v, in the world's axes, as of Bloesch et al., State
estimation for legged robots (RSS 2012). The accelerometer predicts, with the orientation R̄ midway between two samples,

.. math:: a_k = \bar R (f_k - b_{k-1}) + g, \quad p^-_k = p_{k-1} + T v_{k-1} + \tfrac12 T^2 a_k, \quad
    v^-_k = v_{k-1} + T a_k .

The points of the feet that touch the ground stand still. A point that was at :math:`r_{k-1}` from the base and is at
:math:`r_k` says that the base has come by :math:`r_{k-1} - r_k`, which is by :math:`e_i` more than was foretold. Each
counts by how low it is, now and a sample ago (:math:`c_i`: e times less for each 3 mm over the lowest; with force
sensors over the lowest of its foot, times the part of ``force`` on that), and by how still, against a speed s:

.. math:: w_i = \frac{c_{i,k}\, c_{i,k-1}}{1 + |e_i|^2 / (s T)^2}, \quad
    e = \min\left(1, \sum w_i\right) \frac{\sum w_i e_i}{\sum w_i}, \quad
    p_k = p^-_k + e, \quad v_k = v^-_k + K e, \quad b_k = b_{k-1} - \frac{K}{\tau_b} \bar R^\top e

with :math:`K = (1 - e^{-T/\tau})/T`: a foot that slips, swings or lands counts little, and the accelerometer's bias b
is learnt with :math:`\tau_b` = 1 s. Balls roll: the point is that which was lowest. On level ground the height is
brought to that at which the lowest points are at z = 0, with a time constant of 1 s.

The orientation is the IMU's, which is the true one: nothing drifts in yaw, as it would if the gyroscope were summed up.
"""

import math
import weakref
from collections.abc import Mapping
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from pydantic import Field
from pydrake.systems.framework import DiagramBuilder

from simrob_drake.base.errors import InvalidParameter, one_of
from simrob_drake.base.frames import Vector, rotation_of, xyz_quaternion_from_transform
from simrob_drake.base.messages import compound, message
from simrob_drake.base.sections import Boolean, Positive
from simrob_drake.base.signals import POSE, QUANTITY_WORDS, VELOCITY, Panel, Signal
from simrob_drake.blocks.sampled import Changes, Named, SampledBlock
from simrob_drake.parts.resolved import ResolvedRobot, Surroundings, named
from simrob_drake.parts.sensors.sensor import SampledSensor, axis_names
from simrob_drake.parts.site import Site
from simrob_drake.parts.soles import shares_by_height
from simrob_drake.parts.station_plant import StationRobot

_BIAS = 1.0  # time constant of the bias of the accelerometer [s]
_LEVELS = 1.0  # time constant of the height over level ground [s]
_READS = {"position": "encoders", "orientation": "imu", "angular_velocity": "imu", "specific_force": "imu"}
_PARTS = {"base_pose": POSE, "base_velocity": VELOCITY}


class LegOdometry(SampledSensor):
    """Pose and velocity of a robot's base, estimated from an IMU at its root link and encoders: `base_pose.<sensor>`.

    It begins where the station's file has the base, at rest. It tells of the moment of its sensors' samples: it is as
    late as they are, and one sample more.
    """

    kind: Literal["leg_odometry"]
    robot: str | None = None
    """Whose base; the only robot's unless given."""
    reads: dict[str, str] = Field(default_factory=dict)
    """The sensors that it reads: `imu` and `encoders`, the only ones of these kinds unless given, and by the links of
    all feet, if given, force sensors: `{imu: chest, left_foot: left, right_foot: right}`."""
    force: Positive | None = None
    """Force from which a foot counts in full [N]; the robot's weight by the number of its feet unless given."""
    slip: Positive = 0.07
    """Speed over the ground at which a point of the feet counts half as much as at rest [m/s]."""
    velocity_time: Positive = 0.1
    """Time constant τ with which the velocity follows the feet [s]."""
    level: Boolean | None = None
    """Whether the ground is level, at z = 0, which keeps the height from drifting; as the floor is unless given."""

    def read(self, sensors: Mapping[str, Any]) -> dict[str, str]:
        """Return the sensors that it reads, by what it reads them for: `imu`, `encoders`, links of feet."""
        of_kind = {kind: _of_kind(sensors, kind) for kind in ("imu", "encoders")}
        return {kind: names[0] for kind, names in of_kind.items() if len(names) == 1} | self.reads

    def check(self, key: str, station: Surroundings) -> None:
        """Check that the robot has feet, and its sensors sample as often; raises SimrobError: what does not fit."""
        robot = station.robot(self.robot, key)
        if not robot.floats or robot.feet is None:
            raise InvalidParameter(
                key,
                message("parts.of_model", "of {model}", model=robot.model.name),
                message("parts.robot_on_own_feet", "of a robot that stands on feet of its own"),
            )
        kinds = {"imu": "imu", "encoders": "encoders", **dict.fromkeys(robot.feet.links, "force")}
        for what in dict.fromkeys(["imu", "encoders", *self.reads]):
            kind, where = (
                kinds[one_of(message("parts.input_for", "input for {key}.reads", key=key), what, kinds)],
                f"{key}.reads.{what}",
            )
            known = _of_kind(station.sensors, kind)
            named(
                self.reads.get(what),
                known,
                kind=message("parts.sensor_of_kind", "sensor of kind {kind} for {where}", kind=kind, where=where),
                key=where,
            )
        feet = [foot for foot in robot.feet.links if foot in self.reads]
        if feet and len(feet) < len(robot.feet.links):
            raise InvalidParameter(
                f"{key}.reads",
                message("parts.with_feet", "with {feet}", feet=", ".join(feet)),
                message("parts.all_feet_or_none", "with all feet, or none"),
            )
        self._check_sensors(key, station, robot)

    def _check_sensors(self, key: str, station: Surroundings, robot: ResolvedRobot) -> None:
        read, root = self.read(station.sensors), f"{robot.prefix}{robot.model.root}"
        imu, encoders = (station.sensors[read[kind]] for kind in ("imu", "encoders"))
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
                    "{rate:g} Hz, that of sensors.{read}: each of its samples counts once",
                    rate=sensor.rate,
                    read=read[kind],
                )
                raise InvalidParameter(f"{key}.rate", compound("{rate:g} Hz", rate=self.rate), expected)

    def wire(self, builder: DiagramBuilder, site: Site, name: str) -> None:
        """Add ``base_pose.<sensor>`` (7: x y z [m] qw qx qy qz) and ``base_velocity.<sensor>`` (6) [m/s, rad/s].

        The velocity is the linear one of the root link, then the angular one, in the world's axes.
        """
        robot, read = site.robot(self.robot), self.read(site.station.sensors)
        soles = Soles(robot)
        weight = robot.plant.CalcTotalMass(soles.scratch, [robot.instance]) * float(np.linalg.norm(soles.gravity))
        outputs = {what: f"{what}.{read[sensor]}" for what, sensor in _READS.items()}
        outputs |= {foot: f"force.{read[foot]}" for foot in soles.feet if foot in read}
        known = {**site.outputs.later, **site.outputs}
        block = BaseEstimator(
            self,
            soles,
            start=xyz_quaternion_from_transform(robot.base),
            force=(self.force or weight / len(soles.feet)) if len(read) > 2 else None,
            level=not site.station.ground.incline if self.level is None else self.level,
        )
        signals = {}
        for output, (columns, units, label) in _PARTS.items():
            names = axis_names(output, name, columns)
            heading = message("parts.leg_odometry_of", "leg odometry '{name}'", name=name)
            panel = Panel(f"odometry_{name}", heading, QUANTITY_WORDS[output], label, names[:3])
            signals[output] = Signal(names, units, "estimate", part=name, panel=panel)
        inputs = {what: known[output] for what, output in outputs.items()}
        self._give(
            builder,
            site,
            name,
            block=block,
            title=message("parts.block_leg_odometry", "Leg odometry"),
            inputs=inputs,
            signals=signals,
            robot=robot,
        )


def _of_kind(sensors: Mapping[str, Any], kind: str) -> list[str]:
    return [name for name, sensor in sensors.items() if sensor.kind == kind]


class Soles:
    """The points of a robot's feet that touch the ground, of the joints' positions alone.

    Attributes:
        scratch: a context of the plant.
        gravity: g, in the world, shape (3,) [m/s²].
        size: how many axes the robot has.
        feet: by the link of each foot the places of its points among all k.
        radius: of the balls that they are the middles of [m]; 0 for corners of a box.
    """

    def __init__(self, robot: StationRobot) -> None:
        assert robot.feet is not None  # the section has checked
        plant, self._axes, self.size = robot.plant, robot.axis_map, len(robot.axes)
        self.gravity = plant.gravity_field().gravity_vector()
        self._plant, self.scratch = weakref.proxy(plant), plant.CreateDefaultContext()
        self._positions, self._root = plant.GetPositions(self.scratch), robot.root.index()
        self._links = [plant.GetFrameByName(link, robot.instance).index() for link in robot.feet.links]
        self.radius = robot.feet.radius if robot.feet.points else 0.0
        points = [
            np.array(robot.feet.points[link]) if robot.feet.points else robot.feet.support_points(link)
            for link in robot.feet.links
        ]
        ends = np.cumsum([0, *map(len, points)])
        self.feet = {link: slice(*part) for link, part in zip(robot.feet.links, pairwise(ends.tolist()), strict=True)}
        self._foot, arms = np.repeat(range(len(points)), np.diff(ends)), np.concatenate(points)
        self.arms = np.column_stack([arms, np.ones(len(arms))])

    def poses(self, position: Vector, turned: Vector) -> Vector:
        """Return the pose of each point's foot, from the root link, in the world's axes, shape (k, 3, 4).

        The axes' position (n,) [rad or m] is finite, ``turned`` the rotation of the root link, shape (3, 3).
        """
        plant, scratch = self._plant, self.scratch
        self._positions[self._axes.position_places] = self._axes.signs * position
        plant.SetPositions(scratch, self._positions)
        root = plant.get_frame(self._root)
        poses = [plant.CalcRelativeTransform(scratch, root, plant.get_frame(link)) for link in self._links]
        return np.asarray((turned @ np.array([pose.GetAsMatrix34() for pose in poses]))[self._foot])


class BaseEstimator(SampledBlock):
    """Estimate where a base is, and how it moves, by the equations of this module.

    A sample that reads something that is not finite is skipped: the base goes on as it did, and the feet count again
    from the second one after it.

    Ports:
        in  ``position`` (n) [rad or m]; ``orientation`` (4): of the root link, qw qx qy qz; ``angular_velocity`` (3)
        [rad/s] and ``specific_force`` (3) [m/s²], in its axes; by each foot's name the force on it (3) [N], if asked.
        out ``base_pose`` (7): x y z [m] qw qx qy qz; ``base_velocity`` (6): linear, then angular, in the world's axes
        [m/s, rad/s].
    """

    def __init__(
        self, section: LegOdometry, soles: Soles, *, start: Vector, force: float | None = None, level: bool = False
    ) -> None:
        """Make the block of a section, for the points that touch the ground, from a pose (7,) on.

        A foot counts in full from ``force`` [N] on, None where no forces are read; ``level``: the ground is the plane z
        = 0.
        """
        period = 1 / section.rate
        feet = {} if force is None else dict.fromkeys(soles.feet, 3)
        self._reads = {"position": soles.size, "orientation": 4, "angular_velocity": 3, "specific_force": 3, **feet}
        points = len(soles.arms)
        super().__init__(
            period=period,
            reads=self._reads,
            memory={
                "base_pose": start,
                "base_velocity": np.zeros(6),
                "bias": np.zeros(3),  # of the accelerometer
                "lowest": np.zeros(4 * points),  # what of each foot's link was lowest; 1 behind
                "places": np.zeros(3 * points),  # where that was, from the base, in the world's axes
                "shares": np.zeros(points),
            },
            gives=("base_pose", "base_velocity"),
            delay=section.late_samples,
        )
        self._soles, self._force, self._slips = soles, force, (section.slip * period) ** 2
        self._follow = (1 - math.exp(-period / section.velocity_time)) / period
        self._learn = self._follow / _BIAS
        self.level, self._settle = level, 1 - math.exp(-period / _LEVELS) if level else 0.0

    def sample(self, memory: Named, read: Named) -> Changes:
        """Return where the base is now."""
        pose, motion, period, soles = memory["base_pose"], memory["base_velocity"], self.period, self._soles
        measured = {name: read[name] for name in self._reads}
        if not math.isfinite(np.concatenate([*measured.values()]).sum()):
            place = pose[:3] + period * motion[:3]
            return {"base_pose": np.concatenate([place, pose[3:]]), "shares": np.zeros(len(soles.arms))}
        turn, before = measured["orientation"], pose[3:]
        middle = rotation_of(before + math.copysign(1.0, before @ turn) * turn).matrix()
        turned = rotation_of(turn).matrix()
        change = period * (middle @ (measured["specific_force"] - memory["bias"]) + soles.gravity)
        step, speed = period * (motion[:3] + change / 2), motion[:3] + change
        poses = soles.poses(measured["position"], turned)
        lowest, places = soles.arms.copy(), (poses @ soles.arms[:, :, np.newaxis])[:, :, 0]
        lowest[:, :3] -= soles.radius * poses[:, 2, :3]
        places[:, 2] -= soles.radius
        shares = self._shares(places[:, 2], measured)
        moved = (poses @ memory["lowest"].reshape(lowest.shape)[:, :, np.newaxis])[:, :, 0]
        errors = memory["places"].reshape(places.shape) - moved - step
        weights = shares * memory["shares"] / (1.0 + (errors * errors).sum(axis=1) / self._slips)
        total, bias = float(weights.sum()), memory["bias"]
        if total > 0:
            trust = min(total, 1.0)
            error = trust / total * (weights @ errors)
            step, speed, bias = step + error, speed + self._follow * error, bias - self._learn * (error @ middle)
            step[2] -= trust * self._settle * (pose[2] + step[2] + weights @ places[:, 2] / total)
        return {
            "base_pose": np.concatenate([pose[:3] + step, turn]),
            "base_velocity": np.concatenate([speed, turned @ measured["angular_velocity"]]),
            "bias": bias,
            "lowest": lowest.ravel(),
            "places": places.ravel(),
            "shares": shares,
        }

    def _shares(self, heights: Vector, read: Named) -> Vector:
        """Return how much each point counts by how low it is, and by the force on its foot, shape (k,)."""
        if self._force is None:
            return shares_by_height(heights, heights.min())
        shares = np.empty(len(heights))
        for foot, part in self._soles.feet.items():
            own, force = heights[part], read[foot]
            shares[part] = min(math.sqrt(force @ force) / self._force, 1.0) * shares_by_height(own, own.min())
        return shares
