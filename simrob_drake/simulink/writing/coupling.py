"""Closed loops, gears and springs as the couplings of a station."""

from typing import Any

from pydrake.math import RigidTransform

from simrob_drake.simulink.mechanics.bodies import GEARS, ROD, SPRING, RigidPart
from simrob_drake.simulink.model.nodes import Node
from simrob_drake.simulink.simulink_model import SimulinkModel
from simrob_drake.simulink.writing.touching import StationFiles
from simrob_drake.simulink.writing.urdf import UniqueNames, pose_list


def coupling_sections(
    model: SimulinkModel, files: StationFiles, turn: RigidTransform, names: UniqueNames, *, kinematic: bool
) -> dict[str, Any]:
    """Return the section ``couplings`` of a station; what it cannot have is told as lost."""
    writer = _Writer(model, files, turn, names, kinematic)
    for name, robot in files.robots.items():
        prefix = f"{name}." if len(files.robots) > 1 else ""
        for closing in robot.tree.closings:
            ends = (closing.base, closing.in_base), (closing.follower, closing.in_follower)
            more = {"length": closing.length} if closing.kind == "rod" else {}
            writer.between(closing.node, closing.kind, *ends, more)
        for node, ratios in robot.tree.gears.items():
            held = {f"{prefix}{robot.axes[freedom]}": ratio for freedom, ratio in ratios.items()}
            writer.add(node, {"kind": "gear", "ratios": held})
    for coupling in model.bodies.couplings:
        node, ends = coupling.node, ((coupling.base, coupling.in_base), (coupling.follower, coupling.in_follower))
        if node.kind == SPRING:
            values = {
                "length": node.number("NaturalLength", unit="m"),
                "stiffness": node.number("SpringStiffness", unit="N/m"),
                "damping": node.number("DampingCoefficient", unit="N*s/m"),
            }
            writer.between(node, "spring", *ends, values)
        elif node.kind in (*GEARS, ROD) and not any(coupling in tree.couplings for tree in model.trees):
            writer.lose(node, "couples mechanisms of which one is held by nothing")
    return {"couplings": writer.sections} if writer.sections else {}


class _Writer:
    def __init__(
        self, model: SimulinkModel, files: StationFiles, turn: RigidTransform, names: UniqueNames, kinematic: bool
    ) -> None:
        self._model, self._files, self._turn, self._names, self._kinematic = model, files, turn, names, kinematic
        self.sections: dict[str, Any] = {}

    def lose(self, node: Node, why: str) -> None:
        self._model.report.add("lost", node.path, why)

    def add(self, node: Node, section: dict[str, Any]) -> None:
        if self._kinematic:
            self.lose(node, "holds nothing in a station whose motion is given")
            return
        name = self._names.give(node.path)
        self.sections[name] = section
        self._model.report.add("read", node.path, f"it is the coupling {name}, of kind {section['kind']}")

    def between(
        self, node: Node, kind: str, one: tuple[RigidPart, RigidTransform], other: tuple[RigidPart, RigidTransform],
        values: dict[str, float],
    ) -> None:  # fmt: skip
        """Add a coupling of frames on two bodies, or of their origins."""
        base, follower = (self._files.named(body, self._turn) for body, _ in (one, other))
        if base is None or follower is None or base[0] == follower[0]:
            self.lose(node, "one of its ends is on nothing that moves here, or both are on one body")
            return
        poses = [pose_list(place[1] @ frame) for place, (_, frame) in ((base, one), (follower, other))]
        what, size = ("pose", 6) if kind in ("weld", "hinge") else ("point", 3)
        ends = {"body": base[0], what: poses[0][:size], "other": follower[0], f"other_{what}": poses[1][:size]}
        self.add(node, {"kind": kind, **ends, **values})
