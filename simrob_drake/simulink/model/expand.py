"""Put libraries and referenced subsystems into a model, and give every block the workspace it is evaluated in."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

from simrob_drake.errors import InvalidModel
from simrob_drake.simulink.model.nodes import Findings, Node
from simrob_drake.simulink.reading.elements import DEEPEST, MOST_BLOCKS
from simrob_drake.simulink.reading.graph import Mask, MaskParameter, Model, SimulinkBlock, System
from simrob_drake.simulink.reading.libraries import BUILT_IN, Libraries
from simrob_drake.simulink.values.evaluate import UndefinedVariable
from simrob_drake.simulink.values.octave import Octave
from simrob_drake.simulink.values.syntax import NotUnderstood
from simrob_drake.simulink.values.workspace import Variables


@dataclass
class Expanded:
    """A model with everything put in.

    Attributes:
        model: as it was read.
        root: a node without a block of its own, whose children are the model's blocks.
        findings: problems met so far.
        libraries: the files that were taken in.
        nodes: its blocks on all levels, except those of ``left_out``.
        left_out: blocks that take no part, by path: their type, and why.
    """

    model: Model
    root: Node
    findings: Findings
    libraries: Libraries
    nodes: list[Node] = field(default_factory=list)
    left_out: dict[str, tuple[str, str]] = field(default_factory=dict)

    def leave_out(self, path: str, block: SimulinkBlock, why: str) -> None:
        """Note a block that takes no part, and all that is in it."""
        self.left_out[path] = (block.kind, why)
        for inner in block.system.blocks.values() if block.system else ():
            self.leave_out(f"{path}/{inner.name}", inner, why)


def expand(
    model: Model, libraries: Libraries, variables: dict[str, Any], findings: Findings, octave: Octave | None = None
) -> Expanded:
    """Return a model with libraries, referenced subsystems and chosen variants put in.

    Raises:
        InvalidModel: it has no end, or a library cannot be read.
    """
    written = Variables(name=model.name, code=model.code, octave=octave)
    workspace = Variables(name="given", variables=variables, outer=written)
    root = Node(
        "",
        SimulinkBlock("", model.name, "SubSystem", system=model.system),
        workspace,
        findings,
        system=model.system,
        home=model.name,
    )
    if model.mask is not None:
        root.workspace = _masked(model.name, model.mask, {}, workspace)
    expanded = Expanded(model, root, findings, libraries)
    _Expansion(expanded).fill(root, 0)
    return expanded


class _Expansion:
    """One walk down a model."""

    def __init__(self, expanded: Expanded) -> None:
        self._expanded = expanded
        self._libraries = expanded.libraries

    def fill(self, parent: Node, depth: int) -> None:
        if depth > DEEPEST:
            raise parent.refusal("its libraries contain themselves")
        assert parent.system is not None
        for sid, block in parent.system.blocks.items():
            if block.commented == "on":
                self._expanded.leave_out(path_below(parent, block), block, "commented out")
                continue
            parent.children[sid] = self._node(parent, block)
        if parent.is_on("Variant"):
            for other in _drop_the_others(parent):
                self._expanded.leave_out(other.path, other.block, "a variant that is not chosen")
        for node in parent.children.values():
            self._expanded.nodes.append(node)
            if len(self._expanded.nodes) > MOST_BLOCKS:
                raise parent.refusal(f"the model has more than {MOST_BLOCKS} blocks with its libraries")
            if node.system is not None and node.block.commented != "through":
                self.fill(node, depth + 1)

    def _node(self, parent: Node, block: SimulinkBlock) -> Node:
        path = path_below(parent, block)
        assert parent.system is not None
        moves = any(port.block == block.sid for net in parent.system.nets for port in net)
        block, mask, system, home = self._contents(block, path, parent.home, moves=moves)
        workspace = parent.workspace
        if mask is not None:
            workspace = _masked(path, mask, block.parameters, workspace)
        return Node(path, block, workspace, parent.findings, parent, system=system, home=home)

    def _contents(
        self, block: SimulinkBlock, path: str, home: str, *, moves: bool
    ) -> tuple[SimulinkBlock, Mask | None, System | None, str]:
        """Return a block as it is after its links are followed, with its mask, what is in it, and the file of that.

        Where that file is missing, mechanics are lost if physical lines lead to the block and it ``moves``.
        """
        referenced = block.parameters.get("ReferencedSubsystem", "")
        if block.kind == "ModelReference":
            named = (block.parameters.get(name, "") for name in ("ModelFile", "ModelNameDialog", "ModelName"))
            referenced = next(filter(None, named), "").removesuffix(".slx").removesuffix(".mdl")
        if referenced:
            model = self._libraries.model(referenced)
            if model is None:
                self._note_missing(path, referenced, "referenced subsystem", moves=moves)
                return block, None, None, home
            return block, model.mask, model.system, referenced
        mask, own = block.mask, block
        for _ in range(DEEPEST):
            if not own.linked or own.kind.partition("/")[0] in BUILT_IN:
                break
            source = own.kind
            if source.startswith("$bdroot/"):
                source = f"{home}/{source.removeprefix('$bdroot/')}"
            home = source.partition("/")[0]
            found = self._libraries.block(source)
            if found is None:
                self._note_missing(path, home, f"library block {source}", moves=moves)
                return block, None, None, home
            own, mask = replace(found, parameters={**found.parameters, **_own(block)}), mask or found.mask
        return replace(own, sid=block.sid, name=block.name), mask, own.system, home

    def _note_missing(self, path: str, name: str, what: str, *, moves: bool) -> None:
        message = f"{what}: the file {name}.slx is missing; give its folder with --library DIR"
        self._expanded.findings.report.add("lost" if moves else "open", path, message)


def path_below(parent: Node, block: SimulinkBlock) -> str:
    """Return the path of a block in a subsystem."""
    return f"{parent.path}/{block.name}" if parent.path else block.name


def _own(block: SimulinkBlock) -> dict[str, str]:
    """Return what a link sets itself, on top of its library block."""
    hidden = "SourceBlock", "SourceType", "LibraryVersion"
    return {name: value for name, value in block.parameters.items() if name not in hidden}


def _masked(name: str, mask: Mask, values: dict[str, str], outer: Variables) -> Variables:
    """Return the workspace inside a mask."""
    workspace = Variables(name=name, outer=outer, code=mask.code)
    for parameter in mask.parameters:
        text = values.get(parameter.name, parameter.value)
        workspace.pending[parameter.name] = _reader(parameter, text, outer)
    return workspace


def _reader(parameter: MaskParameter, text: str, outer: Variables) -> Callable[[], Any]:
    """Return how a mask parameter's value is found."""
    if parameter.kind == "checkbox":
        return lambda: outer.value("1" if text == "on" else "0")
    if parameter.kind == "popup":
        if parameter.evaluated and text in parameter.choices:
            return lambda: outer.value(str(parameter.choices.index(text) + 1))
        return lambda: text
    if not parameter.evaluated:
        return lambda: text

    def read() -> Any:
        try:
            return outer.value(text)
        except NotUnderstood as problem:
            raise UndefinedVariable(parameter.name, f"its value {text[:40]} {problem}") from problem

    return read


def _drop_the_others(variant: Node) -> list[Node]:
    """Leave the active choice alone in a variant subsystem, with the ports around it, and return the others."""
    choice = chosen_variant(variant)
    if choice is None:
        choice = _first_variant(variant)
    others = {sid: child for sid, child in variant.children.items() if child.system is not None and child is not choice}
    for sid in others:
        del variant.children[sid]
    return list(others.values())


def _first_variant(variant: Node) -> Node | None:
    """Take the first choice of a variant subsystem whose choice only MATLAB knows, and note that."""
    choices = [child for child in variant.children.values() if child.system is not None]
    if not choices:
        return None
    controls = ", ".join(child.text("VariantControl") or child.block.name for child in choices)
    variant.findings.missing(UndefinedVariable(controls), f"{variant.path}: which variant it is")
    variant.findings.report.add("defaulted", variant.path, f"the variant {choices[0].block.name}, of {controls}")
    variant.block.parameters["LabelModeActiveChoice"] = choices[0].text("VariantControl")
    return choices[0]


def chosen_variant(node: Node) -> Node | None:
    """Return the active choice of a variant subsystem, or None where only MATLAB can tell."""
    label = node.text("LabelModeActiveChoice") or node.text("OverrideUsingVariant")
    for child in node.children.values():
        control = child.text("VariantControl")
        if control and control == label:
            return child
    for child in node.children.values():
        control = child.text("VariantControl")
        try:
            if control and bool(node.workspace.value(control)):
                return child
        except (UndefinedVariable, NotUnderstood, InvalidModel, ValueError):
            continue
    return None
