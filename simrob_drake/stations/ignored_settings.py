"""Settings of a station that have no effect, or not the effect that the station's file describes.

A solver and a contact model each use only some of the settings of joint stops and surfaces, and ignore the others. The
delays of sensors and buses are rounded to whole samples. Each such setting becomes a finding of ``simrob check``, whose
text says which setting has the desired effect.
"""

from collections.abc import Iterator
from typing import NamedTuple

from simrob_drake.base.messages import message
from simrob_drake.robots.motors import CommandBusConfig
from simrob_drake.stations.config import JointStops, StationConfig
from simrob_drake.stations.findings import Finding
from simrob_drake.stations.solver_config import ContactConfig, ContactMaterial

SHORTEST_DELAY = 1e-6
"""Delays that differ by at most this time count as equal [s]."""


class _DelaySetting(NamedTuple):
    """A delay in the file of a station."""

    key: str  # dotted key of the delay, such as ``sensors.imu.delay``
    delay: float  # [s]
    rate: float  # samples per second of the sensor or the bus [Hz]


def ignored_settings(config: StationConfig) -> list[Finding]:
    """Find the settings of surfaces and joint stops that the station's solver or its contact model ignores.

    Of joint stops, only the station's section ``joint_stops`` is looked at, not those of single robots. A kinematic
    station, in which no forces act, has no such findings.
    """
    if not config.engine.moves_by_forces:
        return []
    findings = list[Finding]()
    if config.contact is not None:
        findings += _ignored_contact_settings(config, config.contact)
    # Stops with the default values are what the station would have anyway, so that ignoring them is no surprise.
    has_own_stops = config.joint_stops != JointStops()
    if has_own_stops and config.engine.holds_joint_limits:
        text = message(
            "stations.ignores_joint_stops",
            "the solver {engine} holds joint limits by itself and ignores joint_stops",
            engine=config.engine.name,
        )
        text = message("stations.take_radau", "{text}; use solver.scheme radau3", text=text)
        findings.append(Finding("warning", "joint_stops", text))
    return findings


def rounded_delays(config: StationConfig) -> list[Finding]:
    """Find the delays of servos' buses and of sensors that are rounded: a delay lasts a whole number of samples."""
    findings = []
    for setting in _delay_settings(config):
        # A delay line holds whole samples: d = round(delay * rate) / rate [s].
        rounded = round(setting.delay * setting.rate) / setting.rate
        if abs(rounded - setting.delay) > SHORTEST_DELAY:
            text = message(
                "stations.delay_is_rounded",
                "the delay of {delay:g} ms becomes {rounded:g} ms: ",
                delay=1e3 * setting.delay,
                rounded=1e3 * rounded,
            )
            text += message(
                "stations.delays_are_samples",
                "delays last whole samples, here of {period:g} ms",
                period=1e3 / setting.rate,
            )
            findings.append(Finding("note", setting.key, text))
    return findings


def _delay_settings(config: StationConfig) -> Iterator[_DelaySetting]:
    """Yield the delay of each bus that a section of servos has, and of each sensor that takes samples."""
    # By key, since several robots may share the section of the station.
    buses = dict[str, CommandBusConfig]()
    for name, robot in config.robots.items():
        section = "servo" if robot.servo is None else f"{config.robot_key(name)}.servo"
        bus = config.servo_of(name).bus
        if bus is not None:
            buses[f"{section}.bus.latency"] = bus
    for key, bus in buses.items():
        yield _DelaySetting(key, bus.latency, bus.rate)
    for name, sensor in config.sensors.items():
        # Sensors of a continuous value have no delay, or no rate.
        delay, rate = getattr(sensor, "delay", None), getattr(sensor, "rate", None)
        if delay is not None and rate is not None:
            yield _DelaySetting(f"sensors.{name}.delay", delay, rate)


def _ignored_contact_settings(config: StationConfig, contact: ContactConfig) -> list[Finding]:
    """Find the settings of surfaces that have no effect: of the station's own surfaces, and of its pieces.

    Args:
        config: configuration of the station.
        contact: its section ``contact``, which holds for all surfaces, but for the values that a piece's own section
            ``contact`` replaces.
    """
    # Materials by the keys of the sections that describe them.
    materials: dict[str, ContactMaterial] = {"contact": contact}
    for name, piece in config.pieces.items():
        if piece.contact is not None:
            materials[f"pieces.{name}.contact"] = piece.contact
    findings = []
    for key, material in materials.items():
        texts = [
            *_ignored_by_solver(config, key, material),
            *_ignored_by_model(contact, key, material),
        ]
        findings += [Finding("warning", key, text) for text in texts]
    return findings


def _ignored_by_solver(
    config: StationConfig,
    key: str,
    material: ContactMaterial,
) -> Iterator[str]:
    """Yield a text for each setting of a surface that the station's solver ignores.

    Args:
        config: configuration of the station.
        key: key of the section in which the surface is described.
        material: the settings of the surface.
    """
    engine = config.engine
    # A dissipation of 0 is what such a solver has anyway.
    if not engine.has_contact_dissipation and material.dissipation:
        yield message(
            "stations.ignores_dissipation",
            "the solver scheme {engine} ignores {key}.dissipation; use solver.scheme lagged or similar",
            engine=engine.name,
            key=key,
        )
    friction = material.friction
    if friction is None:
        return
    # With equal coefficients it does not matter that the static one is ignored.
    if not engine.has_static_friction and friction.static != friction.dynamic:
        text = message(
            "stations.ignores_static_friction",
            "the solver {engine} ignores {key}.friction.static ({static:g}): bodies begin to ",
            engine=engine.name,
            key=key,
            static=friction.static,
        )
        yield message(
            "stations.slide_at_dynamic",
            "{text}slide at friction.dynamic ({dynamic:g}); use a continuous solver, such as cenic",
            text=text,
            dynamic=friction.dynamic,
        )


def _ignored_by_model(
    contact: ContactConfig,
    key: str,
    material: ContactMaterial,
) -> Iterator[str]:
    """Yield a text for each setting of a surface that the station's contact model ignores.

    Args:
        contact: the station's section ``contact``, which names the contact model.
        key: key of the section in which the surface is described.
        material: the settings of the surface.
    """
    if contact.model == "point" and material.hydroelastic_modulus is not None:
        yield message(
            "stations.point_ignores_modulus",
            "contact.model point ignores {key}.hydroelastic_modulus; use contact.model hydroelastic",
            key=key,
        )
    if contact.model == "hydroelastic" and material.stiffness is not None:
        yield message(
            "stations.hydroelastic_ignores_stiffness",
            "contact.model hydroelastic ignores {key}.stiffness; give hydroelastic_modulus [Pa] instead",
            key=key,
        )
