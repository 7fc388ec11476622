"""Make roid1's URDF and meshes: ``python models/making/roid1.py``.

Joints and outer sizes of the links are those of roid1 by Ninagawa123 (URDF of 2021, MIT licence), which the thesis of
C. Sánchez-Girón Coca (Universidad de Valladolid, 2022, p. 86-87 and 92) uses; masses and inertias are those that the
author published later. The forms are ours. It faces +x, its left is +y; all frames are parallel at zero.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from rounded import Parts, block, drum, hull, mirrored_parts, write_parts
from urdf_writing import Joint, Link, Shape, box, write_urdf

COMMENT = """
  roid1 (Ninagawa123): 22 joints, 1.4585 kg, 0.40 m. It faces +x; all frames are parallel at zero.
  Joint places, sizes, masses and inertias are the published figures (inertias rounded there to 1e-6 kg m2). Ours are:
  - efforts 1.5 N m and 7.5 rad/s: about what its servos (KRS-2552, 11.1 V) give; the file has zeros.
  - ranges: those of a human, where the file has the placeholder of 3 rad everywhere.
  - damping 0.01 N m s/rad: an estimate of the gears' losses, a sixtieth of the servos' own damping.
  - waist: its centre of mass is published from the floor up; here from its frame, and on the middle plane.
  - chest: one body of three; the third's centre, published 44 mm above the chest, is taken from the waist's height,
    65 mm lower, since only so it lies inside the shell.
  - head: its centre of mass is published 23 mm above its joint, outside of it; here in the middle of its height.
"""
EFFORT, VELOCITY, DAMPING = 1.5, 7.5, 0.01  # N·m, rad/s, N·m·s/rad

COLOURS = {
    "light_grey": (0.9, 0.9, 0.9, 1),
    "dark_grey": (0.2, 0.205, 0.22, 1),
    "orange": (0.96, 0.5, 0.1, 1),
    "light_blue": (0.4, 0.8, 1.0, 1),
}

# name: parent, child, origin of the right side, axis, range of the right side [deg] in the joint's own sense. The left
# side is the mirror image: y, and the sense of rolls and yaws, change their signs.
MIDDLE = {
    "c_chest_yaw": ("c_waist", "c_chest", (0, 0, 0.065192), "z", (-90, 90)),
    "c_head_yaw": ("c_chest", "c_head", (0, 0, 0.039505), "z", (-90, 90)),
}
ARM = {
    "shoulder_pitch": ("c_chest", "shoulder", (0, -0.074375, 0), "y", (-180, 90)),
    "shoulder_roll": ("shoulder", "upperarm", (0, 0, 0), "x", (-170, 10)),
    "elbow_yaw": ("upperarm", "elbow", (0.004449, 0, -0.087511), "z", (-90, 90)),
    "elbow_pitch": ("elbow", "lowerarm", (0.004698, 0, 0), "y", (-130, 130)),
}
LEG = {
    "hipjoint_yaw": ("c_waist", "hipjointupper", (0, -0.02153, -0.044936), "z", (-60, 60)),
    "hipjoint_roll": ("hipjointupper", "hipjointlower", (0, 0.004501, 0), "x", (-60, 40)),
    "hipjoint_pitch": (
        "hipjointlower",
        "upperleg",
        (0.004052, -0.011504, -0.038476),
        "y",
        (-110, 60),
    ),
    "knee_pitch": ("upperleg", "lowerleg", (0, 0, -0.065008), "y", (-5, 130)),
    "ankle_pitch": ("lowerleg", "ankle", (0, 0, -0.065203), "y", (-80, 80)),
    "ankle_roll": ("ankle", "foot", (0, 0.011404, -0.03855), "x", (-45, 60)),
}

# link: mass, centre of mass, moments, products; of the right side.
MIDDLE_INERTIAS = {
    "c_waist": (0.1340821, (-0.00049, 0, -0.00397), (6.3e-05, 3.6e-05, 6.8e-05), (0, 0, 0)),
    "c_chest": (
        0.29548641,
        (-0.0075533, 0, -0.0117005),
        (0.0003523, 0.000228, 0.0003587),
        (0, 3.376e-05, 0),
    ),
    "c_head": (0.01277886, (0.003079, 0, -0.001), (2e-06, 4e-06, 3e-06), (0, 0, 0)),
}
INERTIAS = {
    "shoulder": (0.01212037, (0.0001694, -0.0087474, 0), (1e-06, 4e-06, 4e-06), (0, 0, 0)),
    "upperarm": (
        0.09077338,
        (-0.0225653, 0, -0.0356459),
        (5.4e-05, 6.4e-05, 1.8e-05),
        (0, -1e-05, 0),
    ),
    "elbow": (0.04477127, (5.75e-05, 0, -0.0125749), (6e-06, 8e-06, 1e-05), (0, 0, 0)),
    "lowerarm": (
        0.02983803,
        (0.0001764, 0.0156923, -0.0456965),
        (1.8e-05, 1.6e-05, 4e-06),
        (0, 0, 0),
    ),
    "hipjointupper": (
        0.005702042,
        (3.29e-05, 0.0011113, -0.0074002),
        (1e-06, 2e-06, 2e-06),
        (0, 0, 0),
    ),
    "hipjointlower": (
        0.06689533,
        (-0.0162502, -0.0114633, -0.0066539),
        (2e-05, 1.4e-05, 1.5e-05),
        (0, 0, 0),
    ),
    "upperleg": (
        0.09097466,
        (0.0025898, 0.0165, -0.0337557),
        (5.9e-05, 5.6e-05, 1.3e-05),
        (0, 4e-06, 0),
    ),
    "lowerleg": (
        0.06094435,
        (0.0044806, 0.0159700, -0.0418210),
        (2.9e-05, 2.6e-05, 1.1e-05),
        (0, -5e-06, 0),
    ),
    "ankle": (0.06757552, (0.0001886, 0.0166638, -0.0329297), (2e-05, 1.4e-05, 1.6e-05), (0, 0, 0)),
    "foot": (
        0.03847105,
        (-0.0207002, -0.0238953, -0.0212445),
        (2.3e-05, 4.8e-05, 6.9e-05),
        (0, 0, 0),
    ),
}
SOLE = (
    (0.1218, 0.07801, 0.012),
    (-0.00633, -0.02859, -0.01993),
)  # size, centre in the right foot's link

COLLISIONS: dict[str, list[Shape]] = {
    "c_chest": [box((0.1204, 0.105, 0.0856), (-0.0294, 0, -0.0113))],
    "c_head": [box((0.049, 0.03, 0.037), (0.0024, 0, -0.001))],
    "c_waist": [box((0.055, 0.068, 0.056), (-0.006, 0, 0.006))],
    "shoulder": [box((0.049, 0.036, 0.028))],
    "upperarm": [box((0.06, 0.02, 0.087), (-0.0015, 0, -0.0345))],
    "lowerarm": [box((0.03, 0.036, 0.10), (-0.002, 0, -0.05))],
    "upperleg": [box((0.045, 0.034, 0.08), (0.0025, 0, -0.03))],
    "lowerleg": [box((0.035, 0.037, 0.08), (0.0095, 0, -0.033))],
    "foot": [box(*SOLE)],
}  # of the right side


def c_waist() -> Parts:
    """Pelvis with the waist servo."""
    pan = block((-0.032, -0.032, -0.0217), (0.009, 0.032, 0.008), 0.004)
    post = block((-0.0185, -0.0105, 0.002), (0.0225, 0.0105, 0.0345), 0.003)
    belt = block((-0.0345, -0.0345, -0.004), (0.0115, 0.0345, 0.006), 0.003)
    return {"dark_grey": [pan, post], "light_grey": [belt]}


def c_chest() -> Parts:
    """Shell with a battery pack behind, and an orange badge."""
    front = hull(
        [
            (x, y, z)
            for x, y in ((0.0228, 0.031), (-0.040, 0.0445))
            for y in (-y, y)
            for z in (-0.030, 0.0235)
        ],
        0.008,
    )
    pack = block((-0.0896, -0.0430, -0.0541), (-0.036, 0.0430, 0.0120), 0.008)
    frame = block((-0.032, -0.0545, -0.0165), (0.0117, 0.0545, 0.0165), 0.004)
    badge = block((0.0285, -0.014, -0.0105), (0.0318, 0.014, 0.0045), 0.0015)
    vents = [
        block((-0.0912, -0.026, z), (-0.080, 0.026, z + 0.005), 0.0015)
        for z in (-0.040, -0.028, -0.016)
    ]
    return {
        "light_grey": [front, pack],
        "dark_grey": [frame, *vents, drum(0.014, (0.02, 0.0345), fillet=0.003)],
        "orange": [badge],
    }


def c_head() -> Parts:
    """Small head with a visor and a bar of light for eyes."""
    skull = hull(
        [(x, y, z) for x in (-0.0151, 0.0155) for y in (-0.008, 0.008) for z in (-0.0105, 0.0106)],
        0.007,
    )
    visor = block((0.012, -0.0145, -0.0005), (0.0258, 0.0145, 0.0135), 0.003)
    eyes = block((0.0235, -0.0128, 0.0043), (0.0264, 0.0128, 0.0089), 0.0012)
    return {"light_grey": [skull], "dark_grey": [visor], "light_blue": [eyes]}


def shoulder() -> Parts:
    """Bracket with an orange cap in front and behind."""
    body = block((-0.0223, -0.0204, -0.014), (0.0233, 0.0176, 0.014), 0.0055)
    caps = [drum(0.0062, (-0.0236, 0.0246), "x", (0, 0, 0), 0.001)]
    return {"light_grey": [body], "orange": caps}


def upperarm() -> Parts:
    """Servo between two orange-capped arms."""
    servo = block((-0.0323, -0.0105, -0.0595), (0.0135, 0.0105, -0.016), 0.003)
    arms = [
        block((x, -0.0085, -0.05), (x + 0.0045, 0.0085, 0.009), 0.002) for x in (-0.0290, 0.0245)
    ]
    bar = block((-0.0290, -0.0085, -0.056), (0.029, 0.0085, -0.0465), 0.002)
    horn = drum(0.009, (-0.078, -0.055), "z", (0.0044, 0, 0))
    return {"dark_grey": [servo, horn], "light_grey": [*arms, bar]}


def elbow() -> Parts:
    """Servo that turns the fore-arm."""
    return {"dark_grey": [block((-0.0276, -0.0186, -0.0225), (0.0135, 0.0195, 0.0104), 0.003)]}


def lowerarm() -> Parts:
    """Fork about the elbow and a mitten."""
    fork = [
        block((-0.0125, y, -0.052), (0.0125, y + 0.0045, 0.0104), 0.002) for y in (-0.0240, 0.0195)
    ]
    mitten = hull(
        [
            (-0.008, -0.0125, -0.045),
            (-0.008, 0.0125, -0.045),
            (0.006, -0.0125, -0.045),
            (0.006, 0.0125, -0.045),
            (-0.002, -0.007, -0.09),
            (-0.002, 0.007, -0.09),
        ],
        0.0105,
    )
    cuff = block((-0.0165, -0.0215, -0.057), (0.0145, 0.0215, -0.047), 0.003)
    return {"light_grey": [mitten, *fork], "orange": [cuff]}


def hipjointupper() -> Parts:
    """Bracket under the waist."""
    body = block((-0.0259, -0.0165, -0.0148), (0.0216, 0.0105, 0.0227), 0.005)
    return {
        "light_grey": [body],
        "orange": [drum(0.0055, (-0.0268, 0.0225), "x", (0, 0.0045, 0), 0.001)],
    }


def hipjointlower() -> Parts:
    """Two crossed servos of the hip."""
    roll = block((-0.019, -0.0155, -0.029), (0.0191, 0.0103, 0.0105), 0.003)
    pitch = block((-0.0145, -0.0303, -0.0484), (0.0191, 0.0073, -0.0265), 0.003)
    return {"dark_grey": [roll, pitch]}


def upperleg() -> Parts:
    """Thigh: a shell about its servo."""
    shell = hull(
        [
            (x, y, z)
            for x, z in ((-0.0115, 0.0065), (0.0165, 0.0065), (-0.0095, -0.058), (0.0155, -0.058))
            for y in (-0.0085, 0.0085)
        ],
        0.0082,
    )
    hub = drum(0.0115, (-0.0195, 0.0195), "y", (0, 0, 0))
    knee = drum(0.0120, (-0.0190, 0.0190), "y", (0, 0, -0.065008))
    return {"light_grey": [shell], "dark_grey": [hub, knee]}


def lowerleg() -> Parts:
    """Shank with an orange shin."""
    shell = hull(
        [
            (x, y, z)
            for x, z in ((0.0, -0.008), (0.0185, -0.008), (0.0005, -0.055), (0.0135, -0.055))
            for y in (-0.0095, 0.0095)
        ],
        0.0082,
    )
    shin = hull([(0.0225, y, z) for y in (-0.007, 0.007) for z in (-0.014, -0.044)], 0.0048)
    ankle = drum(0.0112, (-0.0190, 0.0190), "y", (0, 0, -0.065203))
    return {"light_grey": [shell], "orange": [shin], "dark_grey": [ankle]}


def ankle() -> Parts:
    """Two crossed servos of the ankle."""
    pitch = block((-0.0145, -0.0163, -0.0225), (0.0165, 0.0203, 0.0105), 0.003)
    roll = block((-0.0185, -0.0075, -0.049), (0.0196, 0.0300, -0.0205), 0.003)
    return {"dark_grey": [pitch, roll]}


def foot() -> Parts:
    """Wide sole with a bracket for the ankle."""
    sole = block((-0.0672, -0.0676, -0.02593), (0.0546, 0.0104, -0.0195), 0.0028)
    top = hull(
        [
            (-0.054, -0.057, -0.0165),
            (-0.054, 0.0, -0.0165),
            (0.042, -0.057, -0.0165),
            (0.042, 0.0, -0.0165),
        ],
        0.0055,
    )
    posts = [
        block((x, -0.0125, -0.020), (x + 0.0042, 0.0095, 0.0102), 0.0018) for x in (-0.0242, 0.0200)
    ]
    return {"dark_grey": [sole], "light_grey": [top, *posts]}


def make(folder: Path) -> None:
    """Write the URDF and its meshes into a folder."""
    links, joints = [], []
    for form in (c_waist, c_chest, c_head):
        name = form.__name__
        links.append(_link(name, MIDDLE_INERTIAS[name], write_parts(folder, name, form()), 1))
    joints += [_joint(name, figures, 1, "") for name, figures in MIDDLE.items()]
    forms = (
        shoulder,
        upperarm,
        elbow,
        lowerarm,
        hipjointupper,
        hipjointlower,
        upperleg,
        lowerleg,
        ankle,
        foot,
    )
    for side, sign in (("r", 1), ("l", -1)):
        for form in forms:
            parts = form()
            if sign < 0:
                parts = mirrored_parts(parts, "y")
            name = f"{side}_{form.__name__}"
            links.append(
                _link(name, INERTIAS[form.__name__], write_parts(folder, name, parts), sign)
            )
        joints += [_joint(name, figures, sign, side) for name, figures in {**ARM, **LEG}.items()]
        for tool, link, place in (
            ("hand", "lowerarm", (-0.002, 0, -0.101)),
            ("sole", "foot", (0, 0, -0.02593)),
        ):
            links.append(Link(name=f"{side}_{tool}"))
            joints.append(
                Joint(
                    name=f"{side}_{tool}_fixed",
                    parent=f"{side}_{link}",
                    child=f"{side}_{tool}",
                    xyz=place,
                )
            )
    write_urdf(folder / "roid1.urdf", comment=COMMENT, colours=COLOURS, links=links, joints=joints)


def _link(name: str, figures: tuple, visuals: list[tuple[Shape, str]], sign: int) -> Link:
    mass, (x, y, z), moments, (xy, xz, yz) = figures
    shape = name.removeprefix("r_").removeprefix("l_")
    collisions = [
        replace(each, xyz=(each.xyz[0], sign * each.xyz[1], each.xyz[2]))
        for each in COLLISIONS.get(shape, [])
    ]
    com, products = (x, sign * y, z), (sign * xy, xz, sign * yz)
    return Link(
        name=name,
        mass=mass,
        com=com,
        moments=moments,
        products=products,
        visuals=visuals,
        collisions=collisions,
    )


def _joint(name: str, figures: tuple, sign: int, side: str) -> Joint:
    parent, child, (x, y, z), axis, (low, high) = figures
    if side:
        name, child = f"{side}_{name}", f"{side}_{child}"
        parent = parent if parent.startswith("c_") else f"{side}_{parent}"
    if sign < 0 and axis != "y":
        low, high = -high, -low
    return Joint(
        name=name,
        parent=parent,
        child=child,
        xyz=(x, sign * y, z),
        axis=[float(letter == axis) for letter in "xyz"],
        range=(np.deg2rad(low), np.deg2rad(high)),
        effort=EFFORT,
        velocity=VELOCITY,
        damping=DAMPING,
    )


if __name__ == "__main__":
    make(Path(__file__).parents[1] / "roid1")
