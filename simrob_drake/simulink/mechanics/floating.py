"""What a joint of six degrees of freedom does that leaves all free: what acts in it, and what it measures."""

from dataclasses import dataclass

from simrob_drake.simulink.model.nodes import Node

_SENSED: dict[str, dict[str, tuple[int, ...]]] = {
    **{f"P{axis}": {"SensePosition": (place,), "SenseVelocity": (place + 7,), "SenseAcceleration": (),
                    "SenseTorqueForce": ()} for place, axis in enumerate("xyz")},
    "Sph": {"SensePosition": (3, 4, 5, 6), "SenseVelocityX": (10,), "SenseVelocityY": (11,), "SenseVelocityZ": (12,),
            "SenseVelocity": (10, 11, 12), **{f"SenseAcceleration{axis}": () for axis in ("X", "Y", "Z", "")}},
}  # fmt: skip
"""What the ports of a floating joint hand out: which parts of a frame sensor; none of what no station measures."""


@dataclass(frozen=True)
class Pull:
    """What acts along or about one axis of the base of a floating joint."""

    place: int  # 0 to 2 of a force along x, y, z; 3 to 5 of a torque about them
    port: int  # the left port of its signal; 0 without
    stiffness: float  # of its spring
    rest: float  # of its spring
    damping: float  # of its damper
    stops: tuple[tuple[float, float, float], ...] = ()
    """Of a force, a place beyond which a spring pushes back, which way (1 up, -1 down), and how stiff it is."""


def sensed_parts(node: Node) -> dict[int, tuple[int, ...]]:
    """Return which parts of a frame sensor the ports of a joint hand out, by the number of the right port."""
    asked = [parts for kind, all_ in _SENSED.items() for name, parts in all_.items() if node.is_on(f"{kind}{name}")]
    return dict(enumerate(asked, start=2))


def read_pulls(node: Node) -> list[Pull]:
    """Return what acts in a joint that leaves all free, along its base's axes: signals, springs, dampers, stops."""
    pulls, port = [], 2
    for place, kind in enumerate(("Px", "Py", "Pz")):
        driven = node.text(f"{kind}TorqueActuationMode") == "InputTorque"
        stiffness = node.number(f"{kind}SpringStiffness", unit="N/m")
        damping = node.number(f"{kind}DampingCoefficient", unit="N*s/m")
        stops = []
        for end, way in (("Lower", 1.0), ("Upper", -1.0)):
            if node.is_on(f"{kind}{end}LimitSpecify"):
                bound = node.number(f"{kind}{end}LimitBound", unit="m")
                stops.append((bound, way, node.number(f"{kind}{end}LimitStiffness", "1e4", unit="N/m")))
        if stops:
            node.note("approximated", f"its stops along {kind[1]} are springs without dampers")
        if driven or stiffness or damping or stops:
            rest = node.number(f"{kind}EquilibriumPosition", unit="m") if stiffness else 0.0
            pulls.append(Pull(place, port if driven else 0, stiffness, rest, damping, tuple(stops)))
        port += driven
    turning = node.number("SphDampingCoefficient", unit="N*m*s/rad")
    for place, axis in enumerate(("X", "Y", "Z")):
        driven = node.is_on(f"SphActuateTorque{axis}")
        if driven or turning:
            pulls.append(Pull(3 + place, port if driven else 0, 0.0, 0.0, turning))
        port += driven
    if node.number("SphSpringStiffness", unit="N*m/rad"):
        node.note("lost", "its spring against turning")
    return pulls
