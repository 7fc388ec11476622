"""Materials: every name stands for one colour that is there, as Drake wants it."""

import xml.etree.ElementTree as ET

from simrob_drake.importer.repairs.names import free_name
from simrob_drake.robots.imports import ImportReport
from simrob_drake.robots.urdf import DRAKE, add_colour, name_of, text

DEFAULT_RGBA = [0.7, 0.7, 0.7, 1.0]  # of a material that is not defined: a light grey

_TEXTURES = ("texture", f"{DRAKE}diffuse_map")


def repair_materials(robot: ET.Element, report: ImportReport) -> None:
    """Repair the materials of a robot and of its visuals, in place."""
    for material in [*robot.iterfind("material"), *robot.iterfind("link/visual/material")]:
        _repair_colour(material, report)
    colours = _keep_first_definitions(robot, report)
    for link in robot.iterfind("link"):
        for visual in link.iterfind("visual"):
            for material in visual.findall("material"):
                _settle(robot, visual, material, colours, report)
    # what one visual defines and others use is defined for the robot: that one may be dropped
    used = {name_of(material) for material in robot.iterfind("link/visual/material") if _rgba(material) is None}
    for name in sorted(used - {name_of(material) for material in robot.iterfind("material")}):
        robot.insert(0, add_colour(ET.Element("robot"), name, colours[name]))
        report.add("read", f"material '{name}'", "defined in one visual and used in others; now for all of them")


def _repair_colour(material: ET.Element, report: ImportReport) -> None:
    """Leave a material with a colour that Drake takes, or without any."""
    where = f"material '{name_of(material)}'"
    for texture in [texture for tag in _TEXTURES for texture in material.iterfind(tag)]:
        material.remove(texture)
        report.add("dropped", where, f"its texture '{texture.get('filename', '')}'; only colours are imported")
    colour = material.find("color")
    if colour is None:
        return
    rgba = colour.get("rgba")
    if rgba is None:
        material.remove(colour)
        report.add("dropped", where, "its colour has no rgba")
        return
    values = [float(word) for word in rgba.split()]
    rgb, alpha = values[:3], values[3] if len(values) > 3 else 1.0
    if max(rgb) >= 2.0:  # of eight bits
        rgb = [value / 255 for value in rgb]
        alpha = alpha / 255 if alpha > 1 else alpha
    right = [min(max(value, 0.0), 1.0) for value in (*rgb, alpha)]
    if right != values:
        colour.set("rgba", text(right))
        report.add("repaired", where, f'rgba="{rgba}" written as "{colour.get("rgba")}", four numbers from 0 to 1')


def _keep_first_definitions(robot: ET.Element, report: ImportReport) -> dict[str, list[float]]:
    """Keep one definition a name among the robot's own materials, and return their colours."""
    colours: dict[str, list[float]] = {}
    for material in list(robot.iterfind("material")):
        name, rgba = name_of(material), _rgba(material)
        if not name:
            problem = "has no name, so nothing can use it"
        elif rgba is None:
            problem = "has no colour"
        elif name not in colours:
            colours[name] = rgba
            continue
        elif colours[name] == rgba:
            problem = "is defined twice, with the same colour"
        else:
            problem = f"is defined again, with another colour {text(rgba)}; the first, {text(colours[name])}, holds"
        robot.remove(material)
        report.add("dropped", f"material '{name}'", problem)
    return colours


def _settle(
    robot: ET.Element, visual: ET.Element, material: ET.Element, colours: dict[str, list[float]], report: ImportReport
) -> None:
    """Give the material of a visual a colour, and a name of its own where the colour is another one."""
    name, rgba = name_of(material), _rgba(material)
    if not name:
        if rgba is None:
            visual.remove(material)
            report.add("dropped", "material ''", "has neither name nor colour")
    elif rgba is None:
        if name not in colours:
            colours[name] = DEFAULT_RGBA
            robot.insert(0, add_colour(ET.Element("robot"), name, DEFAULT_RGBA))
            report.add("defaulted", f"material '{name}'", f"is not defined; a grey, {text(DEFAULT_RGBA)}")
    elif colours.setdefault(name, rgba) != rgba:
        same = (other for other, colour in colours.items() if colour == rgba and other.startswith(f"{name}_"))
        new = next(same, free_name(name, colours))
        colours[new] = rgba
        material.set("name", new)
        report.add(
            "repaired", f"material '{name}'", f"used with another colour, {text(rgba)}, as well; that is '{new}' now"
        )


def _rgba(material: ET.Element) -> list[float] | None:
    colour = material.find("color")
    return None if colour is None else [float(word) for word in colour.get("rgba", "").split()]
