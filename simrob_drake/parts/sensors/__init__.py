"""What a station measures: the kinds of sensor that a station file can name."""

from typing import Annotated

from pydantic import Field

from simrob_drake.parts.kinds import named_by_kind
from simrob_drake.parts.sensors.distance import Distance
from simrob_drake.parts.sensors.encoders import Encoders
from simrob_drake.parts.sensors.external_torque import ExternalTorque
from simrob_drake.parts.sensors.force import Force
from simrob_drake.parts.sensors.frame import FrameSensor
from simrob_drake.parts.sensors.imu import Imu
from simrob_drake.parts.sensors.joint_torque import JointTorque
from simrob_drake.parts.sensors.leg_odometry import LegOdometry

SensorConfig = Annotated[
    Force | Distance | JointTorque | ExternalTorque | Imu | Encoders | FrameSensor | LegOdometry,
    Field(discriminator="kind"),
]
Sensors = Annotated[dict[str, SensorConfig], named_by_kind(SensorConfig)]
