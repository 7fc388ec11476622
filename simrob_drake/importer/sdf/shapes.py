"""The inertias, visuals and collision shapes of SDF, as a URDF has them."""

import xml.etree.ElementTree as ET

import numpy as np
from pydrake.math import RigidTransform

from simrob_drake.importer.options import ImportReport
from simrob_drake.importer.repairs.materials import DEFAULT_RGBA
from simrob_drake.importer.repairs.shape_elements import PLAIN
from simrob_drake.importer.sdf.frames import own_pose
from simrob_drake.robots.urdf import DRAKE, MOMENTS, add_colour, name_of, place, text
from simrob_drake.robots.urdf_check import numbers_in

_SIZES = {
    "box": ("box", {"size": "size"}),
    "sphere": ("sphere", {"radius": "radius"}),
    "cylinder": ("cylinder", {"radius": "radius", "length": "length"}),
    "capsule": (f"{DRAKE}capsule", {"radius": "radius", "length": "length"}),
    f"{DRAKE}capsule": (f"{DRAKE}capsule", {"radius": "radius", "length": "length"}),
    f"{DRAKE}ellipsoid": (f"{DRAKE}ellipsoid", {"a": "a", "b": "b", "c": "c"}),
}
"""By tag, that of a URDF, and where its attributes are."""
_DEFAULT_INERTIA = {"ixx": "1", "iyy": "1", "izz": "1"}
_COLOURS = {
    "grey": "0.7 0.7 0.7 1",
    "darkgrey": "0.175 0.175 0.175 1",
    "white": "1 1 1 1",
    "black": "0.05 0.05 0.05 1",
    "flatblack": "0.1 0.1 0.1 1",
    "red": "1 0 0 1",
    "green": "0 1 0 1",
    "blue": "0 0 1 1",
    "yellow": "1 1 0 1",
    "orange": "1 0.5088 0.0468 1",
    "purple": "1 0 1 1",
    "turquoise": "0 1 1 1",
    "gold": "0.8 0.65 0.12 1",
    "indigo": "0.33 0 0.5 1",
    "wood": "0.6 0.42 0.22 1",
}
"""Of the materials that Gazebo brings along, ``Gazebo/Grey`` and so on."""


def add_inertia(link: ET.Element, element: ET.Element, pose: RigidTransform, report: ImportReport) -> None:
    """Add the inertia of an SDF link, whose frame has a pose in the link; SDF's own default is 1 kg and 1 kg m²."""
    where, inertial = f"link '{name_of(link)}'", element.find("inertial")
    if inertial is not None and inertial.get("auto") == "true":
        report.add("dropped", where, "its inertia is to be made of its shapes; --estimate-inertia does that")
        return
    new = ET.SubElement(link, "inertial")
    place(new, pose @ own_pose(inertial, report, where))
    mass = None if inertial is None else inertial.findtext("mass")
    moments = None if inertial is None else inertial.find("inertia")
    ET.SubElement(new, "mass", value=(mass or "1").strip())
    values = {} if moments is None else {key: (moments.findtext(key) or "0").strip() for key in MOMENTS}
    ET.SubElement(new, "inertia", values or _DEFAULT_INERTIA)
    if mass is None or not values:
        defaults = " and ".join(["1 kg"] * (mass is None) + ["1 kg m²"] * (not values))
        report.add("defaulted", where, f"does not tell its inertia: {defaults}, as the format has it")


def add_shapes(link: ET.Element, element: ET.Element, pose: RigidTransform, report: ImportReport) -> None:
    """Add the visuals and collision shapes of an SDF link, whose frame has a pose in the link."""
    for tag in ("visual", "collision"):
        for shape in element.iterfind(tag):
            where = f"link '{name_of(link)}' <{tag}> '{name_of(shape)}'"
            geometry, problem = _geometry(shape)
            if geometry is None:
                report.add("dropped", where, problem)
                continue
            new = ET.SubElement(link, tag, name=name_of(shape))
            place(new, pose @ own_pose(shape, report, where))
            ET.SubElement(new, "geometry").append(geometry)
            if tag == "visual":
                _add_colour(new, geometry, shape)


def _geometry(shape: ET.Element) -> tuple[ET.Element | None, str]:
    """Return the shape as a URDF has it, or what is wrong."""
    geometry = shape.find("geometry/*")
    if geometry is None:
        return None, "has no shape"
    if geometry.tag == "mesh":
        if geometry.find("submesh") is not None:
            return None, f"a part of the mesh '{(geometry.findtext('uri') or '').strip()}'; only whole files are read"
        mesh = ET.Element("mesh", filename=(geometry.findtext("uri") or "").strip())
        scale = (geometry.findtext("scale") or "").strip()
        if scale and not np.array_equal(numbers_in(scale) or [], [1, 1, 1]):
            mesh.set("scale", scale)
        return mesh, ""
    if geometry.tag == "ellipsoid":
        radii = (geometry.findtext("radii") or "").split()
        return ET.Element(f"{DRAKE}ellipsoid", dict(zip("abc", radii, strict=False))), ""
    if geometry.tag not in _SIZES:
        is_ground = geometry.tag in ("plane", "heightmap")
        ground = "; a station has a floor and terrain of its own (floor:)" if is_ground else ""
        return None, f"<{geometry.tag}> is no shape of a robot{ground}"
    tag, sizes = _SIZES[geometry.tag]
    return ET.Element(tag, {key: (geometry.findtext(path) or "").strip() for key, path in sizes.items()}), ""


def _add_colour(visual: ET.Element, geometry: ET.Element, shape: ET.Element) -> None:
    """Add the colour of a visual; a mesh has its own look unless there is one."""
    material = shape.find("material")
    if material is None:
        return
    diffuse = numbers_in(material.findtext("diffuse") or material.findtext("ambient") or "") or []
    script = (material.findtext("script/name") or "").rpartition("/")[2].lower()
    named = _COLOURS.get(script) if len(diffuse) < len("rgb") else None
    rgba = [float(word) for word in named.split()] if named else [*diffuse, 1.0][:4] if diffuse else DEFAULT_RGBA
    if geometry.tag == "mesh":
        if not (named or diffuse):
            return
        geometry.set(PLAIN, "true")
    add_colour(visual, text(rgba), rgba)
