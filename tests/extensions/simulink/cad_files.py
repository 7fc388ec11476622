"""Small CAD assemblies in the shape of the real export, and geometry files for their parts."""

from pathlib import Path

import numpy as np
from pydrake.math import RigidTransform

_FILE = """<?xml version="1.0" encoding="UTF-8"?>
<SimscapeMultibodyImportXML version="2.0" xmlns="urn:mathworks:SimscapeMultibody:import">
<Created by="us" on="01/01/26||00:00:00" using="our own hands" from="CAD 1.0"/>
<ModelUnits mass="gram" length="{length}"/>
<DataUnits mass="{mass}" length="{length}"/>
<RootAssembly name="whole" uid="whole" version="1">
<AssemblyFile name="whole.asm" type="Assembly"/>
<InstanceTree>{instances}</InstanceTree>
{ties}
</RootAssembly>
<Assemblies>{assemblies}</Assemblies>
<Parts>{parts}</Parts>
</SimscapeMultibodyImportXML>
"""


def row(values) -> str:
    return " ".join(repr(float(value)) for value in np.asarray(values).reshape(-1))


def transform(pose: RigidTransform) -> str:
    turn, place = row(pose.rotation().matrix()), row(pose.translation())
    return f"<Transform><Rotation>{turn}</Rotation><Translation>{place}</Translation></Transform>"


def instance(uid: str, entity: str, pose=None, inner: str = "", **attributes: str) -> str:
    said = "".join(f' {key}="{value}"' for key, value in attributes.items())
    place = transform(pose or RigidTransform())
    return (
        f'<Instance name="{uid}" uid="{uid}" entityUid="{entity}"{said}>{place}{inner}</Instance>'
    )


def part(uid: str, *, mass=1.0, com=(0, 0, 0), inertia=(1, 1, 1, 0, 0, 0), file: str = "") -> str:
    weighs = f"<Mass>{mass}</Mass><CenterOfMass>{row(com)}</CenterOfMass><Inertia>{row(inertia)}</Inertia>"
    look = '<VisualProperties><Diffuse r="1" g="0.5" b="0" a="1"/></VisualProperties>'
    geometry = (
        f'<GeometryFile name="{file}" type="{Path(file).suffix[1:].upper()}"/>' if file else ""
    )
    return (
        f'<Part name="{uid}" uid="{uid}"><ModelUnits mass="gram" length="millimeter"/>'
        f"<MassProperties>{weighs}</MassProperties>{geometry}{look}</Part>"
    )


def path(*uids: str) -> str:
    return f"<InstancePath>{''.join(f'<Uid>{uid}</Uid>' for uid in uids)}</InstancePath>"


def joint(kind: str, name: str, base, follower) -> str:
    """Join frames, each a list of identifiers and a pose in that instance."""
    ends = zip(("BaseFrame", "FollowerFrame"), (base, follower), strict=True)
    inner = "".join(f"<{tag}>{path(*uids)}{transform(pose)}</{tag}>" for tag, (uids, pose) in ends)
    return f'<{kind} name="{name}">{inner}</{kind}>'


def constraint(kind: str, name: str, *ends) -> str:
    """Join geometries, each a list of identifiers, a type, a place and an axis."""
    inner = "".join(
        f'<ConstraintGeometry geomType="{shape}">{path(*uids)}<Position>{row(place)}</Position>'
        f"<Axis>{row(axis)}</Axis></ConstraintGeometry>"
        for uids, shape, place, axis in ends
    )
    return f'<{kind} name="{name}">{inner}</{kind}>'


def write_cad(
    file: Path,
    *,
    instances,
    parts,
    joints="",
    constraints="",
    assemblies="",
    mass="kilogram",
    length="meter",
) -> Path:
    ties = f"<Constraints>{constraints}</Constraints><Joints>{joints}</Joints>"
    content = {"instances": instances, "ties": ties, "assemblies": assemblies, "parts": parts}
    file.write_text(_FILE.format(**content, mass=mass, length=length), encoding="utf-8")
    return file


def write_step_box(file: Path, size) -> Path:
    """Write a box from the origin to ``size`` [mm] as a STEP file of plane faces."""
    corners = [(x, y, z) for x in (0.0, size[0]) for y in (0.0, size[1]) for z in (0.0, size[2])]
    # seen from outside
    faces = [
        (0, 1, 3, 2),
        (4, 6, 7, 5),
        (0, 4, 5, 1),
        (2, 3, 7, 6),
        (0, 2, 6, 4),
        (1, 5, 7, 3),
    ]
    lines: list[str] = []

    def add(text: str) -> str:
        lines.append(f"#{len(lines) + 1}={text};")
        return f"#{len(lines)}"

    def given(kind: str, values) -> str:
        return add(f"{kind}('',({','.join(f'{float(value)}' for value in values)}))")

    points = [given("CARTESIAN_POINT", corner) for corner in corners]
    vertices = [add(f"VERTEX_POINT('',{point})") for point in points]
    edges: dict[tuple[int, int], str] = {}
    made = []
    for face in faces:
        loop = []
        for start, end in zip(face, (*face[1:], face[0]), strict=True):
            if (end, start) not in edges:
                along = np.subtract(corners[end], corners[start])
                length = float(np.linalg.norm(along))
                vector = add(f"VECTOR('',{given('DIRECTION', along / length)},{length})")
                line = add(f"LINE('',{points[start]},{vector})")
                edges[start, end] = add(
                    f"EDGE_CURVE('',{vertices[start]},{vertices[end]},{line},.T.)"
                )
            forward = (start, end) in edges
            edge = edges[start, end] if forward else edges[end, start]
            loop.append(add(f"ORIENTED_EDGE('',*,*,{edge},.{'T' if forward else 'F'}.)"))
        one, other = (np.subtract(corners[face[k]], corners[face[0]]) for k in (1, 2))
        normal = np.cross(one, other)
        axes = [given("DIRECTION", vector / np.linalg.norm(vector)) for vector in (normal, one)]
        frame = add(f"AXIS2_PLACEMENT_3D('',{points[face[0]]},{','.join(axes)})")
        ring = add(f"EDGE_LOOP('',({','.join(loop)}))")
        bound, plane = add(f"FACE_OUTER_BOUND('',{ring},.T.)"), add(f"PLANE('',{frame})")
        made.append(add(f"ADVANCED_FACE('',({bound}),{plane},.T.)"))
    shell = add(f"CLOSED_SHELL('',({','.join(made)}))")
    solid = add(f"MANIFOLD_SOLID_BREP('',{shell})")
    units = [add(f"({text})") for text in (
        "LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT(.MILLI.,.METRE.)", "NAMED_UNIT(*) PLANE_ANGLE_UNIT() SI_UNIT($,.RADIAN.)",
        "NAMED_UNIT(*) SI_UNIT($,.STERADIAN.) SOLID_ANGLE_UNIT()",
    )]  # fmt: skip
    near = add(f"UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE(1.E-05),{units[0]},'','')")
    context = add(
        f"(GEOMETRIC_REPRESENTATION_CONTEXT(3) GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT(({near})) "
        f"GLOBAL_UNIT_ASSIGNED_CONTEXT(({','.join(units)})) REPRESENTATION_CONTEXT('',''))"
    )
    shape = add(f"ADVANCED_BREP_SHAPE_REPRESENTATION('',({solid}),{context})")
    use = add("APPLICATION_CONTEXT('')")
    place = add(f"PRODUCT_CONTEXT('',{use},'mechanical')")
    product = add(f"PRODUCT('box','box','',({place}))")
    formation = add(f"PRODUCT_DEFINITION_FORMATION('','',{product})")
    design = add(f"PRODUCT_DEFINITION_CONTEXT('part definition',{use},'design')")
    definition = add(f"PRODUCT_DEFINITION('','',{formation},{design})")
    whole = add(f"PRODUCT_DEFINITION_SHAPE('','',{definition})")
    add(f"SHAPE_DEFINITION_REPRESENTATION({whole},{shape})")
    header = [
        "FILE_DESCRIPTION((''),'2;1');",
        "FILE_NAME('','',(''),(''),'','','');",
        "FILE_SCHEMA(('AUTOMOTIVE_DESIGN'));",
    ]
    text = [
        "ISO-10303-21;",
        "HEADER;",
        *header,
        "ENDSEC;",
        "DATA;",
        *lines,
        "ENDSEC;",
        "END-ISO-10303-21;",
        "",
    ]
    file.write_text("\n".join(text), encoding="utf-8")
    return file
