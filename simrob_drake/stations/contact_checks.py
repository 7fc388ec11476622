"""What can be said of contact before a station runs: surfaces that do not suit, and what lies in what at the start."""

from pydrake.systems.framework import Diagram

from simrob_drake.stations.contact import pairs_without_surface
from simrob_drake.stations.ports import StationPorts
from simrob_drake.stations.steps import Finding

DEEP = 1e-3
"""Things that rest on each other are less deep in each other [m]."""
_PRESSED = 1e-4  # bodies that lie deeper in each other than this at the start are pushed apart [m]


def contact_findings(diagram: Diagram, ports: StationPorts) -> list[Finding]:
    """Look at the surfaces of a station, and at what lies in what at the start."""
    config, plant = ports.config, ports.plant
    if config.contact is None:
        return [Finding("note", "contact", "the station has none: whatever meets passes through each other")]
    dissipates = [config.contact, *(piece.contact for piece in config.pieces.values() if piece.contact is not None)]
    findings = []
    if config.solver.scheme == "sap" and any(material.dissipation for material in dissipates):
        text = "the solver scheme sap does not know contact.dissipation; take lagged or similar"
        findings.append(Finding("warning", "contact", text))
    flat = _flat_pieces(ports) if config.contact.model == "point" and config.solver.scheme != "mujoco" else []
    if len(flat) > 1 and {*flat} & {*plant.free_pieces}:
        text = f"{' and '.join(flat[:2])} meet in one point: a piece that rests on another sinks and slides"
        findings.append(Finding("warning", "contact", f"{text}; take contact.model hydroelastic"))
    context = diagram.CreateDefaultContext()
    query = plant.scene_graph.get_query_output_port().Eval(plant.scene_graph.GetMyContextFromRoot(context))
    inspector = query.inspector()
    fallen_back = pairs_without_surface(plant.plant, plant.scene_graph.model_inspector())
    if fallen_back and config.contact.model != "point":
        text = f"both are rigid, so {', '.join(fallen_back)} meet in points; make one of them compliant"
        findings.append(Finding("warning", "contact", text))
    pairs = [pair for pair in query.ComputePointPairPenetration() if pair.depth > _PRESSED]
    if not pairs:
        return [*findings, Finding("ok", "contact", "of what can touch nothing penetrates at the start")]
    deepest = max(pairs, key=lambda pair: pair.depth)
    names = " and ".join(inspector.GetName(geometry) for geometry in (deepest.id_A, deepest.id_B))
    text = f"{names} penetrate by {deepest.depth * 1e3:.1f} mm at the start"
    text += "; move one of them" if deepest.depth > DEEP else ""
    return [*findings, Finding("warning" if deepest.depth > DEEP else "ok", "contact", text)]


def _flat_pieces(ports: StationPorts) -> list[str]:
    pieces = ports.station.pieces.items()
    return [name for name, piece in pieces if any(shape.collides and not shape.sphere for shape in piece.model.shapes)]
