"""From the XML elements of a model to its graph."""

from collections.abc import Callable, Mapping
from xml.etree.ElementTree import Element

from simrob_drake.simulink.reading.graph import Mask, MaskParameter, Port, SimulinkBlock, System

MOST_BLOCKS = 200_000
DEEPEST = 100  # subsystems in subsystems


class TooManyElements(ValueError):
    """A model that refers to its own parts so often that it grows without end."""


class SystemReader:
    """Reads systems, following references to those that lie in parts of their own."""

    def __init__(self, part: Callable[[str], Element], defaults: Mapping[str, dict[str, str]]) -> None:
        """Take how the part of a referred system is found by its name, and what blocks of a type leave unsaid."""
        self._part, self._defaults = part, defaults
        self._blocks = 0

    def system(self, element: Element, depth: int = 0) -> System:
        """Return a system.

        Raises:
            TooManyElements: it has no end.
        """
        if depth > DEEPEST:
            raise TooManyElements(f"nests subsystems more than {DEEPEST} deep")
        reference = element.get("Ref")
        if reference:
            return self.system(self._part(reference), depth + 1)
        system = System()
        for child in element:
            if child.tag == "Block":
                block = self._block(child, depth)
                system.blocks[block.sid] = block
            elif child.tag == "Line":
                _add_line(system, child)
        return system

    def _block(self, element: Element, depth: int) -> SimulinkBlock:
        self._blocks += 1
        if self._blocks > MOST_BLOCKS:
            raise TooManyElements(f"has more than {MOST_BLOCKS} blocks")
        parameters = _parameters(element)
        instance = element.find("InstanceData")
        if instance is not None:
            parameters |= _parameters(instance)
        kind, source = element.get("BlockType", ""), parameters.get("SourceBlock", "")
        linked = kind == "Reference"
        inner = element.find("System")
        mask = element.find("Mask")
        return SimulinkBlock(
            sid=element.get("SID") or parameters.get("SID") or element.get("Name") or "",
            name=one_line(element.get("Name", "")),
            kind=one_line(source) if linked else kind,
            linked=linked,
            parameters={**self._defaults.get(kind, {}), **parameters},
            mask=None if mask is None else read_mask(mask),
            system=None if inner is None else self.system(inner, depth + 1),
        )


def read_defaults(element: Element | None) -> dict[str, dict[str, str]]:
    """Return the parameters that blocks of a type have where they do not say them, by type."""
    found = element.iter("Block") if element is not None else ()
    return {block.get("BlockType", ""): _parameters(block) for block in found if block.get("BlockType") != "SubSystem"}


def read_mask(element: Element) -> Mask:
    """Return a mask."""
    code = element.find("Initialization")
    return Mask(
        tuple(_mask_parameter(parameter) for parameter in element.iterfind("MaskParameter")),
        code.text or "" if code is not None else "",
    )


def _mask_parameter(element: Element) -> MaskParameter:
    options = element.find("TypeOptions")
    return MaskParameter(
        name=element.get("Name", ""),
        value=element.findtext("Value") or "",
        evaluated=element.get("Evaluate", "on") == "on",
        kind=element.get("Type", "edit"),
        choices=() if options is None else tuple(option.text or "" for option in options.iter("Option")),
    )


def one_line(text: str) -> str:
    """Return a block's name or place as people write it: on one line."""
    return " ".join(text.split())


def _parameters(element: Element) -> dict[str, str]:
    return {parameter.get("Name", ""): (parameter.text or "").strip() for parameter in element.iterfind("P")}


def _add_line(system: System, element: Element) -> None:
    ends = [
        (parameter.get("Name"), _port(parameter.text or ""))
        for parameter in element.iter("P")
        if parameter.get("Name") in ("Src", "Dst")
    ]
    physical = element.get("LineType") == "Connection" or any(port.side in ("lconn", "rconn") for _, port in ends)
    if physical:
        system.nets.append([port for _, port in ends])
        return
    sources = [port for role, port in ends if role == "Src"]
    if sources:
        system.wires.append((sources[0], [port for role, port in ends if role == "Dst"]))
        name = _parameters(element).get("Name", "")
        if name:
            system.signals[sources[0]] = one_line(name)


def _port(text: str) -> Port:
    """Read ``50#out:1``."""
    block, _, place = text.rpartition("#")
    side, _, number = place.partition(":")
    return Port(block, side, int(number) if number.isdecimal() and len(number) < 7 else 1)
