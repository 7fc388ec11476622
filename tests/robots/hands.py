"""Hands of boxes on a gantry, as URDF texts, on which grasps, gains and first stations are tried."""

from collections.abc import Mapping

LINK = """<link name="{name}"><inertial><origin xyz="{com}"/><mass value="{mass}"/>
  <inertia ixx="{inertia}" iyy="{inertia}" izz="{inertia}" ixy="0" ixz="0" iyz="0"/></inertial>{shapes}</link>"""
BOX = """<collision><origin xyz="{at}" rpy="{turn}"/><geometry><box size="{size}"/></geometry></collision>"""
JOINT = """<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
  <origin xyz="{at}" rpy="{turn}"/><axis xyz="{axis}"/>
  <limit lower="{low}" upper="{high}" effort="{effort}" velocity="2"/>{more}</joint>"""
PAD = {
    "stalk": ("0.02 0.01 0.06", "0 {side}0.013 0.03"),
    "pad": ("0.02 0.01 0.02", "0 {side}0.005 0.07"),
}


def box(size: str, at: str = "0 0 0", turn: str = "0 0 0") -> str:
    """Return a box that collides."""
    return BOX.format(size=size, at=at, turn=turn)


def link(name: str, *shapes: str, mass: float = 0.1, com: str = "0 0 0") -> str:
    """Return a link that weighs something."""
    return LINK.format(name=name, shapes="".join(shapes), mass=mass, inertia=mass * 1e-3, com=com)


def joint(name: str, parent: str, child: str, **own: object) -> str:
    """Return a joint, sliding along x by up to 0.5 m unless told otherwise."""
    usual: Mapping[str, object] = {
        "kind": "prismatic", "at": "0 0 0", "turn": "0 0 0", "axis": "1 0 0", "low": -0.5, "high": 0.5, "effort": 200,
        "more": "",
    }  # fmt: skip
    return JOINT.format(name=name, parent=parent, child=child, **{**usual, **own})


def finger(side: str, *, follows: str = "", effort: float = 20, y: str = "") -> str:
    """Return a finger that slides by 40 mm: its stalk stands back 8 mm behind the face of its pad, 60 to 80 mm out."""
    sign = "" if side == "left" else "-"
    shapes = [box(size, at.format(side=sign)) for size, at in PAD.values()]
    more = f'<mimic joint="{follows}"/>' if follows else ""
    moves = {"axis": f"0 {sign}1 0", "low": 0, "high": 0.04, "effort": effort, "more": more}
    return link(side, *shapes, mass=0.05, com=f"0 {sign}0.01 0.03") + joint(
        f"{side}_slide", "palm", side, **moves
    )


def gantry(*fingers: str, turn: str = "3.14159265358979 0 0") -> str:
    """Return a robot that carries a palm along x and z, its fingers down; those follow each other unless given."""
    parts = [
        link("base", box("0.1 0.1 0.1", "0 0 0.65"), mass=5),
        link("carriage", mass=2),
        link("palm", box("0.06 0.12 0.04", "0 0 -0.02"), mass=0.5),
        joint("along", "base", "carriage", at="0 0 0.4"),
        joint("lift", "carriage", "palm", axis="0 0 1", turn=turn, low=-0.3, high=0.35, at="0 0 0"),
    ]
    hand = fingers or (finger("left"), finger("right", follows="left_slide"))
    return f'<robot name="gantry">{"".join([*parts, *hand])}</robot>'


CRANK, HINGE, FACE = (
    0.06,
    0.03,
    0.005,
)  # m: of a linkage its cranks, their hinges off the middle, half of a pad


def linkage(
    *, pad_limits: tuple[float, float] = (-0.6, 0.6), effort: float = 100
) -> tuple[str, ...]:
    """Return two fingers whose pads stay upright: each a crank that turns, and a pad at its end that turns back.

    All follow the left crank, whose angle q brings the faces 2 (HINGE - FACE - CRANK sin q) apart. Pads are 60 to
    80 mm out at q = 0.
    """
    parts = []
    for name, sign in (("left", 1), ("right", -1)):
        low, high = (0, 0.6) if sign > 0 else (-0.6, 0)
        turns = {"kind": "revolute", "axis": "1 0 0", "effort": effort}
        led = "" if sign > 0 else '<mimic joint="left_crank" multiplier="-1"/>'
        back = f'<mimic joint="left_crank" multiplier="{-sign}"/>'
        hinge = {"at": f"0 {sign * HINGE} 0", "low": low, "high": high, "more": led}
        pin = {"at": f"0 0 {CRANK}", "low": pad_limits[0], "high": pad_limits[1], "more": back}
        parts += [
            link(f"{name}_bar", mass=0.05, com=f"0 0 {CRANK / 2}"),
            joint(f"{name}_crank", "palm", f"{name}_bar", **turns, **hinge),
            link(f"{name}_pad", box("0.02 0.01 0.02", "0 0 0.01"), mass=0.05, com="0 0 0.01"),
            joint(f"{name}_pin", f"{name}_bar", f"{name}_pad", **turns, **pin),
        ]
    return tuple(parts)
