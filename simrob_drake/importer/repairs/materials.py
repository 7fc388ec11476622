"""Repair the materials of a robot (a URDF), so that each name has exactly one colour, as Drake requires."""

import xml.etree.ElementTree as ET

from simrob_drake.base.messages import message
from simrob_drake.importer.repairs.names import free_name
from simrob_drake.robots.imports import ImportReport
from simrob_drake.robots.urdf import DRAKE, add_colour, format_numbers, name_of

DEFAULT_RGBA = [0.7, 0.7, 0.7, 1.0]
"""Colour of a material that is used and defined nowhere: a light grey. Red, green, blue and opacity, from 0 to 1."""

_TEXTURES = ("texture", f"{DRAKE}diffuse_map")
"""Tags of the elements that give a material a texture."""

_LEAST_BYTE = 2.0
"""A component that is at least this large belongs to a colour of 8-bit numbers, from 0 to 255.

Components between 1 and 2 are taken for 1: they come from rounding, or from colours that are brighter than white.
"""


def repair_materials(robot: ET.Element, report: ImportReport) -> None:
    """Repair the materials of a robot and of its visuals, in place.

    Args:
        robot: the ``robot`` element. Its numbers have been repaired before.
        report: report of the import.
    """
    # The colours come first: the steps below compare them.
    for material in [*robot.iterfind("material"), *robot.iterfind("link/visual/material")]:
        _repair_colour(material, report)
    # The robot's own definitions come before the visuals, which may use their names without a colour.
    colours = _keep_first_definitions(robot, report)
    for link in robot.iterfind("link"):
        for visual in link.iterfind("visual"):
            for material in visual.findall("material"):
                _repair_use(robot, visual, material, colours, report)

    # A colour that one visual defines and others use by its name becomes a definition of the robot: a later stage may
    # remove the visual that defines it.
    used = {
        name_of(material)
        for material in robot.iterfind("link/visual/material")
        if _rgba(material) is None
    }
    defined = {name_of(material) for material in robot.iterfind("material")}
    # Sorted, so that imports of the same file write the same text.
    for name in sorted(used - defined):
        _define(robot, name, colours[name])
        report.add(
            "read",
            message("robots.material_called", "material '{name}'", name=name),
            message(
                "importer.material_for_all",
                "is defined in one visual and used in others; now defined for the whole robot",
            ),
        )


def _define(robot: ET.Element, name: str, rgba: list[float]) -> None:
    """Add the definition of a material to a robot, in place, in front of all its elements.

    Readers that go through a file once, from its beginning, need a definition before its uses.
    """
    robot.insert(0, add_colour(ET.Element("robot"), name, rgba))


def _repair_colour(material: ET.Element, report: ImportReport) -> None:
    """Convert the colour of a material to four numbers from 0 to 1, in place, and remove its textures.

    A colour without numbers is removed, so that the material counts as one without a colour.

    Args:
        material: the ``<material>`` of the robot or of a visual.
        report: report of the import.
    """
    where = message("robots.material_called", "material '{name}'", name=name_of(material))
    for tag in _TEXTURES:
        for texture in material.findall(tag):
            material.remove(texture)
            report.add(
                "dropped",
                where,
                message(
                    "importer.texture_not_imported",
                    "its texture '{file}' is not imported, only its colour",
                    file=texture.get("filename", ""),
                ),
            )
    colour = material.find("color")
    if colour is None:
        return
    text = colour.get("rgba")
    # Without numbers nothing is left of the colour.
    if text is None:
        material.remove(colour)
        report.add(
            "dropped", where, message("importer.colour_without_rgba", "its colour has no rgba")
        )
        return
    values = [float(word) for word in text.split()]
    rgb = values[:3]
    # A colour of three numbers is opaque.
    alpha = values[3] if len(values) > 3 else 1.0
    if max(rgb) >= _LEAST_BYTE:
        rgb = [value / 255 for value in rgb]
        # Many files mix the two: 8-bit colours with an opacity from 0 to 1.
        alpha = alpha / 255 if alpha > 1 else alpha
    limited = [min(max(value, 0.0), 1.0) for value in (*rgb, alpha)]
    if limited != values:
        colour.set("rgba", format_numbers(limited))
        report.add(
            "repaired",
            where,
            message(
                "importer.rgba_written_as",
                'rgba="{rgba}" written as "{written}", four numbers from 0 to 1',
                rgba=text,
                written=colour.get("rgba"),
            ),
        )


def _keep_first_definitions(robot: ET.Element, report: ImportReport) -> dict[str, list[float]]:
    """Keep the first definition with a colour of each name among the robot's own materials, and remove the others.

    Materials without a name or without a colour are removed, too.

    Returns:
        the colours of the materials that are kept, by their names.
    """
    colours: dict[str, list[float]] = {}
    # A list, since materials are removed from the robot in this loop.
    for material in list(robot.iterfind("material")):
        name = name_of(material)
        rgba = _rgba(material)
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
                "is defined again with the colour {other}; the first colour, {first}, is used",
                other=format_numbers(rgba),
                first=format_numbers(colours[name]),
            )
        robot.remove(material)
        report.add(
            "dropped", message("robots.material_called", "material '{name}'", name=name), problem
        )
    return colours


def _repair_use(
    robot: ET.Element,
    visual: ET.Element,
    material: ET.Element,
    colours: dict[str, list[float]],
    report: ImportReport,
) -> None:
    """Repair the material of a visual, in place.

    Args:
        robot: the ``robot`` element. A material that is defined nowhere is added to it in DEFAULT_RGBA.
        visual: the visual. A material with neither a name nor a colour is removed from it.
        material: a material of the visual. If its name has another colour already, it gets a new name.
        colours: colours by name, to which those of the visual are added.
        report: report of the import.
    """
    name = name_of(material)
    rgba = _rgba(material)
    if not name:
        # A colour without a name is valid in a visual.
        if rgba is None:
            visual.remove(material)
            report.add(
                "dropped",
                message("importer.nameless_material", "material ''"),
                message("importer.neither_name_nor_colour", "has neither name nor colour"),
            )
        return
    if rgba is None:
        if name not in colours:
            # Recorded, so that the next use of the name is not undefined.
            colours[name] = DEFAULT_RGBA
            _define(robot, name, DEFAULT_RGBA)
            report.add(
                "defaulted",
                message("robots.material_called", "material '{name}'", name=name),
                message(
                    "importer.material_undefined",
                    "is not defined; a grey, {colour}, is used",
                    colour=format_numbers(DEFAULT_RGBA),
                ),
            )
        return
    # The first colour that a name gets is its definition, also if only a visual gives it.
    if colours.setdefault(name, rgba) == rgba:
        return
    # The same new name for each visual with this colour, so that a hundred visuals do not make a hundred materials.
    names_of_colour = (
        other
        for other, colour in colours.items()
        if colour == rgba and other.startswith(f"{name}_")
    )
    new = next(names_of_colour, None) or free_name(name, colours)
    colours[new] = rgba
    material.set("name", new)
    report.add(
        "repaired",
        message("robots.material_called", "material '{name}'", name=name),
        message(
            "importer.material_with_other_colour",
            "is also used with the colour {colour}; this use is renamed to '{new}'",
            colour=format_numbers(rgba),
            new=new,
        ),
    )


def _rgba(material: ET.Element) -> list[float] | None:
    """Read the numbers of a material's colour, red, green, blue and opacity. Returns None if it has no colour."""
    colour = material.find("color")
    return None if colour is None else [float(word) for word in colour.get("rgba", "").split()]
