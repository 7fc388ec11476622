"""Small Simulink models in the shape of the real format: a zip of XML, blocks with parameters, lines by SID."""

from __future__ import annotations

import re
import zipfile
from dataclasses import dataclass, field
from pathlib import Path
from xml.sax.saxutils import escape, quoteattr

_DIAGRAM = """<?xml version="1.0" encoding="utf-8"?>
<ModelInformation Version="1.0">
  <{kind}>
    {workspace}
    <System Ref="system_root"/>
  </{kind}>
</ModelInformation>
"""


def value(text: object) -> str:
    return escape(str(text))


@dataclass
class Level:
    """A system being written: blocks and lines."""

    blocks: list[str] = field(default_factory=list)
    lines: list[str] = field(default_factory=list)
    first: int = 1
    _count: int = 0

    def block(
        self,
        kind: str,
        name: str,
        *,
        mask: str = "",
        inner: str = "",
        ports: str = "",
        **parameters,
    ) -> str:
        """Add a block; one whose kind has a ``/`` is a link into a library. Return its SID."""
        self._count += 1
        sid = str(self.first + self._count - 1)
        linked = "/" in kind
        source = f'<P Name="SourceBlock">{value(kind)}</P>' if linked else ""
        given = "".join(f'<P Name="{key}">{value(text)}</P>' for key, text in parameters.items())
        instance = f"<InstanceData>{given}</InstanceData>" if linked else given
        self.blocks.append(
            f'<Block BlockType="{"Reference" if linked else kind}" Name={quoteattr(name)} SID="{sid}">'
            f"{ports}{source}{instance}{mask}{inner}</Block>"
        )
        return sid

    def wire(self, start: str, *ends: str) -> None:
        """Join signal ports, ``5#out:1``."""
        branches = "".join(f'<Branch><P Name="Dst">{end}</P></Branch>' for end in ends)
        self.lines.append(f'<Line><P Name="Src">{start}</P>{branches}</Line>')

    def connect(self, *ports: str) -> None:
        """Join physical ports, ``5#rconn:1``."""
        inner = "".join(f'<P Name="Src">{port}</P>' for port in ports)
        self.lines.append(f'<Line LineType="Connection">{inner}</Line>')

    def xml(self) -> str:
        return f"<System>{''.join(self.blocks)}{''.join(self.lines)}</System>"


def mask(code: str = "", **parameters: object) -> str:
    given = "".join(
        f'<MaskParameter Name="{name}" Type="edit"><Value>{value(text)}</Value></MaskParameter>'
        for name, text in parameters.items()
    )
    return f"<Mask><Initialization>{value(code)}</Initialization>{given}</Mask>"


def _texts(given: dict[str, str]) -> str:
    return "".join(f'<P Name="{name}">{value(text)}</P>' for name, text in given.items())


def write_model(
    path: Path, level: Level, *, workspace: str = "", kind: str = "Model", stop: str = "1", stored: bytes = b"",
    source: dict[str, str] | None = None, callbacks: dict[str, str] | None = None, falls: bool = True, **parts: str,
) -> Path:  # fmt: skip
    """Write an `.slx` file; further parts by name are systems of their own.

    Gravity of the earth is on its World, where nothing tells another and it ``falls``.

    Its workspace is code, the bytes ``stored``, or from where ``source`` says.
    """
    where = source or ({"WSMATLABCode": workspace} if workspace else {})
    system = level.xml()
    world = re.search(r'SID="(\d+)"><P Name="SourceBlock">' + WORLD, system)
    if falls and world and "Mechanism Configuration" not in system:
        gravity = Level([system.removesuffix("</System>").removeprefix("<System>")], first=9000)
        gravity.connect(f"{gravity.block(MECHANISM, 'Gravity')}#rconn:1", f"{world[1]}#rconn:1")
        system = gravity.xml()
    code = f"<ModelWorkspace>{_texts(where)}</ModelWorkspace>{_texts(callbacks or {})}"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("[Content_Types].xml", "<Types/>")
        archive.writestr("simulink/blockdiagram.xml", _DIAGRAM.format(kind=kind, workspace=code))
        archive.writestr("simulink/systems/system_root.xml", system)
        archive.writestr(
            "simulink/configSet0.xml", f'<ConfigSet><P Name="StopTime">{stop}</P></ConfigSet>'
        )
        if stored:
            archive.writestr("simulink/modelWorkspace.mxarray", stored)
        for name, text in parts.items():
            archive.writestr(
                f"simulink/{name}.xml" if name == "modelMask" else f"simulink/systems/{name}.xml",
                text,
            )
    return path


TRANSFORM = "sm_lib/Frames and\nTransforms/Rigid\nTransform"
REVOLUTE = "sm_lib/Joints/Revolute Joint"
WORLD = "sm_lib/Frames and Transforms/World Frame"
MECHANISM = "sm_lib/Utilities/Mechanism Configuration"
BRICK = "sm_lib/Body Elements/Brick Solid"
INERTIA = "sm_lib/Body Elements/Inertia"
TO_PHYSICS = "nesl_utility/Simulink-PS\nConverter"
FROM_PHYSICS = "nesl_utility/PS-Simulink Converter"


def pendulum(
    path: Path, *, kp: str = "Kp", kw: str = "Kw", driven: bool = True, law: bool = True, **options
) -> Path:
    """A rod of 2 kg on a torque-driven joint about world -y: T = Kp (q_ref - q) - Kw w, in a masked subsystem."""
    arm = Level(first=100)
    world = arm.block(WORLD, "World")
    gravity = arm.block(
        MECHANISM, "Gravity", GravityVector="[0 0 -9.81]", GravityVectorUnits="m/s^2"
    )
    base = arm.block(
        TRANSFORM, "Mount", TranslationMethod="StandardAxis", TranslationStandardOffset="50",
        TranslationStandardOffsetUnits="cm", TranslationStandardAxis="+Z", RotationMethod="AlignedAxes",
        FollAlignAxisA="+Z", BaseAlignAxisA="-Y", FollAlignAxisB="+Y", BaseAlignAxisB="+X",
    )  # fmt: skip
    joint = arm.block(
        REVOLUTE, "Shoulder", TorqueActuationMode="InputTorque" if driven else "NoTorque", SensePosition="on",
        SenseVelocity="on", DampingCoefficient="0.1", DampingCoefficientUnits="N*m/(rad/s)",
        PositionTargetSpecify="on", PositionTargetValue="theta0", PositionTargetValueUnits="deg",
        **{"LowerLimitSpecify": "on", "LowerLimitBound": "-100", "LowerLimitBoundUnits": "deg",
           "LowerLimitStiffness": "1e4", "LowerLimitStiffnessUnits": "N*m/deg", "LowerLimitDamping": "10",
           "LowerLimitDampingUnits": "N*m/(deg/s)", "UpperLimitSpecify": "on", "UpperLimitBound": "100",
           "UpperLimitBoundUnits": "deg"},
    )  # fmt: skip
    half = arm.block(
        TRANSFORM, "Half", TranslationMethod="Cartesian", TranslationCartesianOffset="[L/2 0 0]"
    )
    rod = arm.block(
        BRICK, "Rod", BrickDimensions="[L b b]", BrickDimensionsUnits="m", InertiaType="CalculateFromGeometry",
        BasedOnType="Mass", Mass="2", MassUnits="kg", GraphicDiffuseColor="[1 0 0]",
    )  # fmt: skip
    tip = arm.block("sm_lib/Frames and Transforms/Reference Frame", "Tip")
    end = arm.block(
        TRANSFORM, "End", TranslationMethod="Cartesian", TranslationCartesianOffset="[L 0 0]"
    )
    arm.connect(f"{world}#rconn:1", f"{gravity}#rconn:1", f"{base}#lconn:1")
    arm.connect(f"{base}#rconn:1", f"{joint}#lconn:1")
    arm.connect(f"{joint}#rconn:1", f"{half}#lconn:1", f"{end}#lconn:1")
    arm.connect(f"{half}#rconn:1", f"{rod}#rconn:1")
    arm.connect(f"{end}#rconn:1", f"{tip}#rconn:1")
    torque = arm.block("Inport", "T")
    into = arm.block(TO_PHYSICS, "In", Unit="1")
    outs = [arm.block(FROM_PHYSICS, name, Unit="inherit") for name in ("q out", "w out")]
    ports = [arm.block("Outport", "q"), arm.block("Outport", "w", Port="2")]
    if driven:
        arm.wire(f"{torque}#out:1", f"{into}#in:1")
        arm.connect(f"{into}#rconn:1", f"{joint}#lconn:2")
    for number, (out, port) in enumerate(zip(outs, ports, strict=True)):
        arm.connect(f"{joint}#rconn:{number + 2}", f"{out}#lconn:1")
        arm.wire(f"{out}#out:1", f"{port}#in:1")
    top = Level()
    wanted = top.block("Inport", "q_ref", PortDimensions="1")
    plant = top.block(
        "SubSystem",
        "Arm",
        mask=mask("b = L/10;", L="0.4", theta0="theta0"),
        inner='<System Ref="arm"/>',
    )
    error = top.block("Sum", "Error", Inputs="|+-")
    total = top.block("Sum", "Total", Inputs="|+-")
    gains = [top.block("Gain", "Stiffness", Gain=kp), top.block("Gain", "Damping", Gain=kw)]
    limit = top.block("Saturate", "Limit", UpperLimit="30", LowerLimit="-30")
    if law:
        top.wire(f"{wanted}#out:1", f"{error}#in:1")
        top.wire(f"{plant}#out:1", f"{error}#in:2")
        top.wire(f"{plant}#out:2", f"{gains[1]}#in:1")
        top.wire(f"{error}#out:1", f"{gains[0]}#in:1")
        top.wire(f"{gains[0]}#out:1", f"{total}#in:1")
        top.wire(f"{gains[1]}#out:1", f"{total}#in:2")
        top.wire(f"{total}#out:1", f"{limit}#in:1")
        top.wire(f"{limit}#out:1", f"{plant}#in:1")
    options.setdefault("workspace", "Kp = 200; Kw = 15; theta0 = 20;")
    return write_model(path, top, arm=arm.xml(), **options)
