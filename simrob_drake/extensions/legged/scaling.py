r"""First figures of a robot on legs: gains of its servos and its walk, scaled from a robot whose figures are known.

Two pendulums of heights :math:`h` and :math:`h_0` move alike where lengths go with :math:`s = h / h_0`, times with
:math:`\sqrt s` and forces with the weight. So :math:`k_p \propto m g h` and :math:`k_d \propto k_p \sqrt{h / g}`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np

from simrob_drake.base.constants import STANDARD_GRAVITY
from simrob_drake.extensions.legged.anatomy import Anatomy
from simrob_drake.extensions.legged.soles import FootSole
from simrob_drake.programs.gaits.biped import Kick
from simrob_drake.programs.gaits.climb import Climb
from simrob_drake.robots.catalog import load_robot
from simrob_drake.robots.gaits_file import gaits_file
from simrob_drake.stations.stances import Stance
from simrob_drake.walking.parameters import REACTING, WalkingParameters

LAG = 0.14  # kd / kp [sqrt(h / g)], as that of all shipped ones
_CLEAR = 1.15  # widths of a sole that feet stay apart at least
_SLOW = 0.6  # part of the largest speed that a first walk is asked for
_SPHERES = 0.01  # m: what a sole of balls measures less than


@dataclass(frozen=True)
class Build:
    """What of a robot counts for how it walks, as it stands in its walk."""

    height: float  # of the centre of mass over the ground [m]
    mass: float  # [kg]
    spread: float  # between the middles of a right and a left foot [m]
    sole: tuple[float, float]  # length and width of one, between its spheres [m]; 0 of balls

    @property
    def load(self) -> float:
        """Weight times height [N·m]: what a radian of lean turns it."""
        return self.mass * STANDARD_GRAVITY * self.height

    @property
    def time(self) -> float:
        """In which it falls: 1 / ω [s]."""
        return sqrt(self.height / STANDARD_GRAVITY)


@dataclass(frozen=True)
class Example:
    """A robot of the package whose walk is known: its name, its build in its walking station, its kp [m g h / rad]."""

    name: str
    build: Build
    stiffness: float


EXAMPLES = {
    2: (
        Example("zjudancer", Build(0.345, 4.70, 0.122, (0.137, 0.077)), 10.0),
        Example("roid1", Build(0.204, 1.46, 0.0914, (0.112, 0.068)), 10.0),
    ),
    4: (Example("yobotics", Build(0.260, 9.44, 0.254, (0.0, 0.0)), 16.6),),
}
"""By the number of legs; those of six walk as four do."""


def build_of(anatomy: Anatomy, stance: Stance, soles: Sequence[FootSole]) -> Build:
    """Return the build of a robot as it stands."""
    poses = [
        anatomy.clearance.plant.EvalBodyPoseInWorld(anatomy.clearance.context, limb.leg.foot)
        @ sole.pose
        for limb, sole in zip(anatomy.legs, soles, strict=True)
    ]
    apart = poses[0].inverse() @ poses[1].translation()
    length, width = np.ptp(soles[0].points[:, :2], axis=0).tolist()
    return Build(
        stance.standing.height, stance.standing.mass, abs(float(apart[1])), (length, width)
    )


def gains(build: Build, model: Example) -> dict[str, float]:
    """Return ``kp`` [N·m/rad] and ``kd`` [N·m·s/rad] of all axes, alike."""
    kp = model.stiffness * build.load
    return {"kp": _short(kp), "kd": _short(LAG * kp * build.time)}


def walk_of(
    build: Build,
    model: Example,
    *,
    height: float,
    groups: Sequence[Sequence[str]],
    posture: Mapping[str, float],
    quick: bool = False,
) -> dict[str, Any]:
    """Return the section ``reacting`` of a robot's ``gaits.yaml``, scaled from a model's.

    The robot stands in a ``posture`` by axis [deg], its root at a ``height`` [m], on feet of which ``groups`` stand
    together. ``quick`` lets a larger robot take lower steps more often, and answer as quickly as the smaller one.
    """
    known = WalkingParameters(**gaits_file(load_robot(model.name)).section(REACTING)).model_dump(
        mode="json"
    )
    length, time = build.height / model.build.height, build.time / model.build.time
    feet = [
        _ratio(own, other, length) for own, other in zip(build.sole, model.build.sole, strict=True)
    ]
    walk = _scaled(known, length, time)
    if quick and length > 1.0:
        walk |= {"lift": known["lift"], "step_time": _short(known["step_time"] * sqrt(time))}
        walk["feedback"] |= {key: known["feedback"][key] for key in _QUICK}
    walk |= {
        "bearing": {"height": round(height, 4), "pitch_deg": 0.0, "posture_deg": dict(posture)},
        "stance_deg": dict(posture),
        "groups": [list(group) for group in groups],
        "zmp_inward": _short(known["zmp_inward"] * min(feet[1], length)),
    }
    feedback = walk["feedback"]
    feedback["zmp_limit"] = [
        _short(limit * foot)
        for limit, foot in zip(known["feedback"]["zmp_limit"], feet, strict=True)
    ]
    if feedback["touch_force"] is not None:
        feedback["touch_force"] = _short(
            known["feedback"]["touch_force"] * build.mass / model.build.mass
        )
    if build.sole[1] > 0 and len(groups[0]) == 1:
        spread = model.build.spread + 2.0 * known["widen"]
        own = max(length * spread, _CLEAR * build.sole[1])
        least = max(_CLEAR * build.sole[1], own - length * (spread - known["foothold"]["inner"]))
        walk["foothold"]["inner"] = _short(least)
        walk["foothold"]["outer"] = _short(own + length * (known["foothold"]["outer"] - spread))
        walk["widen"] = _short((own - build.spread) / 2)
    return walk


def kick_of(
    build: Build, walk: Mapping[str, Any], inward: float, part: float = 1.0
) -> dict[str, Any]:
    """Return a kick of a robot's ``gaits.yaml``, scaled from that of the first robot known, beside its ``walk``.

    The weight stays ``inward`` of the standing foot's middle, as a part of what it does in the walk; ``part`` is that
    of the swing and its height.
    """
    model = EXAMPLES[2][0]
    known = Kick(**gaits_file(load_robot(model.name)).section(Kick.section)[Kick.usual])
    length, time = build.height / model.build.height, build.time / model.build.time
    return {
        "bearing": {key: walk["bearing"][key] for key in ("height", "posture_deg")},
        "zmp_inward": _short(inward * walk["zmp_inward"]),
        **{key: _short(getattr(known, key) * part * length) for key in ("swing", "lift")},
        **{key: _short(getattr(known, key) * time) for key in ("settle", "raising")},
        "speed": _short(known.speed * length / time),
    }


def climb_of(build: Build, walk: Mapping[str, Any], part: float = 1.0) -> dict[str, Any]:
    """Return a climb of a robot's ``gaits.yaml``, scaled likewise, with a part of how low it goes and lifts feet."""
    legs = sum(len(group) for group in walk["groups"])
    model = EXAMPLES[legs][0]
    file = gaits_file(load_robot(model.name))
    known = Climb(**file.section(Climb.section)[Climb.usual])
    length, time = build.height / model.build.height, build.time / model.build.time
    lower = known.bearing.height / file.section(REACTING)["bearing"]["height"]
    climb: dict[str, Any] = {
        "bearing": {
            **walk["bearing"],
            "height": _short((1 - part * (1 - lower)) * walk["bearing"]["height"]),
        },
        "lift": _short(part * known.lift * length),
        "stride": _short(known.stride * length),
        "double_support": known.double_support,
        **{key: _short(getattr(known, key) * time) for key in ("step_time", "settle")},
    }
    if legs > 2:
        inside = known.inside * min(length, build.spread / model.build.spread)
        return climb | {"rise": _short(known.rise * length), "inside": _short(inside)}
    longer, wider = np.array(build.sole) / model.build.sole
    return climb | {
        "feet": known.feet,
        "zmp_inward": _short(known.zmp_inward * wider),
        "overhang": _short(known.overhang * longer),
        "margin": _short(known.margin * length),
    }


def asked_speed(walk: Mapping[str, Any], part: float = 1.0) -> float:
    """Return the speed that a first walk is asked for [m/s]."""
    return _short(_SLOW * part * float(walk["max_speed"]["ahead"]))


_QUICK = "com_rate", "lean_rate", "upright_rate", "deadband", "hurry_threshold"
"""Keys of the feedback that stay in a walk of quick, low steps."""
_POWERS: Mapping[str, tuple[float, float]] = {
    **dict.fromkeys(
        ("step_time", "settle", "min_swing_time", "max_swing_time", "late_touchdown"), (0, 1)
    ),
    **dict.fromkeys(
        ("lift", "landing_height", "zmp_ahead", "deadband", "hurry_threshold", "brace_threshold"),
        (1, 0),
    ),
    **dict.fromkeys(("ahead", "backward", "sideways", "max_foot_speed", "search_speed"), (1, -1)),
    **dict.fromkeys(
        ("turn_deg", "com_rate", "lean_rate", "upright_rate", "lean_integral", "offset_rate"),
        (0, -1),
    ),
    **dict.fromkeys(("heading_gain", "height_rate", "level_rate", "slope_rate"), (0, -1)),
    "time_weight": (2, -2),
}
"""With which powers of length and time a key goes; those that are not here stay."""


def _scaled(section: Mapping[str, Any], length: float, time: float) -> dict[str, Any]:
    """Return a section with all its figures scaled; footholds are lengths, not speeds."""

    def scaled(key: str, value: Any) -> Any:
        if isinstance(value, Mapping):
            return (
                {one: _times(part, length) for one, part in value.items()}
                if key == "foothold"
                else _scaled(value, length, time)
            )
        lengths, times = _POWERS.get(key, (0.0, 0.0))
        return _times(value, length**lengths * time**times)

    found = {key: scaled(key, value) for key, value in section.items()}
    if "max_speed_change" in found:
        ahead, left, turn = section["max_speed_change"]
        found["max_speed_change"] = [
            _short(ahead * length / time),
            _short(left * length / time),
            _short(turn / time),
        ]
    return found


def _times(value: Any, factor: float) -> Any:
    if factor == 1.0 or isinstance(value, (str, bool)) or value is None:
        return value
    return (
        [_times(one, factor) for one in value]
        if isinstance(value, list)
        else _short(value * factor)
    )


def _ratio(own: float, other: float, otherwise: float) -> float:
    return own / other if other > _SPHERES else otherwise


def _short(value: float) -> float:
    """Return a number with three digits."""
    return float(f"{value:.3g}")
