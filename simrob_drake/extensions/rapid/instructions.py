"""The instructions and functions of RAPID that a controller does: motion, time, signals, and what has no effect."""

import math
import re
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from pydrake.math import RigidTransform

from simrob_drake.base.frames import pose_from_transform
from simrob_drake.base.messages import message
from simrob_drake.extensions.rapid.configuration import configuration, has_configuration
from simrob_drake.extensions.rapid.controller import Controller, Motion
from simrob_drake.extensions.rapid.expressions import Call
from simrob_drake.extensions.rapid.values import (
    FREE_AXES,
    RecordValue,
    Value,
    WrongType,
    robjoint_of,
    robtarget_of,
    texted,
    transform_of,
)
from simrob_drake.programs.moves.motion import ArmMotion
from simrob_drake.programs.moves.move_j import MoveAbsJ, MoveJ
from simrob_drake.programs.moves.move_l import MoveC, MoveL
from simrob_drake.programs.timing import ACCELERATION

Instruction = Callable[[Controller, Call], Any]
_SIX = 6
_ABSENT = 9e8  # above it an external axis is not there


def _move(kind: type[ArmMotion], *, signal: bool = False) -> Instruction:
    """Return what a move to a target does; with ``signal`` it sets an output there."""

    def move(controller: Controller, call: Call) -> None:
        first = 1 if kind is MoveC else 0
        kind_of_target = "jointtarget" if kind is MoveAbsJ else "robtarget"
        target = call.value(first, kind_of_target)
        speed, zone = (
            call.value(first + index, name) for index, name in ((1, "speeddata"), (2, "zonedata"))
        )
        tool = call.known(lambda: call.value(first + 3, "tooldata"), "tool0")
        if any(0 != value < _ABSENT for value in target["extax"].flat()):
            call.remark(
                message("rapid.external_axes_left_out", "external axes are left out"), lost=False
            )
        controller.take_tool(tool)
        wobj = controller.frame(call.known(lambda: call.option("wobj", "wobjdata"), "wobj0"))
        motion = _motion(controller, call, kind, speed, None if kind is MoveAbsJ else wobj)
        near = 0.0 if zone["finep"] else zone["pzone_tcp"] / 1e3
        near = call.option("z", "num", 1e3 * near) / 1e3
        if kind is MoveAbsJ:
            posture = _axes(controller, target)
            controller.go(call, motion, posture, near, posture=np.array(posture))
        else:
            _go(controller, call, motion, target, near)
        if signal:
            controller.put(call, call.signal(first + 4), call.value(first + 5, "num"))

    return move


def _go(
    controller: Controller, call: Call, motion: Motion, target: RecordValue, near: float
) -> None:
    here = transform_of(target)
    there, frame = (pose_from_transform(here) + 0.0).tolist(), controller.cell.frame(motion.wobj)
    if motion.kind is MoveL and controller.cannot_begin_with(call, motion, there):
        motion = motion._replace(kind=MoveJ)
        call.remark(
            message(
                "rapid.first_move",
                "is the first move, and no module says from where: it goes by the axes",
            ),
            lost=False,
        )
    more: dict[str, Any] = {"pose": (frame @ here).GetAsMatrix4()}
    if motion.kind is MoveJ:
        more["posture"] = controller.posture(call, target, more["pose"])
    else:
        more["configuration"] = str([int(value) for value in target["robconf"].flat()])
    if motion.kind is MoveC:
        more["via"] = pose_from_transform(transform_of(call.value(0, "robtarget")))[:3].tolist()
    controller.go(call, motion, there, near, **more)


def _motion(
    controller: Controller,
    call: Call,
    kind: type[ArmMotion],
    speed: RecordValue,
    wobj: tuple[float, ...] | None,
) -> Motion:
    fastest = call.option("v", "num", speed["v_tcp"]) / 1e3 * controller.share
    turning = math.radians(speed["v_ori"]) * controller.share
    if min(fastest, turning) <= 0:
        raise WrongType(
            message("rapid.speeddata_without_speed", "a speeddata without a speed of the tool")
        )
    duration = call.option("t", "num")
    return Motion(
        kind, wobj, min(fastest, controller.fastest), turning, duration, controller.acceleration
    )


def _axes(controller: Controller, target: RecordValue) -> list[float]:
    model = controller.cell.robot(controller.robot).model
    count = len(model.axes)
    if count > _SIX:
        raise WrongType(
            message(
                "rapid.jointtarget_axes",
                "a jointtarget for {count} axes, of which it has {six},",
                count=count,
                six=_SIX,
            )
        )
    values = np.array(target["robax"].flat()[:count])
    return [
        float(value)
        for value in np.where(model.user_units == 1.0, values / 1e3, np.deg2rad(values))
    ]


def _set_to(value: float) -> Instruction:
    return lambda controller, call: controller.put(call, call.signal(), value)


def _set(controller: Controller, call: Call) -> None:
    controller.wait(call.option("sdelay", "num", 0.0))
    controller.put(call, call.signal(), call.value(1, "num"))


def _pulse(controller: Controller, call: Call) -> None:
    for value in (1.0, 0.0):
        controller.put(call, call.signal(), value)


def _wait_signal(controller: Controller, call: Call) -> None:
    _wait_until(
        controller,
        call,
        lambda: controller.read(call, call.signal()) == call.value(1, "num"),
        call.signal(),
    )


def _wait_condition(controller: Controller, call: Call) -> None:
    controller.finish()
    _wait_until(controller, call, lambda: bool(call.value(0, "bool")), *controller.signals.inputs)


def _wait_until(
    controller: Controller, call: Call, holds: Callable[[], bool], *signals: str
) -> None:
    """Wait for a condition: until inputs of a table change, or step by step for what sensors see."""
    longest, begun, signal = (
        call.option("maxtime", "num", _LONGEST),
        controller.time,
        controller.signals,
    )
    while not holds():
        changes = [
            at for name in signals if (at := signal.next_change(name, controller.time)) is not None
        ]
        step = (
            _STEP
            if any(map(signal.watches, signals))
            else min(changes, default=np.inf) - controller.time
        )
        left = begun + longest - controller.time
        if step > left or not np.isfinite(step):
            if not call.has("maxtime"):
                call.remark(
                    message(
                        "rapid.waits_for_never",
                        "{name} waits for what never comes: it is left out; name it in a table, --io",
                        name=call.name,
                    )
                )
                return
            controller.wait(left)
            if call.has("timeflag"):
                call.task.place(call.options["timeflag"]).set(True)
            return
        controller.wait(step + _AFTER)


_STEP, _AFTER, _LONGEST = (
    0.05,
    1e-6,
    600.0,
)  # s: between looks at a sensor, behind a change, and for a sensor at most


def _grip_load(controller: Controller, call: Call) -> None:
    if call.value(0, "loaddata")["mass"] > 1e-3:
        call.remark(
            message(
                "rapid.loads_of_pieces",
                "loads are those of the pieces that the robot carries in the station",
            ),
            lost=False,
        )


def _vel_set(controller: Controller, call: Call) -> None:
    controller.finish()
    controller.share, controller.fastest = call.value(0, "num") / 100, call.value(1, "num") / 1e3


def _path_acc_lim(controller: Controller, call: Call) -> None:
    controller.finish()
    limited = call.has("accmax") and call.value(0, "bool")
    controller.acceleration = call.option("accmax", "num") if limited else None


def _acc_set(controller: Controller, call: Call) -> None:
    controller.finish()
    share = call.value(0, "num") / 100
    controller.acceleration = ACCELERATION * share if share < 1 else None


def _configured(key: str) -> Instruction:
    def configure(controller: Controller, call: Call) -> None:
        controller.finish()
        controller.configured[key] = not call.has("off")

    return configure


def _write(controller: Controller, call: Call) -> None:
    text = "".join(
        texted(call.task.value(node)) for node in call.options.values() if node is not None
    )
    call.remark(
        message("rapid.says", "says {value}{text}", value=call.value(0, "string"), text=text),
        lost=False,
    )


def _counted(step: Callable[[Call], float]) -> Instruction:
    def count(controller: Controller, call: Call) -> None:
        place = call.place(0)
        held = place.get()
        if not isinstance(held, float):
            raise WrongType(
                message("rapid.num_to_count", "something else than a num to be counted")
            )
        place.set(held + step(call))

    return count


def _clock(controller: Controller, call: Call) -> None:
    """Let a clock hold a time: that since it was started if it runs, as a negative begin."""
    controller.finish()
    place, name = call.place(0), call.name.lower()
    held = float(place.get())  # type: ignore[arg-type]
    place.set(
        {
            "clkreset": 0.0,
            "clkstart": -1.0 - controller.time,
            "clkstop": _elapsed(controller, held),
        }[name]
    )


def _elapsed(controller: Controller, held: float) -> float:
    return controller.time + held + 1.0 if held < 0 else held


def _clk_read(controller: Controller, call: Call) -> Value:
    controller.finish()
    return _elapsed(controller, call.value(0, "num"))


def _c_robt(controller: Controller, call: Call) -> Value:
    controller.finish()
    if call.has("tool"):
        controller.take_tool(call.known(lambda: call.option("tool", "tooldata"), "tool0"))
    frame = controller.cell.frame(
        controller.frame(call.known(lambda: call.option("wobj", "wobjdata"), "wobj0"))
    )
    pose = frame.inverse() @ RigidTransform(controller.arm.pose)
    return robtarget_of(pose, _configuration(controller, controller.arm.start))


def _configuration(controller: Controller, posture: Any) -> tuple[int, ...]:
    chain = controller.arm.chain
    return configuration(chain, posture) if has_configuration(chain) else (0, 0, 0, 0)


def _c_joint(controller: Controller, call: Call) -> Value:
    controller.finish()
    model = controller.cell.robot(controller.robot).model
    return joint_target(controller.arm.start, model.user_units)


def joint_target(posture: Any, units: Any) -> RecordValue:
    """Return a posture (n,) [rad or m] as a ``jointtarget`` [deg or mm]; ``units`` are those of users (n,)."""
    values = np.where(units == 1.0, 1e3 * posture, np.rad2deg(posture))[:_SIX]
    padded = [*values, *[0.0] * (_SIX - len(values))]
    return RecordValue("jointtarget", {"robax": robjoint_of(padded), "extax": FREE_AXES})


def _calc_joint(controller: Controller, call: Call) -> Value:
    controller.finish()
    controller.take_tool(call.value(1, "tooldata"))
    frame = controller.cell.frame(controller.frame(call.option("wobj", "wobjdata")))
    target = call.value(0, "robtarget")
    posture = controller.posture(call, target, (frame @ transform_of(target)).GetAsMatrix4())
    return joint_target(posture, controller.cell.robot(controller.robot).model.user_units)


def _calc_robt(controller: Controller, call: Call) -> Value:
    controller.finish()
    controller.take_tool(call.value(1, "tooldata"))
    posture = np.array(_axes(controller, call.value(0, "jointtarget")))
    frame = controller.cell.frame(controller.frame(call.option("wobj", "wobjdata")))
    pose = frame.inverse() @ RigidTransform(controller.arm.chain.forward(posture)[0])
    return robtarget_of(pose, _configuration(controller, posture))


def _read(controller: Controller, call: Call) -> Value:
    return controller.read(call, call.signal())


def _remarking(text: str, *, unless: str = "") -> Instruction:
    def tell(controller: Controller, call: Call) -> None:
        if not (unless and call.has(unless)):
            call.remark(
                message(
                    "rapid.has_no_effect", "{name} has no effect: {text}", name=call.name, text=text
                ),
                lost=False,
            )

    return tell


def _ask(controller: Controller, call: Call) -> None:
    """Give data what an operator answers: an input of its name in the table of signals."""
    asked = call.argument(0)
    while asked.data != "name":
        asked = asked.children[0]
    call.place(0).set(controller.read(call, str(asked.children[0])))


def _test_and_set(controller: Controller, call: Call) -> bool:
    """Set a flag that tasks share, and tell whether it was not set; no other task would release it."""
    place = call.place(0)
    free = place.get() is False
    if not free and call.name.lower() == "waittestandset":
        call.remark(
            message(
                "rapid.nothing_releases",
                "{name} waits for what no other task releases: it goes on",
                name=call.name,
            ),
            lost=False,
        )
    place.set(True)
    return free


def _raise(controller: Controller, call: Call) -> None:
    raise WrongType(
        message(
            "rapid.raises_itself",
            "an error that the program raises itself: handlers of errors are not done",
        )
    )


_WITHOUT_EFFECT = re.findall(
    r"\w+",
    """tperase tpshow pathresol isleep iwatch idelete idisable ienable errwrite open close write retry trynext
    bookerrno errlog setsysdata cornerpathwarning skipwarn""",
)
"""What changes nothing of what the robot does."""
_OF_ZONES = re.findall(
    r"\w+",
    "wzboxdef wzcyldef wzsphdef wzhomejointdef wzlimjointdef wzlimsup wzdoset wzenable wzdisable wzfree",
)
_OF_UNITS = message(
    "rapid.no_external_axes", "there are no external axes, nor other mechanical units"
)

INSTRUCTIONS: Mapping[str, Instruction] = {
    **dict.fromkeys(_WITHOUT_EFFECT, lambda controller, call: None),
    "waitrob": lambda controller, call: controller.finish(),  # which ends a zone: the robot rests
    "stop": _remarking(
        message(
            "rapid.goes_on_at_once",
            "a controller stands still until somebody goes on; the program goes on here at once",
        )
    ),
    **dict.fromkeys(
        ("startmove", "clearpath"),
        _remarking(
            message(
                "rapid.path_not_kept",
                "a path that was stopped is not kept; moves go on here at once",
            )
        ),
    ),
    **dict.fromkeys(
        ("eoffson", "eoffsoff", "eoffsset"),
        _remarking(
            message(
                "rapid.displaces_external_axes",
                "it displaces external axes; {reason}",
                reason=_OF_UNITS,
            )
        ),
    ),
    **dict.fromkeys(("actunit", "deactunit", "mechunitload"), _remarking(_OF_UNITS)),
    **dict.fromkeys(
        ("syncmoveon", "syncmoveoff", "syncmoveundo", "waitsynctask"),
        _remarking(
            message(
                "rapid.no_other_task",
                "no other task runs, for which a controller would wait, and whose moves would take as long",
            )
        ),
    ),
    "waittestandset": _test_and_set,
    **dict.fromkeys(
        _OF_ZONES,
        _remarking(
            message(
                "rapid.zones_not_watched",
                "world zones are not watched; monitors of a station can do that",
            )
        ),
    ),
    "worldacclim": _remarking(
        message(
            "rapid.acceleration_unbounded",
            "acceleration in the world is not bounded by it; PathAccLim bounds that of the tool",
        )
    ),
    "singarea": _remarking(
        message("rapid.keeps_orientation", "the tool keeps its orientation near singularities"),
        unless="off",
    ),
    "circpathmode": _remarking(
        message("rapid.turns_evenly", "the tool turns evenly along an arc"), unless="pathframe"
    ),
    "motionsup": _remarking(
        message(
            "rapid.no_torque_watched",
            "no torque is watched, and no collision stops a move; monitors of a station can do that",
        )
    ),
    "softdeact": _remarking(
        message("rapid.stiff_as_servos", "axes are as stiff as the station's servos")
    ),
    "moveabsj": _move(MoveAbsJ),
    "movej": _move(MoveJ),
    "movel": _move(MoveL),
    "movec": _move(MoveC),
    "movejdo": _move(MoveJ, signal=True),
    "moveldo": _move(MoveL, signal=True),
    "movecdo": _move(MoveC, signal=True),
    "waittime": lambda controller, call: controller.wait(call.value(0, "num")),
    "set": _set_to(1.0),
    "reset": _set_to(0.0),
    **dict.fromkeys(("setdo", "setgo", "setao"), _set),
    "pulsedo": _pulse,
    "invertdo": lambda controller, call: controller.put(
        call, call.signal(), 1.0 - controller.read(call, call.signal())
    ),
    **dict.fromkeys(("waitdi", "waitdo", "waitgi", "waitai"), _wait_signal),
    "waituntil": _wait_condition,
    "raise": _raise,
    "accset": _acc_set,
    "gripload": _grip_load,
    "velset": _vel_set,
    "pathacclim": _path_acc_lim,
    "confj": _configured("j"),
    "confl": _configured("l"),
    "tpwrite": _write,
    **dict.fromkeys(("tpreadfk", "tpreadnum", "tpreaddnum"), _ask),
    "incr": _counted(lambda call: 1.0),
    "decr": _counted(lambda call: -1.0),
    "add": _counted(lambda call: call.value(1, "num")),
    "clear": _counted(lambda call: -call.place(0).get()),  # type: ignore[operator]
    **dict.fromkeys(("clkreset", "clkstart", "clkstop"), _clock),
}
"""By name in lower case."""

FUNCTIONS_OF_CONTROLLER: Mapping[str, Callable[[Controller, Call], Value]] = {
    "crobt": _c_robt,
    "cjointt": _c_joint,
    "cpos": lambda controller, call: _c_robt(controller, call)["trans"],  # type: ignore[index,call-overload]
    "calcjointt": _calc_joint,
    "calcrobt": _calc_robt,
    "clkread": _clk_read,
    "testandset": _test_and_set,
    "testdi": lambda controller, call: _read(controller, call) == 1.0,
    **dict.fromkeys(("dinput", "doutput", "ginput", "goutput", "ainput", "aoutput"), _read),
}
"""Likewise."""
