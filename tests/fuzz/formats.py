"""Files of other programs that are right, and damage inside archives and networks."""

import io
import random
import re
import tempfile
import zipfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from xml.sax.saxutils import escape

from tests.extensions.simulink.slx_files import pendulum
from tests.fuzz.damage import damaged, xml_damage
from tests.fuzz.valid import URDF, mesh

MJCF = b"""<mujoco model="arm"><compiler angle="degree"/><default><joint damping="0.5"/></default><worldbody>
<body name="base"><geom type="box" size="0.1 0.1 0.05"/><body name="upper" pos="0 0 0.1">
<joint name="pan" axis="0 0 1" range="-100 120"/><geom type="capsule" size="0.02" fromto="0 0 0 0 0 0.2"/>
<replicate count="3" euler="0 0 30"><geom type="sphere" size="0.01" pos="0.1 0 0"/></replicate></body></body>
</worldbody><actuator><position joint="pan" kp="200" forcerange="-40 50"/></actuator></mujoco>"""
SDF = b"""<sdf version="1.7"><model name="arm"><link name="base"><inertial><mass>3</mass><inertia><ixx>0.02</ixx>
<iyy>0.03</iyy><izz>0.04</izz><ixy>0</ixy><ixz>0</ixz><iyz>0</iyz></inertia></inertial></link>
<link name="upper"><pose>0.1 0.2 0.5 0.3 0.1 0.2</pose><inertial><mass>2</mass></inertial><collision name="c">
<geometry><box><size>0.1 0.2 0.3</size></box></geometry></collision></link>
<joint name="shoulder" type="revolute"><parent>base</parent><child>upper</child><axis><xyz>0 1 0</xyz><limit>
<lower>-1</lower><upper>2</upper><effort>7</effort></limit></axis></joint></model></sdf>"""
SRDF = b"""<robot name="arm"><group name="arm"><chain base_link="base" tip_link="upper"/></group>
<group name="all"><group name="arm"/><joint name="shoulder"/></group>
<group_state name="home" group="all"><joint name="shoulder" value="0.5"/></group_state>
<end_effector name="hand" parent_link="upper" group="all"/>
<disable_collisions link1="base" link2="upper" reason="Adjacent"/></robot>"""
RAPID = b"""MODULE Test
  CONST robtarget p1:=[[374,0,630],[0.707107,0,0.707107,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  VAR num count:=0;
  PROC main()
    MoveAbsJ [[0,0,0,0,30,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v100,fine,tool0;
    WHILE count<2 DO
      MoveJ Offs(p1,0,10*count,0),v100,z10,tool0;
      count:=count+1;
    ENDWHILE
    IF diPart=1 SetDO doGrip,1;
    FOR i FROM 1 TO 2 DO
      WaitTime 0.1;
    ENDFOR
  ENDPROC
ENDMODULE
"""
EXPRESSIONS = (
    *(
        "ones(1e5)",
        "(1:1e6)'*(1:1e6)",
        "diag(1:1e6)",
        "kron(ones(1000),ones(1000))",
        "1/0",
        "NaN",
        "inv(0)",
        "a.b.c",
    ),
    *(
        "repmat('x',1,1e9)",
        "x(1e9)",
        "polyval(1:1e6,1:1e6)",
        "zeros(1,0)",
        "((((((((((1))))))))))",
        "'",
        "{1,2}",
    ),
)
"""Values of a Simulink block's parameters that cost much or mean nothing."""
_PARAMETER = re.compile(rb'<P Name="\w+">([^<]*)</P>')
OPERATORS = (
    *(
        "Tanh",
        "Identity",
        "RandomNormalLike",
        "Bernoulli",
        "Loop",
        "If",
        "Scan",
        "Tile",
        "Expand",
        "NonZero",
        "Log",
    ),
    *(
        "ConstantOfShape",
        "Unknown",
        "Sqrt",
        "Reciprocal",
        "Dropout",
        "Softmax",
        "Transpose",
        "Flatten",
        "Cast",
    ),
)
"""Operators that stand in the place of another one of a network."""


@cache
def simulink() -> bytes:
    """Return a Simulink model of a pendulum with its control law."""
    with tempfile.TemporaryDirectory() as place:
        code = "Kp = 20; Kw = 2; theta0 = 10; L = 0.5; b = 0.02;"
        return pendulum(Path(place) / "model.slx", workspace=code).read_bytes()


def archive() -> bytes:
    """Return a ZIP archive of a robot and its SRDF, as a user uploads it."""
    return _packed(
        {"arm/urdf/arm.urdf": URDF, "arm/urdf/part.stl": mesh("stl"), "arm/srdf/arm.srdf": SRDF}
    )


def _packed(parts: dict[str, bytes]) -> bytes:
    """Return a ZIP archive of files by their names."""
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, part in parts.items():
            archive.writestr(name, part)
    return content.getvalue()


def _parts(data: bytes) -> dict[str, bytes]:
    """Return the files of a ZIP archive by their names."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def slx_damage(data: bytes, chance: random.Random) -> bytes:
    """Return a Simulink model with a damaged part, with a hostile expression, or damaged as any file."""
    if chance.random() < 0.2:
        return damaged(data, chance)
    parts = _parts(data)
    name = chance.choice(list(parts))
    values = [found.span(1) for found in _PARAMETER.finditer(parts[name])]
    if values and chance.random() < 0.7:
        begin, end = chance.choice(values)
        hostile = escape(chance.choice(EXPRESSIONS)).encode()
        return _packed({**parts, name: parts[name][:begin] + hostile + parts[name][end:]})
    return _packed({**parts, name: xml_damage(parts[name], chance)})


def zip_damage(data: bytes, chance: random.Random) -> bytes:
    """Return an archive with hostile names, too many or too large files, or damaged as any file."""
    if chance.random() < 0.5:
        return damaged(data, chance)
    parts = _parts(data)
    names = [
        "a/" * 3000 + "x.urdf",
        "n" * 400 + ".yaml",
        "../../x.urdf",
        "/etc/x.urdf",
        "arm.urdf/x",
        "",
        "C:\\x",
        "..",
    ]
    more: Callable[[], dict[str, bytes]] = chance.choice(
        [
            lambda: {chance.choice(names): b"<robot/>"},
            lambda: {f"{number}.txt": b"" for number in range(30_000)},
            lambda: {"large.stl": bytes(250_000_000)},
            lambda: {"inner.zip": data},
        ]
    )
    return _packed({**parts, **more()})


def network_damage(data: bytes, chance: random.Random) -> bytes:
    """Return an ONNX file with other operators, sizes or weights, or damaged as any file."""
    if chance.random() < 0.4:
        return damaged(data, chance)
    from onnx import ModelProto

    model = ModelProto.FromString(data)
    node = chance.choice(model.graph.node)
    tensor = chance.choice(model.graph.initializer)
    match chance.randrange(5):
        case 0:
            node.op_type = chance.choice(OPERATORS)
        case 1:
            tensor.dims[0] = chance.choice([0, -1, 2**40, 7])
        case 2:
            tensor.data_type = chance.choice([0, 1, 7, 8, 11, 99])
        case 3:
            node.input[0] = chance.choice(["", node.output[0], "nothing", "action"])
        case 4:
            tensor.raw_data = chance.choice(
                [b"", b"\xff" * len(tensor.raw_data), tensor.raw_data * 1000]
            )
    return bytes(model.SerializeToString())
