"""Settings of a station that its solver or its contact model ignores, so that a run is not what the file describes."""

from collections.abc import Iterator

from simrob_drake.parts.sensors.sensor import SampledSensor
from simrob_drake.stations.config import JointStops, StationConfig
from simrob_drake.stations.findings import Finding
from simrob_drake.stations.solver_config import ContactConfig, ContactMaterial, DiscreteSolver, FixedSteps

SHORTEST_DELAY = 1e-6
"""Difference of delays that matters [s]."""


def ignored_settings(config: StationConfig) -> list[Finding]:
    """Find the settings of a station that have no effect, each with what has one."""
    if config.mode == "kinematic":
        return []
    findings = [] if config.contact is None else _ignored_contact_settings(config, config.contact)
    if config.joint_stops != JointStops() and config.solver.holds_joint_limits:
        text = f"the solver {config.solver.scheme} stops joints at their limits by itself and ignores joint_stops"
        findings.append(Finding("warning", "joint_stops", f"{text}; take solver.scheme radau3"))
    return findings


def rounded_delays(config: StationConfig) -> list[Finding]:
    """Find delays of buses and sensors that act as another one, since they count in whole samples."""
    delays: list[tuple[str, float, float]] = []
    for name in config.robots:
        bus = config.servo_of(name).bus
        if bus is not None:
            key = "servo.bus.latency" if config.only_robot else f"robots.{name}.servo.bus.latency"
            delays.append((key, bus.latency, bus.rate))
    for name, sensor in config.sensors.items():
        if isinstance(sensor, SampledSensor):
            delays.append((f"sensors.{name}.delay", sensor.delay, sensor.rate))
    findings = []
    for key, delay, rate in delays:
        acting = round(delay * rate) / rate
        if abs(acting - delay) > SHORTEST_DELAY:
            text = (
                f"{1e3 * delay:g} ms acts as {1e3 * acting:g} ms: delays are whole samples, here of {1e3 / rate:g} ms"
            )
            findings.append(Finding("note", key, text))
    return findings


def _ignored_contact_settings(config: StationConfig, contact: ContactConfig) -> list[Finding]:
    """Find the settings of surfaces, of the station and its pieces, that have no effect."""
    materials: dict[str, ContactMaterial] = {"contact": contact}
    for name, piece in config.pieces.items():
        if piece.contact is not None:
            materials[f"pieces.{name}.contact"] = piece.contact
    findings = []
    for key, material in materials.items():
        texts = [*_ignored_by_solver(config, key, material), *_ignored_by_model(contact, key, material)]
        findings += [Finding("warning", key, text) for text in texts]
    return findings


def _ignored_by_solver(config: StationConfig, key: str, material: ContactMaterial) -> Iterator[str]:
    """Yield what a solver of fixed steps ignores in a material, in words."""
    solver = config.solver
    if isinstance(solver, DiscreteSolver) and solver.scheme == "sap" and material.dissipation:
        yield f"the solver scheme sap ignores {key}.dissipation; take solver.scheme lagged or similar"
    friction = material.friction
    if isinstance(solver, FixedSteps) and friction is not None and friction.static != friction.dynamic:
        text = f"the solver {solver.scheme} ignores {key}.friction.static ({friction.static:g}): bodies begin to "
        yield f"{text}slide at the dynamic one, {friction.dynamic:g}; take a continuous solver, such as cenic"


def _ignored_by_model(contact: ContactConfig, key: str, material: ContactMaterial) -> Iterator[str]:
    """Yield what the contact model ignores in a material, in words."""
    if contact.model == "point" and material.hydroelastic_modulus is not None:
        yield f"contact.model point ignores {key}.hydroelastic_modulus; take contact.model hydroelastic"
    if contact.model == "hydroelastic" and material.stiffness is not None:
        yield f"contact.model hydroelastic ignores {key}.stiffness; give hydroelastic_modulus [Pa] instead"
