"""Materials: every name stands for one colour that is there, as Drake wants it."""

import xml.etree.ElementTree as ET

from simrob_drake.base.messages import message
from simrob_drake.importer.repairs.names import free_name
from simrob_drake.robots.imports import ImportReport
from simrob_drake.robots.urdf import DRAKE, add_colour, format_numbers, name_of

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
    used = {
        name_of(material)
        for material in robot.iterfind("link/visual/material")
        if _rgba(material) is None
    }
    for name in sorted(used - {name_of(material) for material in robot.iterfind("material")}):
        robot.insert(0, add_colour(ET.Element("robot"), name, colours[name]))
        report.add(
            "read",
            message("robots.material_called", "material '{name}'", name=name),
            message(
                "importer.material_for_all",
                "defined in one visual and used in others; now for all of them",
            ),
        )


def _repair_colour(material: ET.Element, report: ImportReport) -> None:
    """Leave a material with a colour that Drake takes, or without any."""
    where = message("robots.material_called", "material '{name}'", name=name_of(material))
    for texture in [texture for tag in _TEXTURES for texture in material.iterfind(tag)]:
        material.remove(texture)
        report.add(
            "dropped",
            where,
            message(
                "importer.texture_not_imported",
                "its texture '{file}'; only colours are imported",
                file=texture.get("filename", ""),
            ),
        )
    colour = material.find("color")
    if colour is None:
        return
    rgba = colour.get("rgba")
    if rgba is None:
        material.remove(colour)
        report.add(
            "dropped", where, message("importer.colour_without_rgba", "its colour has no rgba")
        )
        return
    values = [float(word) for word in rgba.split()]
    rgb, alpha = values[:3], values[3] if len(values) > 3 else 1.0
    if max(rgb) >= 2.0:  # of eight bits
        rgb = [value / 255 for value in rgb]
        alpha = alpha / 255 if alpha > 1 else alpha
    right = [min(max(value, 0.0), 1.0) for value in (*rgb, alpha)]
    if right != values:
        colour.set("rgba", format_numbers(right))
        report.add(
            "repaired",
            where,
            message(
                "importer.rgba_written_as",
                'rgba="{rgba}" written as "{written}", four numbers from 0 to 1',
                rgba=rgba,
                written=colour.get("rgba"),
            ),
        )


def _keep_first_definitions(robot: ET.Element, report: ImportReport) -> dict[str, list[float]]:
    """Keep one definition a name among the robot's own materials, and return their colours."""
    colours: dict[str, list[float]] = {}
    for material in list(robot.iterfind("material")):
        name, rgba = name_of(material), _rgba(material)
        if not name:
            problem = message(
                "importer.material_without_name", "has no name, so nothing can use it"
            )
        elif rgba is None:
            problem = message("importer.material_without_colour", "has no colour")
        elif name not in colours:
            colours[name] = rgba
            continue
        elif colours[name] == rgba:
            problem = message("importer.material_twice", "is defined twice, with the same colour")
        else:
            problem = message(
                "importer.material_twice_differently",
                "is defined again, with another colour {other}; the first, {first}, holds",
                other=format_numbers(rgba),
                first=format_numbers(colours[name]),
            )
        robot.remove(material)
        report.add(
            "dropped", message("robots.material_called", "material '{name}'", name=name), problem
        )
    return colours


def _settle(
    robot: ET.Element,
    visual: ET.Element,
    material: ET.Element,
    colours: dict[str, list[float]],
    report: ImportReport,
) -> None:
    """Give the material of a visual a colour, and a name of its own where the colour is another one."""
    name, rgba = name_of(material), _rgba(material)
    if not name:
        if rgba is None:
            visual.remove(material)
            report.add(
                "dropped",
                message("importer.nameless_material", "material ''"),
                message("importer.neither_name_nor_colour", "has neither name nor colour"),
            )
    elif rgba is None:
        if name not in colours:
            colours[name] = DEFAULT_RGBA
            robot.insert(0, add_colour(ET.Element("robot"), name, DEFAULT_RGBA))
            report.add(
                "defaulted",
                message("robots.material_called", "material '{name}'", name=name),
                message(
                    "importer.material_undefined",
                    "is not defined; a grey, {colour}",
                    colour=format_numbers(DEFAULT_RGBA),
                ),
            )
    elif colours.setdefault(name, rgba) != rgba:
        same = (
            other
            for other, colour in colours.items()
            if colour == rgba and other.startswith(f"{name}_")
        )
        new = next(same, free_name(name, colours))
        colours[new] = rgba
        material.set("name", new)
        report.add(
            "repaired",
            message("robots.material_called", "material '{name}'", name=name),
            message(
                "importer.material_with_other_colour",
                "used with another colour, {colour}, as well; that is '{new}' now",
                colour=format_numbers(rgba),
                new=new,
            ),
        )


def _rgba(material: ET.Element) -> list[float] | None:
    colour = material.find("color")
    return None if colour is None else [float(word) for word in colour.get("rgba", "").split()]
