"""What makes a run differ from what its station describes: found by ``simrob check``, and repeated by every result.

Whatever a run can show by itself, such as a joint that sags, is left to its verdict. What is found here it cannot show:
settings without an effect, steps too long for a servo, contacts that are not as the shapes suggest.
"""

from collections.abc import Mapping

from simrob_drake.blocks.references import Reference
from simrob_drake.parts.controllers import loops_of
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.contact import pairs_without_surface
from simrob_drake.stations.contact_points import is_flat, uses_contact_points
from simrob_drake.stations.findings import Finding
from simrob_drake.stations.ignored_settings import ignored_settings
from simrob_drake.stations.import_findings import import_findings
from simrob_drake.stations.plausibility import plausibility_findings
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.steps import step_findings


def physics_findings(
    config: StationConfig, ports: StationPorts, references: Mapping[str, Reference] | None = None
) -> list[Finding]:
    """Find what makes runs of a station differ from what it describes, at the start and along ``references``."""
    findings = _loop_findings(config, ports)
    findings += plausibility_findings(config, ports.station)
    for robot in ports.plant.robots.values():
        findings += import_findings(config, robot)
    if config.mode == "kinematic":
        return findings
    findings += ignored_settings(config)
    findings += _grip_findings(config, ports)
    findings += step_findings(config, ports.plant, references)
    findings += _surface_findings(config, ports)
    return findings


def physics_warnings(config: StationConfig, ports: StationPorts) -> list[str]:
    """Collect the warnings among the findings, in words, for the result of a run."""
    findings = physics_findings(config, ports)
    return [finding.text for finding in findings if finding.level == "warning"]


def _loop_findings(config: StationConfig, ports: StationPorts) -> list[Finding]:
    """Find commands of controllers that are clipped to what the robot can follow."""
    findings = []
    for name, loop in loops_of(config.controllers).items():
        key = f"controllers.{name}"
        warnings = loop.warnings(key, ports.robot(loop.robot))
        findings += [Finding("warning", key, text) for text in warnings]
    return findings


def _grip_findings(config: StationConfig, ports: StationPorts) -> list[Finding]:
    """Find grippers that cannot hold a piece as their friction says."""
    wrong = ""
    if config.contact is None:
        wrong = "the station has no contact: fingers hold nothing; add contact: {model: hydroelastic}"
    elif config.contact.model == "point" and not uses_contact_points(config):
        wrong = "points let a held piece turn and creep; take contact.model hydroelastic"
    elif config.solver.scheme == "sap":
        wrong = "sap lets fingers hold several times what friction holds; take solver.scheme lagged"
    if not wrong:
        return []
    grippers = [robot for robot in ports.plant.robots.values() if robot.model.fingers]
    return [Finding("warning", f"gripper of {robot.name}", wrong) for robot in grippers]


def _surface_findings(config: StationConfig, ports: StationPorts) -> list[Finding]:
    """Find bodies that meet at single points where surfaces would carry them."""
    if config.contact is None:
        return []
    plant = ports.plant
    inspector = plant.scene_graph.model_inspector()
    if config.contact.model != "point":
        pairs = pairs_without_surface(plant.plant, inspector)
        if not pairs:
            return []
        text = f"both are rigid, so {', '.join(pairs)} meet in points; make one of them compliant"
        return [Finding("warning", "contact", text)]
    if uses_contact_points(config) or config.solver.scheme == "mujoco":
        return []
    flat = [
        name
        for name, body in plant.free_pieces.items()
        if any(is_flat(inspector, shape) for shape in plant.plant.GetCollisionGeometriesForBody(body))
    ]
    if not flat:
        return []
    text = f"{flat[0]} lies on one point that jumps about: it trembles, and sticks where it should slide"
    return [Finding("warning", "contact", f"{text}; set contact.corners to true")]
