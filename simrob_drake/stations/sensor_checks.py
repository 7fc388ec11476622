"""Whether the sensors and monitors of a configuration name things that the station has."""

from __future__ import annotations

from simrob_drake.errors import InvalidParameter, UnknownName
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.force_limits import force_limit
from simrob_drake.stations.monitor_config import Contact, ForceLimit
from simrob_drake.stations.sensor_config import Distance, Force, JointTorque
from simrob_drake.stations.targets import check_body, frame_names


def check_sensors(config: StationConfig) -> None:
    """Check every sensor of a station.

    Raises:
        SimrobError: a body, frame or robot that does not exist, with the nearest name, or a sensor that cannot work
            with the station's mode, contacts or solver.
    """
    for name, sensor in config.sensors.items():
        key = f"sensors.{name}"
        match sensor:
            case Force() | Distance():
                for part, target in (("body", sensor.body), ("other", sensor.other)):
                    if target is not None:
                        check_body(config, f"{key}.{part}", target)
                _check_contact(config, key, sensor)
            case JointTorque() if config.solver.scheme == "cenic" and config.mode == "dynamic":
                expected = "left out under cenic, whose reaction forces are not the joints'; read the output torque"
                raise InvalidParameter(key, "a joint_torque sensor", expected)
            case _:
                pass
        robot = getattr(sensor, "robot", None)
        if robot is not None and robot not in config.robots:
            raise UnknownName(f"robot for {key}", robot, config.robots)
        if robot is None and not isinstance(sensor, Force | Distance) and config.only_robot is None:
            raise InvalidParameter(f"{key}.robot", None, f"one of {', '.join(config.robots) or 'the robots'}")


def _check_contact(config: StationConfig, key: str, sensor: Force | Distance) -> None:
    if isinstance(sensor, Force):
        if config.mode == "kinematic":
            expected = "in a dynamic station: a kinematic one computes no contacts (a distance sensor works there)"
            raise InvalidParameter(key, "a force sensor in a kinematic station", expected)
        if sensor.frame not in frame_names(config):
            raise UnknownName(f"frame for {key}.frame", sensor.frame, frame_names(config))
    if config.contact is None and config.mode == "dynamic":
        expected = "in a station with a contact: section ({} takes its defaults)"
        raise InvalidParameter(key, f"a {sensor.kind} sensor", expected)


def check_monitors(config: StationConfig) -> None:
    """Check that every monitor of a sensor, a piece or a body region names one that there is.

    Raises:
        SimrobError: the first that does not, with the nearest name.
    """
    for name, monitor in config.monitors.items():
        if isinstance(monitor, Contact | ForceLimit):
            watched_sensor(config, name, monitor)
        if isinstance(monitor, ForceLimit):
            force_limit(monitor.limit)
        piece = getattr(monitor, "piece", None)
        if piece is not None and piece not in config.free_pieces:
            raise UnknownName(f"free piece for monitors.{name}.piece", piece, config.free_pieces)


def watched_sensor(config: StationConfig, name: str, monitor: Contact | ForceLimit) -> str:
    """Return the name of the sensor that a monitor watches.

    Raises:
        UnknownName: no such sensor of the right kind.
        InvalidParameter: several, and the monitor names none.
    """
    kind = "distance" if isinstance(monitor, Contact) else "force"
    known = [sensor for sensor, entry in config.sensors.items() if entry.kind == kind]
    if monitor.sensor is not None and monitor.sensor not in known:
        raise UnknownName(f"{kind} sensor for monitors.{name}.sensor", monitor.sensor, known)
    if monitor.sensor is None and len(known) != 1:
        listed = f"one of {', '.join(known)}" if known else f"a {kind} sensor, and the station has none under sensors:"
        raise InvalidParameter(f"monitors.{name}.sensor", None, listed)
    return monitor.sensor or known[0]
