"""What a station measures: the kinds of sensor that a station file can name."""

from typing import TYPE_CHECKING, Annotated, Any

from simrob_drake.parts.kinds import Kinds

KINDS = Kinds(
    __name__,
    {
        "force": "force.Force",
        "distance": "distance.Distance",
        "joint_torque": "joint_torque.JointTorque",
        "external_torque": "external_torque.ExternalTorque",
        "imu": "imu.Imu",
        "encoders": "encoders.Encoders",
        "frame": "frame.FrameSensor",
        "leg_odometry": "leg_odometry.LegOdometry",
        "camera": "camera.CameraSensor",
    },
)
if TYPE_CHECKING:
    from simrob_drake.parts.sensors.camera import CameraSensor
    from simrob_drake.parts.sensors.distance import Distance
    from simrob_drake.parts.sensors.encoders import Encoders
    from simrob_drake.parts.sensors.external_torque import ExternalTorque
    from simrob_drake.parts.sensors.force import Force
    from simrob_drake.parts.sensors.frame import FrameSensor
    from simrob_drake.parts.sensors.imu import Imu
    from simrob_drake.parts.sensors.joint_torque import JointTorque
    from simrob_drake.parts.sensors.leg_odometry import LegOdometry

    SensorConfig = (
        Force | Distance | JointTorque | ExternalTorque | Imu | Encoders | FrameSensor | LegOdometry | CameraSensor
    )
else:
    SensorConfig = Annotated[Any, KINDS]

Sensors = Annotated[dict[str, SensorConfig], KINDS.names_are_kinds]
