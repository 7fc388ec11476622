"""What a station measures: the kinds of sensor that a station file can name."""

from typing import Annotated

from simrob_drake.parts.kinds import Kinds
from simrob_drake.parts.sensors.sensor import Sensor

KINDS = Kinds(
    __name__,
    {
        "force": "shapes.Force",
        "distance": "shapes.Distance",
        "joint_torque": "joints.JointTorque",
        "external_torque": "joints.ExternalTorque",
        "imu": "frames.Imu",
        "encoders": "joints.Encoders",
        "frame": "frames.FrameSensor",
        "leg_odometry": "leg_odometry.LegOdometry",
        "camera": "camera.CameraSensor",
    },
    base=Sensor,
    point="sensors",
)
SensorConfig = Annotated[Sensor, KINDS]
Sensors = Annotated[dict[str, SensorConfig], KINDS.names_are_kinds]
