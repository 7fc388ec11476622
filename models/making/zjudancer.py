"""Make zjudancer's URDF and meshes: ``python models/making/zjudancer.py``.

The kid-size humanoid of the ZJUDancer team. Masses and leg lengths are those of the team's motion code (upper body
3.0 kg, a leg 0.85 kg, thigh 0.123 m, shank 0.130 m, ankle 0.060 m over the floor, half hip width 0.045 m, foot 0.087 by
0.147 m); the other figures come from a public URDF of the robot with the 18 joints that the thesis numbers
(C. Sánchez-Girón Coca, Universidad de Valladolid, 2022, p. 87-92). The forms are ours. It faces +y, its right is +x.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from rounded import Parts, block, drum, hull, mirrored, mirrored_parts, wedge, write_parts
from urdf_writing import Joint, Link, Shape, box, sphere, write_urdf

COMMENT = """
  ZJUDancer, kid size: 18 joints, 4.7 kg, 0.69 m. It faces +y, its right is +x; all frames are parallel at zero.
  - Legs: lengths of the team's motion code; the axes of a hip meet in a point, those of an ankle, too, and all lie in
    one plane, where the public URDF is off by up to 0.4 degrees and 2 mm.
  - Masses: the public URDF has 2.575 kg, motors and batteries apart it seems, the team's code 4.7 kg. Here the legs'
    masses and inertias are those of the URDF times 1.385, which makes 0.85 kg a leg; neck, head and arms, of the same
    motors, likewise, and the chest has the rest of the 3.0 kg, with its inertia scaled by its mass.
  - Reflected inertia 0.004 kg m2 a joint: an estimate for servos of this size; with it the robot was seen to walk.
  - Efforts: 10 N m in the legs, 7 in the shoulders, 3 in elbows and head; 20 rad/s; damping as in the public URDF.
  - Ranges: those of a human, where the file has a full turn. Joint friction, which Drake does not know, is left out.
"""
VELOCITY, REFLECTED = 20.0, 0.004  # rad/s, kg m²
SMALL, LARGE = 0.0347, 0.0414  # damping of the two kinds of servo [N·m·s/rad]
MIDDLE_Y = 0.0134  # the plane of head, arms and legs before the chest's frame [m]

COLOURS = {
    "racing_blue": (0.11, 0.33, 0.73, 1),
    "aluminium": (0.78, 0.8, 0.83, 1),
    "servo_black": (0.15, 0.155, 0.17, 1),
    "lens": (0.95, 0.75, 0.2, 1),
}

# joint: parent, child, origin of the right side, axis, range [deg] in the joint's own sense, effort, damping. The left
# side is the mirror image: x changes its sign, and so does the axis of rolls, so that they turn outward on both sides.
HEAD = {
    "head_yaw": ("chest", "neck", (0, MIDDLE_Y, 0.02075), (0, 0, 1), (-120, 120), 3, SMALL),
    "head_pitch": ("neck", "head", (0, 0, 0.0438), (-1, 0, 0), (-60, 75), 3, SMALL),
}
SIDE = {
    "arm_upper": ("chest", "arm", (0.0747, MIDDLE_Y, 0), (1, 0, 0), (-90, 180), 7, SMALL),
    "arm_lower": ("arm", "hand", (0.05105, 0, -0.136), (1, 0, 0), (-5, 150), 3, SMALL),
    "hip_yaw": ("chest", "leg_yaw", (0.045, MIDDLE_Y, -0.16995), (0, 0, -1), (-90, 90), 10, SMALL),
    "hip_roll": ("leg_yaw", "leg_roll", (0, 0, -0.05505), (0, -1, 0), (-35, 60), 10, SMALL),
    "hip_pitch": ("leg_roll", "leg_pitch", (0, 0, 0), (1, 0, 0), (-60, 115), 10, LARGE),
    "knee": ("leg_pitch", "leg_knee", (0, 0, -0.123), (-1, 0, 0), (-5, 140), 10, LARGE),
    "ankle_pitch": ("leg_knee", "leg_ankle", (0, 0, -0.130), (1, 0, 0), (-80, 80), 10, LARGE),
    "ankle_roll": ("leg_ankle", "foot", (0, 0, 0), (0, 1, 0), (-60, 45), 10, SMALL),
}
MIRRORED_AXES = ("hip_roll", "ankle_roll")

# link: mass, centre of mass, moments; of the public URDF, turned into parallel frames, of the right side.
MIDDLE = {
    "chest": (0.881925, (0, -0.0045, -0.0571), (4.635e-4, 6.276e-4, 5.702e-4)),
    "neck": (0.05495974, (0, 0, 0.026), (1.155e-5, 1.382e-5, 1.003e-5)),
    "head": (0.0803704, (0, 0.0013, 0.0516), (3.65e-5, 4.556e-5, 2.085e-5)),
}
INERTIAS = {
    "arm": (0.1408805, (0.0291, -0.0019, -0.0808), (1.2e-4, 1.231e-4, 2.075e-5)),
    "hand": (0.02404427, (0, 0, -0.0636), (5.189e-5, 4.998e-5, 1.95e-6)),
    "leg_yaw": (0.05866202, (0, 0.0032, -0.0298), (3.05e-5, 1.169e-5, 3.041e-5)),
    "leg_roll": (0.1767522, (0, -0.0183, -0.014), (6.179e-5, 6.589e-5, 3.903e-5)),
    "leg_pitch": (0.02788773, (0, 0, -0.0356), (1.372e-5, 1.146e-5, 2.42e-6)),
    "leg_knee": (0.03281921, (0, 0, -0.0844), (4.497e-5, 4.307e-5, 1.95e-6)),
    "leg_ankle": (0.1739482, (0, -0.016, 0.0143), (6.153e-5, 6.577e-5, 3.883e-5)),
    "foot": (0.1434286, (0.0157, 0, -0.045), (1.4142e-4, 5.055e-5, 1.8366e-4)),
}
SCALE = 0.85 / sum(
    INERTIAS[link][0] for link in INERTIAS if link not in ("arm", "hand")
)  # of all but the chest
CHEST = 3.0 - SCALE * sum(
    figures[0] * (2 if link in INERTIAS else 1)
    for link, figures in {**MIDDLE, **INERTIAS}.items()
    if link in ("neck", "head", "arm", "hand")
)  # kg
SOLE = ((0.087, 0.147, 0.012), (0.016, 0, -0.054))  # size, centre in the right foot's link

COLLISIONS: dict[str, list[Shape]] = {
    "chest": [box((0.12, 0.09, 0.165), (0, 0, -0.06))],
    "head": [sphere(0.036, (0, 0, 0.054))],
    "arm": [box((0.05, 0.04, 0.17), (0.0255, 0, -0.066))],
    "hand": [box((0.026, 0.03, 0.13), (0, 0, -0.07))],
    "leg_roll": [box((0.055, 0.076, 0.054), (0, -0.014, -0.007))],
    "leg_pitch": [box((0.06, 0.04, 0.11), (0, 0, -0.062))],
    "leg_knee": [box((0.06, 0.044, 0.11), (0, 0, -0.065))],
    "foot": [box(*SOLE)],
}  # of the right side


def chest() -> Parts:
    """Blue shell that narrows to the waist, computer on the back, pelvis plate under it."""
    shell = wedge(
        [
            (x, y, z)
            for x, z in ((0.061, 0.018), (0.061, -0.055), (0.044, -0.125))
            for y in (-0.040, 0.046)
        ],
        0.012,
    )
    axle = drum(0.0165, (-0.069, 0.069), "x", (0, MIDDLE_Y, 0))
    pack = block((-0.044, -0.058, -0.105), (0.044, -0.030, 0.008), 0.008)
    emblem = wedge(
        [
            (0.030, 0.048, -0.015),
            (0.030, 0.048, -0.040),
            (0.008, 0.048, -0.075),
            (0.020, 0.03, -0.04),
        ],
        0.004,
    )
    pelvis = block((-0.076, -0.026, -0.172), (0.076, 0.052, -0.160), 0.005)
    column = block((-0.034, -0.020, -0.168), (0.034, 0.040, -0.115), 0.006)
    return {
        "racing_blue": [shell],
        "servo_black": [axle, pack, column],
        "aluminium": [emblem, pelvis],
    }


def neck() -> Parts:
    """Servo of the head's pitch on that of its yaw."""
    servo = block((-0.0205, -0.021, 0.010), (0.0205, 0.021, 0.056), 0.004)
    return {"servo_black": [servo], "aluminium": [drum(0.017, (-0.002, 0.012))]}


def head() -> Parts:
    """Helmet with a dark visor and one camera."""
    helmet = hull(
        [(x, y, z) for x in (-0.012, 0.012) for y in (-0.010, 0.006) for z in (0.045, 0.062)],
        0.0305,
    )
    visor = hull([(x, 0.0185, z) for x in (-0.019, 0.019) for z in (0.047, 0.060)], 0.0195)
    camera = drum(0.0095, (0.034, 0.0405), "y", (0, 0, 0.054), 0.002)
    ears = drum(0.013, (-0.0445, 0.0445), "x", (0, 0, 0.0505), 0.003)
    return {"racing_blue": [helmet], "servo_black": [visor], "lens": [camera], "aluminium": [ears]}


def arm() -> Parts:
    """Shoulder servo and sleeve; the elbow lies outside of the shoulder."""
    hub = drum(0.020, (0.0, 0.012), "x", (0, 0, 0))
    servo = block((0.010, -0.0205, -0.100), (0.044, 0.0165, -0.042), 0.005)
    sleeve = hull(
        [(0.0165, 0, 0), (0.0165, 0, 0.004), (0.0325, 0.004, -0.105), (0.0325, -0.006, -0.105)],
        0.0155,
    )
    elbow = drum(0.017, (-0.024, 0.0), "x", (0.05105, 0, -0.136))
    link = hull([(0.0335, 0, -0.100), (0.0390, 0, -0.136)], 0.012)
    return {"aluminium": [hub, link], "racing_blue": [sleeve], "servo_black": [servo, elbow]}


def hand() -> Parts:
    """Fore-arm with a soft end."""
    bar = hull([(0, 0.006, -0.002), (0, -0.006, -0.002), (0, 0.0, -0.105)], 0.0125)
    end = hull([(0, 0, -0.112), (0, 0, -0.128)], 0.0155)
    return {"aluminium": [bar], "servo_black": [end, drum(0.015, (-0.014, 0.014), "x")]}


def leg_yaw() -> Parts:
    """Bracket that turns under the pelvis."""
    plate = drum(0.026, (-0.012, 0.0), "z", fillet=0.003)
    arch = [
        block((-0.0215, y, -0.066), (0.0215, y + 0.005, -0.006), 0.002) for y in (-0.031, 0.030)
    ]
    bar = block((-0.0205, -0.031, -0.016), (0.0205, 0.035, -0.009), 0.003)
    return {"aluminium": [plate, *arch, bar]}


def leg_roll() -> Parts:
    """Servos of roll and pitch."""
    roll = block((-0.0205, -0.052, -0.028), (0.0205, 0.024, 0.020), 0.005)
    pitch = block((-0.0275, -0.0225, -0.034), (0.0275, 0.018, 0.016), 0.005)
    return {"servo_black": [roll, pitch]}


def leg_pitch() -> Parts:
    """Thigh: two side plates and a bridge."""
    side = hull([(0.0310, 0, 0), (0.0310, 0, -0.123)], 0.0030)
    plate = block((0.0285, -0.0165, -0.135), (0.0335, 0.0165, 0.014), 0.0024)
    discs = [drum(0.0185, (0.0280, 0.0350), "x", (0, 0, z)) for z in (0.0, -0.123)]
    bridge = block((-0.0300, -0.0125, -0.082), (0.0300, 0.0190, -0.045), 0.006)
    return {
        "aluminium": [side, plate, mirrored(plate), *discs, *(mirrored(d) for d in discs)],
        "racing_blue": [bridge],
    }


def leg_knee() -> Parts:
    """Shank: side plates, servo of the knee and a shin guard."""
    knee = block((-0.0265, -0.0225, -0.034), (0.0265, 0.0185, 0.0165), 0.005)
    plate = block((0.0275, -0.0160, -0.142), (0.0315, 0.0160, 0.0), 0.0019)
    shin = hull([(x, 0.0165, z) for x in (-0.0195, 0.0195) for z in (-0.040, -0.092)], 0.0085)
    disc = drum(0.0175, (0.0275, 0.0335), "x", (0, 0, -0.130))
    return {
        "servo_black": [knee],
        "aluminium": [plate, mirrored(plate), disc, mirrored(disc)],
        "racing_blue": [shin],
    }


def leg_ankle() -> Parts:
    """Servos of the ankle."""
    pitch = block((-0.0260, -0.0225, -0.0165), (0.0260, 0.0185, 0.034), 0.005)
    roll = block((-0.0205, -0.048, -0.020), (0.0205, 0.026, 0.018), 0.005)
    return {"servo_black": [pitch, roll]}


def foot() -> Parts:
    """Wide sole, with an arch that holds the ankle in front and behind."""
    sole = block((-0.0275, -0.0735, -0.060), (0.0595, 0.0735, -0.053), 0.003)
    top = hull([(x, y, -0.0500) for x in (-0.018, 0.050) for y in (-0.062, 0.060)], 0.0075)
    posts = [
        block((-0.0165, y, -0.054), (0.0165, y + 0.005, 0.014), 0.002) for y in (-0.0545, 0.0285)
    ]
    toe = hull([(x, 0.0640, -0.0505) for x in (-0.016, 0.048)], 0.0085)
    return {"servo_black": [sole], "aluminium": [top, *posts], "racing_blue": [toe]}


def make(folder: Path) -> None:
    """Write the URDF and its meshes into a folder."""
    links, joints = [], []
    for form in (chest, neck, head):
        name = form.__name__
        mass, com, moments = MIDDLE[name]
        scale = CHEST / mass if name == "chest" else SCALE
        links.append(_link(name, write_parts(folder, name, form()), (mass, com, moments), scale))
    joints += [_joint(name, figures) for name, figures in HEAD.items()]
    for side, sign in (("right", 1), ("left", -1)):
        for form in (arm, hand, leg_yaw, leg_roll, leg_pitch, leg_knee, leg_ankle, foot):
            parts = form()
            if sign < 0:
                parts = mirrored_parts(parts)
            name = f"{side}_{form.__name__}"
            links.append(
                _link(name, write_parts(folder, name, parts), INERTIAS[form.__name__], SCALE, sign)
            )
        for name, figures in SIDE.items():
            joints.append(_joint(name, figures, side, sign))
        for tool, link, (x, y, z) in (
            ("tip", "hand", (0, 0, -0.1435)),
            ("sole", "foot", (0.016, 0, -0.060)),
        ):
            links.append(Link(name=f"{side}_{tool}"))
            place = (sign * x, y, z)
            joints.append(
                Joint(
                    name=f"{side}_{tool}_fixed",
                    parent=f"{side}_{link}",
                    child=f"{side}_{tool}",
                    xyz=place,
                )
            )
    write_urdf(
        folder / "zjudancer.urdf", comment=COMMENT, colours=COLOURS, links=links, joints=joints
    )


def _link(
    name: str, visuals: list[tuple[Shape, str]], figures: tuple, scale: float, sign: int = 1
) -> Link:
    mass, (x, y, z), moments = figures
    shape = name.removeprefix("right_").removeprefix("left_")
    collisions = [
        replace(each, xyz=(sign * each.xyz[0], *each.xyz[1:])) for each in COLLISIONS.get(shape, [])
    ]
    inertia = {"mass": round(scale * mass, 9), "moments": [scale * moment for moment in moments]}
    return Link(name=name, com=(sign * x, y, z), visuals=visuals, collisions=collisions, **inertia)


def _joint(name: str, figures: tuple, side: str = "", sign: int = 1) -> Joint:
    parent, child, (x, y, z), axis, (low, high), effort, damping = figures
    if sign < 0 and name in MIRRORED_AXES:
        axis = [-value for value in axis]
    if side:
        name, child = f"{side}_{name}", f"{side}_{child}"
        parent = parent if parent == "chest" else f"{side}_{parent}"
    return Joint(
        name=name,
        parent=parent,
        child=child,
        xyz=(sign * x, y, z),
        axis=axis,
        range=(np.deg2rad(low), np.deg2rad(high)),
        effort=effort,
        velocity=VELOCITY,
        damping=damping,
        reflected_inertia=REFLECTED,
    )


if __name__ == "__main__":
    make(Path(__file__).parents[1] / "zjudancer")
