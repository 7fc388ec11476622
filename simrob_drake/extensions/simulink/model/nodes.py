"""Blocks where they stand in a model, and the walk that puts libraries in and gives each its workspace."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from simrob_drake.base.errors import InvalidModel
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import compound, join_texts, message
from simrob_drake.extensions.simulink.reading.graph import (
    DEEPEST,
    MOST_BLOCKS,
    Mask,
    MaskParameter,
    Model,
    SimulinkBlock,
)
from simrob_drake.extensions.simulink.reading.model_file import BUILT_IN, Libraries, referenced_by
from simrob_drake.extensions.simulink.values.elementary import ELEMENTARY
from simrob_drake.extensions.simulink.values.evaluate import UndefinedVariable, matrix
from simrob_drake.extensions.simulink.values.mat import stored_workspace
from simrob_drake.extensions.simulink.values.syntax import NotUnderstood
from simrob_drake.extensions.simulink.values.units import UnknownUnit, factor
from simrob_drake.extensions.simulink.values.workspace import Octave, Variables
from simrob_drake.robots.imports import EntryKind, ImportReport

_OLDER_UNITS = {
    **dict.fromkeys(
        ("TranslationStandardOffset", "TranslationCartesianOffset"), "TranslationLengthUnit"
    ),
    "GravityVector": "GravityUnits",
}
"""Where the first releases of Simscape Multibody keep units."""


_OF_LINKS = ("SourceBlock", "SourceType", "LibraryVersion")
"""Parameters that a link has for itself, and not for the block of a library that it stands for."""


@dataclass
class Findings:
    """What is found while a model is read."""

    report: ImportReport  # everything, in words
    undefined: dict[str, list[str]] = field(default_factory=dict)
    """Variables that no workspace has: name, then the places that ask for it."""
    assume: bool = False  # take the default of a block's parameter whose variable is unknown

    def missing(self, problem: UndefinedVariable, where: str) -> None:
        """Note a variable that is not known."""
        name = problem.name.rstrip(".") + (f" ({problem.why})" if problem.why else "")
        places = self.undefined.setdefault(name, [])
        if where not in places:
            places.append(where)


_TURNING = {f"{library}_lib/Mechanical/Rotational Elements/Inertia" for library in ("fl", "sdl")}


@dataclass(eq=False)
class Node:
    """A block of an expanded model."""

    path: str  # from the model's top, ``Arm/joint_1``
    block: SimulinkBlock  # as it is written
    workspace: Variables  # where its parameters' variables are found
    findings: Findings  # where problems are noted
    parent: Node | None = None  # the subsystem it is in
    # what is in it, by identifier; its lines connect it
    children: dict[str, Node] = field(default_factory=dict)
    home: str = ""  # name of the file it is written in

    @property
    def kind(self) -> str:
        """What it is: its ``BlockType``, or the last part of its place in a library that is not at hand."""
        place = self.block.kind
        if place in _TURNING:  # no solid of that name
            return "Rotational Inertia"
        return place.rpartition("/")[2] if self.block.linked else place

    def text(self, name: str, default: str = "") -> str:
        """Return a parameter as it is written."""
        return self.block.parameters.get(name, default)

    def named(self, *names: str) -> str:
        """Return which of these names a parameter has here; the first where it has none of them."""
        return next((one for one in names if one in self.block.parameters), names[0])

    def is_on(self, name: str) -> bool:
        """Tell whether a switch is on."""
        return self.text(name, "off") == "on"

    def value(self, name: str, default: str, unknown: str | None = None) -> Any:
        """Return a parameter's value: a matrix, text or structure.

        Where a variable is not known it is ``unknown``, or else the default.

        Raises InvalidModel: it cannot be computed.
        """
        text = self.text(name, default) or default
        try:
            return self.workspace.value(text)
        except UndefinedVariable as problem:
            if not name.startswith("Graphic"):  # looks move nothing
                self.findings.missing(
                    problem, compound("{path}: {name}", path=self.path, name=name)
                )
            if self.findings.assume:
                taken = unknown or default
                self.note(
                    "defaulted",
                    message(
                        "simulink.unknown_value",
                        "{name} = {text} is unknown: {taken} is taken",
                        name=name,
                        text=text,
                        taken=taken,
                    ),
                )
            return self.workspace.value(unknown or default)
        except NotUnderstood as problem:
            raise self.refusal(
                message(
                    "simulink.value_problem",
                    "{name} = {text} {problem}",
                    name=name,
                    text=text[:60],
                    problem=problem,
                )
            ) from problem

    def numbers(
        self,
        name: str,
        default: str,
        *,
        unit: str = "1",
        size: int | None = None,
        unknown: str | None = None,
    ) -> Vector:
        """Return a parameter as a flat vector in SI; its unit stands under ``<name>Units``, and must be like ``unit``.

        The default counts where it is missing, and ``unknown``, or the default, where a variable is not known. Raises
        InvalidModel: not ``size`` numbers, or a unit that does not fit.
        """
        array = self.matrix(name, default, unknown).reshape(-1)
        if size is not None and array.size != size:
            raise self.refusal(
                message(
                    "simulink.count_of_numbers",
                    "{name} has {count} numbers, not {expected}",
                    name=name,
                    count=array.size,
                    expected=size,
                )
            )
        if not np.all(np.isfinite(array)):
            raise self.refusal(message("simulink.not_finite", "{name} is not finite", name=name))
        return np.asarray(array * self.unit(name, unit))

    def matrix(self, name: str, default: str, unknown: str | None = None) -> Vector:
        """Return a parameter as a matrix, as it is written (raises InvalidModel: it is none)."""
        try:
            return matrix(self.value(name, default, unknown))
        except (NotUnderstood, TypeError, ValueError) as problem:
            raise self.refusal(
                compound("{name} {problem}", name=name, problem=problem)
            ) from problem

    def number(
        self, name: str, default: str = "0", *, unit: str = "1", unknown: str | None = None
    ) -> float:
        """Return a parameter as one number in SI."""
        return float(self.numbers(name, default, unit=unit, size=1, unknown=unknown)[0])

    def quantity(self, *names: str, default: str = "0") -> float:
        """Return a parameter in SI under the first of these names that is there; its unit is under ``<name>_unit``."""
        name = self.named(*names)
        return self.number(name, default) * self.in_si(self.text(f"{name}_unit", "1"), name)

    def unit(self, name: str, like: str) -> float:
        """Return what a parameter's unit is in SI; SI where none is written."""
        names = f"{name}Units", f"{name.removesuffix('s')}Units", _OLDER_UNITS.get(name, "")
        written = next(filter(None, map(self.text, names)), "")
        return self.in_si(written, name, like) if written else 1.0

    def in_si(self, text: str, name: str, like: str = "") -> float:
        """Return what a unit that is written under a name is in SI, of the dimension of another if one is given."""
        try:
            return factor(text, like or text)
        except UnknownUnit as problem:
            raise self.refusal(
                compound("{name}: {problem}", name=name, problem=problem)
            ) from problem

    def note(self, kind: EntryKind, text: str) -> None:
        """Note in the report what became of the block."""
        self.findings.report.add(kind, self.path, text)

    def lose(self, problem: InvalidModel, instead: str = "") -> None:
        """Note that what the block does to the motion is lost, and why.

        Args:
            problem: why it is lost.
            instead: what the station has in its place, appended to the reason; empty if there is nothing.
        """
        # The entry of the report names the block, so that the reason begins after its name.
        reason = _as_message(str(problem).rpartition(f"{self.path}: ")[2], problem.problem)
        self.note("lost", join_texts([reason, instead], "") if instead else reason)

    def refusal(self, problem: str) -> InvalidModel:
        """Return the error for what this block cannot be."""
        return self.findings.report.refusal(self.path, problem)


def without_file(problem: Exception, file: Path) -> str:
    """Message of an error about a model, without the model's file, which a report names once."""
    text = str(problem).removeprefix(f"{file}: ")
    if not isinstance(problem, InvalidModel):
        return text
    parts = [part for part in (problem.element, problem.problem) if part]
    return _as_message(text, join_texts(parts, ": "))


def _as_message(text: str, expected: str) -> str:
    """Return the message of which a text is expected to be the English words, or the text if it has others."""
    return expected if expected == text else text


@dataclass
class Expanded:
    """A model with everything put in."""

    model: Model  # as it was read
    root: Node  # a node without a block of its own, whose children are the model's blocks
    findings: Findings  # problems met so far
    libraries: Libraries  # the files that were taken in
    # its blocks on all levels, except those of ``left_out``
    nodes: list[Node] = field(default_factory=list)
    left_out: dict[str, tuple[str, str]] = field(default_factory=dict)
    """Blocks that take no part, by path: their type, and why."""
    settings: dict[str, dict[str, str]] = field(default_factory=dict)
    """Parameters that code of masks sets of blocks in their subsystems, by path."""

    def leave_out(self, path: str, block: SimulinkBlock, why: str) -> None:
        """Note a block that takes no part, and all that is in it."""
        self.left_out[path] = (block.kind, why)
        for inner in block.system.blocks.values() if block.system else ():
            self.leave_out(f"{path}/{inner.name}", inner, why)

    def fill(self, parent: Node, depth: int = 0) -> None:
        """Put in all that is in a subsystem."""
        if depth > DEEPEST:
            raise parent.refusal(
                message("simulink.libraries_contain_themselves", "its libraries contain themselves")
            )
        assert parent.block.system is not None
        for sid, written in parent.block.system.blocks.items():
            path = path_below(parent, written)
            found = self.settings.get(_plain(path))  # by code of masks around it
            block = (
                replace(written, parameters={**written.parameters, **found}) if found else written
            )
            if block.commented == "on":
                self.leave_out(path, block, message("simulink.commented_out", "commented out"))
            else:
                parent.children[sid] = self._node(parent, block)
        if parent.is_on("Variant"):
            for other in _drop_the_others(parent):
                self.leave_out(
                    other.path,
                    other.block,
                    message("simulink.variant_not_chosen", "a variant that is not chosen"),
                )
        for node in parent.children.values():
            self.nodes.append(node)
            if len(self.nodes) > MOST_BLOCKS:
                raise parent.refusal(
                    message(
                        "simulink.too_many_blocks_with_libraries",
                        "the model has more than {most} blocks with its libraries",
                        most=MOST_BLOCKS,
                    )
                )
            if node.block.system is not None and node.block.commented != "through":
                self.fill(node, depth + 1)

    def _node(self, parent: Node, block: SimulinkBlock) -> Node:
        path = path_below(parent, block)
        assert parent.block.system is not None
        moves = any(port.block == block.sid for net in parent.block.system.nets for port in net)
        block, home = self._contents(block, path, parent.home, moves=moves)
        workspace = parent.workspace
        if block.mask is not None:
            workspace = _masked(path, block.mask, block.parameters, workspace)
            if "set_param" in block.mask.code:
                workspace.run()
                if workspace.unset:
                    text = message(
                        "simulink.mask_code_not_run",
                        "code of its mask sets parameters in it by what only MATLAB runs: they are taken as saved",
                    )
                    parent.findings.report.add("approximated", path, text)
                for below, texts in workspace.settings.items():
                    if (chosen := texts.get("OverrideUsingVariant")) is not None:
                        texts["LabelModeActiveChoice"] = chosen
                    self.settings.setdefault(_plain(f"{path}/{below}"), {}).update(texts)
        return Node(path, block, workspace, parent.findings, parent, home=home)

    def _contents(
        self, block: SimulinkBlock, path: str, home: str, *, moves: bool
    ) -> tuple[SimulinkBlock, str]:
        """Return a block as it is after its links are followed, with its mask and what is in it, and the file of that.

        Where that file is missing, mechanics are lost if physical lines lead to the block and it ``moves``.
        """
        if referenced := referenced_by(block):
            model = self.libraries.model(referenced)
            if model is None:
                self._note_missing(
                    path,
                    message("simulink.referenced_subsystem", "referenced subsystem"),
                    referenced,
                    moves=moves,
                )
                return replace(block, mask=None, system=None), home
            return replace(block, mask=model.mask, system=model.system), referenced
        mask, own, written = block.mask, block, block.parameters.items()
        for _ in range(DEEPEST):
            if not own.linked or own.kind.partition("/")[0] in BUILT_IN:
                break
            first, _, rest = own.kind.partition("/")
            home = home if first == "$bdroot" else first
            source = f"{home}/{rest}"
            found = self.libraries.block(source)
            if found is None:
                if not self.libraries.script(block.parameters.get("ClassName", ""), ".ssc"):
                    self._note_missing(
                        path,
                        message("simulink.library_block", "library block {source}", source=source),
                        home,
                        moves=moves,
                    )
                return replace(block, mask=None, system=None), home
            said = {name: text for name, text in written if name not in _OF_LINKS}
            own, mask = replace(found, parameters=found.parameters | said), mask or found.mask
        return replace(own, sid=block.sid, name=block.name, mask=mask), home

    def _note_missing(self, path: str, what: str, name: str, *, moves: bool) -> None:
        missing = message(
            "simulink.library_missing",
            "the file {name}.slx is missing; give its folder with --library DIR",
            name=name,
        )
        why = (
            missing
            if self.libraries.model(name) is None
            else message(
                "simulink.no_such_block", "the file {name}.slx has no such block", name=name
            )
        )
        self.findings.report.add(
            "lost" if moves else "open", path, compound("{what}: {why}", what=what, why=why)
        )


def expand(
    model: Model,
    libraries: Libraries,
    variables: dict[str, Any],
    findings: Findings,
    octave: Octave | None = None,
) -> Expanded:
    """Return a model with libraries, referenced subsystems and chosen variants put in.

    Raises InvalidModel: it has no end, or a library cannot be read.
    """
    code = "\n".join(model.callbacks.values())
    called = Variables(
        name="callbacks", variables=dict(variables), code=code, octave=octave, files=libraries
    )
    if findings.assume:
        called.spare = _spares(model, libraries, findings)
    stored = stored_workspace(model.stored) or {}
    written = Variables(name=model.name, variables=stored, code=model.code, outer=called)
    workspace = Variables(name="given", variables=variables, outer=written)
    top = SimulinkBlock("", model.name, "SubSystem", system=model.system)
    root = Node("", top, workspace, findings, home=model.name)
    if model.mask is not None:
        root.workspace = _masked(model.name, model.mask, {}, workspace)
    expanded = Expanded(model, root, findings, libraries)
    expanded.fill(root)
    return expanded


def _spares(model: Model, libraries: Libraries, findings: Findings) -> Callable[[str], Any]:
    """Return what gives variables of files beside a model: no script is gone through before one is lacking."""
    offered = cache(lambda: libraries.offered(model))

    def spare(name: str) -> Any:
        asks_for_field, name = name.endswith("."), name.rstrip(".")
        if (name in ELEMENTARY and not asks_for_field) or name not in offered():
            return None
        file, value, odd = offered()[name]
        text = message(
            "simulink.taken_from_it",
            "{name} is taken from it, for the model's own workspaces do not have it",
            name=name,
        )
        if odd:
            findings.missing(
                UndefinedVariable(
                    name,
                    message(
                        "simulink.values_differ", "{names} differ", names=", ".join([file, *odd])
                    ),
                ),
                file,
            )
            text += message(
                "simulink.set_otherwise", "; {odd} set it otherwise", odd=", ".join(odd)
            )
        findings.report.add("approximated", file, text)
        return value

    return spare


def path_below(parent: Node, block: SimulinkBlock) -> str:
    """Return the path of a block in a subsystem."""
    return f"{parent.path}/{block.name}" if parent.path else block.name


def _plain(path: str) -> str:
    return " ".join(path.split())


def _masked(name: str, mask: Mask, values: dict[str, str], outer: Variables) -> Variables:
    workspace = Variables(name=name, outer=outer, code=mask.code)
    for parameter in mask.parameters:
        text = values.get(parameter.name, parameter.value)
        workspace.pending[parameter.name] = _reader(parameter, text, outer)
        workspace.texts[parameter.name] = text
    return workspace


def _reader(parameter: MaskParameter, text: str, outer: Variables) -> Callable[[], Any]:
    if parameter.kind == "checkbox":
        text = "1" if text == "on" else "0"
    elif parameter.kind == "popup" and parameter.evaluated and text in parameter.choices:
        place = parameter.choices.index(text)
        text = "".join(parameter.counts[place : place + 1]) or str(place + 1)
    elif parameter.kind == "popup" or not parameter.evaluated:
        return lambda: text

    def read() -> Any:
        try:
            return outer.value(text)
        except NotUnderstood as problem:
            raise UndefinedVariable(
                parameter.name,
                message(
                    "simulink.its_value",
                    "its value {text} {problem}",
                    text=text[:40],
                    problem=problem,
                ),
            ) from problem

    return read


def _drop_the_others(variant: Node) -> list[Node]:
    """Leave the active choice alone in a variant subsystem, with the ports around it, and return the others."""
    choice = chosen_variant(variant) or _first_variant(variant)
    others = [
        child
        for child in variant.children.values()
        if child.block.system is not None and child is not choice
    ]
    variant.children = {
        sid: child for sid, child in variant.children.items() if child not in others
    }
    return others


def _first_variant(variant: Node) -> Node | None:
    """Take the first choice of a variant subsystem whose choice only MATLAB knows, and note that."""
    choices = [child for child in variant.children.values() if child.block.system is not None]
    if not choices:
        return None
    controls = ", ".join(child.text("VariantControl") or child.block.name for child in choices)
    variant.findings.missing(
        UndefinedVariable(controls),
        message("simulink.which_variant", "{path}: which variant it is", path=variant.path),
    )
    variant.note(
        "defaulted",
        message(
            "simulink.variant_of",
            "the variant {block}, of {controls}",
            block=choices[0].block.name,
            controls=controls,
        ),
    )
    variant.block.parameters["LabelModeActiveChoice"] = choices[0].text("VariantControl")
    return choices[0]


def chosen_variant(node: Node) -> Node | None:
    """Return the active choice of a variant subsystem, or None where only MATLAB can tell."""
    label = node.text("LabelModeActiveChoice") or node.text("OverrideUsingVariant")
    controls = [
        (control, child)
        for child in node.children.values()
        if (control := child.text("VariantControl"))
    ]
    for control, child in controls:
        if control == label:
            return child
    for control, child in controls:
        with suppress(UndefinedVariable, NotUnderstood, InvalidModel, ValueError):
            if bool(node.workspace.value(control)):
                return child
    return None
