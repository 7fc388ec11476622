"""Causes by which a run differs from what the station's file describes, found before the run.

``simrob check`` prints these findings, and every result repeats the warnings. They concern what a run cannot show by
itself: settings without an effect, steps too long for a servo, contacts that are not as the shapes suggest. What a run
does show, such as a joint that sags, is judged by its verdict.

A *finding* is a text for the user about one subject; its level is ``warning``, ``note`` or ``ok``. In a *kinematic*
station the robots follow their references exactly, and nothing moves by forces. *Contact points* are small balls at the
corners of flat bodies, which a station can add in point contact.
"""

from collections.abc import Mapping

from simrob_drake.base.errors import list_names
from simrob_drake.base.messages import message
from simrob_drake.blocks.references import Reference
from simrob_drake.parts.controllers import loops_of
from simrob_drake.parts.station_plant import StationPlant
from simrob_drake.robots.urdf import mass_of
from simrob_drake.stations.config import StationConfig
from simrob_drake.stations.contact import pairs_without_surface
from simrob_drake.stations.contact_points import is_flat, uses_contact_points
from simrob_drake.stations.findings import Finding, Level
from simrob_drake.stations.ignored_settings import ignored_settings
from simrob_drake.stations.import_findings import import_findings
from simrob_drake.stations.plausibility import plausibility_findings
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.steps import step_findings

CONTACT = message("stations.contact", "contact")
"""Subject of findings about contact."""


def physics_findings(
    config: StationConfig,
    ports: StationPorts,
    references: Mapping[str, Reference] | None = None,
) -> list[Finding]:
    """Find the causes by which runs of a station differ from what its file describes.

    Args:
        config: configuration of the station.
        ports: the built station, with its plant.
        references: desired trajectories by the name of the robot. Postures along them are examined; for a robot
            without a reference only the initial posture is.

    Raises:
        InvalidParameter: a strict controller refuses its commands.
    """
    findings = _controller_findings(config, ports)
    findings += plausibility_findings(config, ports.station)
    for robot in ports.plant.robots.values():
        findings += import_findings(config, robot)
    if not config.engine.moves_by_forces:
        # In a kinematic station nothing moves by forces: contact, solver and servos have no effect.
        return findings + _weightless_findings(ports)
    findings += ignored_settings(config)
    findings += _grip_findings(config, ports)
    findings += step_findings(config, ports.plant, references)
    findings += _surface_findings(config, ports.plant)
    return findings


def physics_warnings(config: StationConfig, ports: StationPorts) -> list[str]:
    """Texts of the warnings among :func:`physics_findings`, for the result of a run.

    Of the references nothing is examined: all robots are in their initial postures.
    """
    findings = physics_findings(config, ports)
    return [finding.text for finding in findings if finding.level == "warning"]


def _controller_findings(config: StationConfig, ports: StationPorts) -> list[Finding]:
    """Collect the warnings of the station's feedback controllers, such as commands that the robot cannot follow.

    Raises:
        InvalidParameter: a strict controller refuses such a command.
    """
    findings = []
    for name, controller in loops_of(config.controllers).items():
        key = f"controllers.{name}"
        robot = ports.robot(controller.robot)
        findings += [Finding("warning", key, text) for text in controller.warnings(key, robot)]
    return findings


def _weightless_findings(ports: StationPorts) -> list[Finding]:
    """Report links without inertia in a kinematic station, whose weight the computed torques do not include.

    It is a warning for a robot of which other links have a mass: its torques look right, and are too small. If no link
    has a mass, all torques are zero, and this is a note.

    Args:
        ports: the built station.
    """
    findings = []
    for robot in ports.plant.robots.values():
        links = robot.model.links_without_inertia
        if not links:
            continue
        text = message(
            "stations.lacking_weight",
            "forces do not include the weight of links without inertia ({links}); set "
            "{key}.import_options.estimate_inertia to true, or write the inertias in the URDF",
            links=list_names(links),
            key=ports.config.robot_key(robot.name),
        )
        # Forces that are all zero are no trap, forces that are only too small are.
        has_weight = any(mass_of(link) > 0 for link in robot.model.element.iterfind("link"))
        level: Level = "warning" if has_weight else "note"
        subject = message("stations.inertias_of", "inertias of {robot}", robot=robot.name)
        findings.append(Finding(level, subject, text))
    return findings


def _grip_findings(config: StationConfig, ports: StationPorts) -> list[Finding]:
    """Warn, for each gripper, if it does not hold pieces by the friction that the station's file gives.

    The reason is the contact model or the solver, which are the same for all grippers of a station. A robot has a
    gripper if its description names fingers.
    """
    problem = ""
    if config.contact is None:
        problem = message(
            "stations.fingers_without_contact",
            "the station has no contact, so fingers hold nothing; add contact: {{model: hydroelastic}}",
        )
    # A single point on each finger holds a piece against shifting, but not against turning.
    elif config.contact.model == "point" and not uses_contact_points(config):
        problem = message(
            "stations.points_let_creep",
            "with point contact, a held piece turns and slips slowly; use contact.model hydroelastic",
        )
    elif not config.engine.has_realistic_grip:
        problem = message(
            "stations.fingers_hold_too_much",
            "with {engine}, fingers hold several times the load that friction can hold; use solver.scheme lagged",
            engine=config.engine.name,
        )
    if not problem:
        return []
    findings = []
    for robot in ports.plant.robots.values():
        if robot.model.fingers:
            subject = message("stations.gripper_of", "gripper of {robot}", robot=robot.name)
            findings.append(Finding("warning", subject, problem))
    return findings


def _surface_findings(config: StationConfig, plant: StationPlant) -> list[Finding]:
    """Warn if bodies touch at single points although extended surfaces would touch in reality.

    There is at most one finding: about rigid bodies in hydroelastic contact (pressure over surfaces), or about a free
    piece with a flat side in point contact.

    Args:
        config: configuration of the station.
        plant: Drake's plant and scene graph, with the robots and pieces of the station.
    """
    if config.contact is None:
        return []
    inspector = plant.scene_graph.model_inspector()
    if config.contact.model != "point":
        # Hydroelastic contact has no surface between two rigid shapes.
        pairs = pairs_without_surface(plant.plant, inspector)
        if not pairs:
            return []
        text = message(
            "stations.rigid_meet_in_points",
            "{pairs} touch only at points, since both bodies are rigid; make one of them compliant",
            pairs=", ".join(pairs),
        )
        return [Finding("warning", CONTACT, text)]
    # Contact points at the corners carry a flat body, and so do several points of the engine itself.
    if uses_contact_points(config) or config.engine.touches_at_several_points:
        return []
    # One finding suffices: its remedy holds for all pieces.
    for name, body in plant.free_pieces.items():
        shapes = plant.plant.GetCollisionGeometriesForBody(body)
        if any(is_flat(inspector, shape) for shape in shapes):
            text = message(
                "stations.lies_on_jumping_point",
                "{name} has a single contact point, which jumps from corner to corner: the piece trembles, "
                "and sticks where it should slide",
                name=name,
            )
            text = message("stations.set_corners", "{text}; set contact.corners to true", text=text)
            return [Finding("warning", CONTACT, text)]
    return []
