"""A loop that swings an underactuated robot up and balances it, such as an acrobot or a pole on a cart."""

from collections.abc import Mapping
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from simrob_drake.base.errors import InvalidParameter, Unsuitable
from simrob_drake.base.frames import Flags, Vector
from simrob_drake.base.messages import compound, message
from simrob_drake.base.sections import NotNegative, Number, Positive
from simrob_drake.blocks.sampled import SampledBlock
from simrob_drake.blocks.swing_up import LqrWeights, SwingUp, SwingUpGains, nearest_error
from simrob_drake.parts.controllers.loop import LoopSection
from simrob_drake.parts.resolved import ResolvedRobot, StationContents
from simrob_drake.parts.site import Site
from simrob_drake.parts.station_plant import StationRobot
from simrob_drake.robots.axis_map import NotNegativeAxisValues, PositiveAxisValues


class SwingUpController(LoopSection):
    """Swing a robot with one passive axis up by its energy, then balance it by a linear quadratic regulator.

    It gives the whole torque of the motors, so the gains of the servos are 0. The regulator's gain follows from the
    robot's equations of motion, linearised about the posture, so it suits other masses and lengths, too.
    """

    needs: ClassVar[tuple[Literal["feedforward"], ...]] = ("feedforward",)
    label: ClassVar[str] = message("parts.loop_swing_up", "swing up")
    stages: ClassVar[tuple[str, ...]] = (
        message("parts.stage_energy", "Energy"),
        message("parts.stage_swing_up", "Swing-up\nby acceleration"),
        message("parts.stage_lqr", "Balance\nby LQR"),
    )
    remarks: ClassVar[Mapping[str, str]] = {
        "balancing": message("parts.balances_robot", "balances the robot")
    }

    kind: Literal["swing_up"]
    rate: Positive = 200.0
    """Samples a second [Hz]."""
    posture_deg: dict[str, Number] = Field(min_length=1)
    """Posture in which the robot is balanced, by axis [deg, or m where it slides]; 0 of axes that are not named."""
    energy_of: Literal["robot", "passive_axis"] = "robot"
    """Energy that the swing-up brings to its value in the posture: `robot`, that of the whole robot, as for an acrobot;
    `passive_axis`, that of the passive axis as seen from the others, as for a pole on a cart, whose own motion does not
    count."""
    energy_gain: NotNegative = 1.0
    """Acceleration of the driven axes by the swing-up, for an energy error of 1 J."""
    position_gain: NotNegative = 1.0
    """Acceleration back to the posture, for each unit of distance from it [1/s²]."""
    velocity_gain: NotNegative = 1.0
    """Deceleration, for each unit of speed [1/s]."""
    position_weight: NotNegativeAxisValues = 10.0
    """Weight of the squared position errors in the regulator's cost [1/rad² or 1/m²]. Axes that a mapping leaves out
    have 1."""
    velocity_weight: NotNegativeAxisValues = 1.0
    """Weight of the squared velocities [s²/rad² or s²/m²]."""
    torque_weight: PositiveAxisValues = 1.0
    """Weight of the squared torques [1/(N·m)² or 1/N²]."""
    catch: Positive = 1.0
    """Cost below which the regulator takes over, as a part of the cost up to which no motor reaches its limit, by the
    linear model."""

    def check(self, key: str, station: StationContents) -> None:
        """Check that the robot suits the law of the swing-up, in addition to what every loop checks.

        Args:
            key: key of the section, for errors.
            station: contents of the station.

        Raises:
            SimrobError: the robot floats, does not have exactly one passive axis and at least one motor, has axes that
                follow others or servos with gains, or the posture is beyond its limits; or by the checks of every loop
                the robot does not exist, the station has no servos, or the rate is too high.
        """
        super().check(key, station)
        robot = station.robot(self.robot, key)
        # The law of the swing-up is that of one passive axis: the motors accelerate the others, and so move it.
        is_usable = not robot.floats and len(robot.axes) > 1 and int(robot.gains.passive.sum()) == 1
        if not is_usable:
            raise Unsuitable(
                key,
                message(
                    "parts.not_underactuated",
                    "{robot} does not have a fixed base, exactly one passive axis and a motor",
                    robot=robot.name,
                ),
                message("parts.robot_with_one_passive_axis", "name a robot that has all three"),
            )
        # The linear model of the regulator has no constraints between axes.
        if robot.model.followers:
            raise Unsuitable(
                key,
                message(
                    "parts.robot_with_followers",
                    "some axes of {robot} follow others (mimic)",
                    robot=robot.name,
                ),
                message("parts.robot_without_followers", "name a robot without such axes"),
            )
        # Limits are checked for a list of postures; here it has one.
        violation = robot.model.limits.find_violation(self._posture(robot)[np.newaxis])
        if violation is not None:
            raise InvalidParameter(
                f"{key}.posture_deg",
                compound("{value} {unit}", value=violation.value, unit=violation.unit),
                message("parts.within", "within {limits}", limits=violation.limits),
            )
        # A servo with gains would add its own torque to the one of the loop.
        for name in ("kp", "ki", "kd"):
            gains = getattr(robot.gains, name)
            if gains.any():
                raise InvalidParameter(
                    f"servo.{name}",
                    f"{gains.max():g}",
                    message(
                        "parts.gains_beside_swing_up",
                        "0, since {key} computes the whole torque",
                        key=key,
                    ),
                )

    def distances_at_end(self, robot: ResolvedRobot, positions: Vector) -> Vector:
        """Distances of the axes from the posture at the end of a run, for axes that turn to the nearest whole turn.

        Args:
            robot: robot of the loop.
            positions: positions of its axes at the end, shape (n,) [rad or m].

        Returns:
            Distances, not negative, shape (n,) [rad or m].
        """
        # A pole that is balanced after two turns is as good as one that has not turned.
        return np.abs(nearest_error(positions - self._posture(robot), _turns(robot)))

    def _posture(self, robot: ResolvedRobot) -> Vector:
        """Posture of all axes, shape (n,) [rad or m]. It is 0 for axes that the section does not name."""
        model = robot.model
        return model.user_units * model.axis_vector(dict(self.posture_deg), "posture_deg")

    def _block(self, key: str, robot: StationRobot, site: Site) -> SampledBlock:
        """Create the loop's block for its robot in the station under construction, the site. The key is for errors."""

        def weight(name: str) -> Vector:
            """Weights of all axes, shape (n,), from the key of this name; 1 for axes that a mapping leaves out."""
            return robot.model.axis_vector(getattr(self, name), f"{key}.{name}", 1.0)

        return SwingUp(
            key=f"{key}.posture_deg",
            plant=site.plant.plant,
            axes=robot.axis_map,
            torque_limit=robot.gains.torque_limit,
            turns=_turns(robot),
            upright=self._posture(robot),
            weights=LqrWeights(
                position=weight("position_weight"),
                velocity=weight("velocity_weight"),
                torque=weight("torque_weight"),
            ),
            gains=SwingUpGains(
                energy=self.energy_gain,
                position=self.position_gain,
                velocity=self.velocity_gain,
                of_passive_axis=self.energy_of == "passive_axis",
            ),
            catch=self.catch,
            period=1 / self.rate,
        )


def _turns(robot: ResolvedRobot) -> Flags:
    """Whether each axis turns, and does not slide, shape (n,)."""
    return ~np.asarray(robot.model.prismatic)
