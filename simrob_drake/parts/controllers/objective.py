r"""A loop that brings a measured quantity to a value by joints that move in given proportions.

The thesis's automatic control with an objective (p. 102 to 107): no joint angles are given, the robot finds its own.
An axis of weight :math:`w_i` moves by :math:`\Delta q_i = w_i u`, with the u of a :class:`PiLaw`.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator
from pydrake import symbolic
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import SymbolicVectorSystem

from simrob_drake.base.errors import InvalidParameter, UnknownName
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.base.sections import NotNegative, Number, Positive
from simrob_drake.base.signals import Signal
from simrob_drake.blocks.block import add_matrix_gain
from simrob_drake.blocks.sampled import Changes, Named, SampledBlock
from simrob_drake.parts.controllers.flow_blocks import chosen, largest, least
from simrob_drake.parts.controllers.loop import LoopPorts, LoopSection
from simrob_drake.parts.resolved import ResolvedRobot
from simrob_drake.parts.site import Site
from simrob_drake.parts.station_plant import StationRobot

MEMORY = ("integral", "asked", "effort", "number", "held", "begun")
"""What the law remembers: x, what is asked for, u, the number of the target, how long it has been asked for [s], and
whether there was a sample before; all zero at the start."""


@dataclass(frozen=True, kw_only=True)
class PiLaw:
    r"""How far an axis of weight 1 moves, said once for plain numbers and for expressions that need no Python.

    With the error e of a quantity against what is asked for, which goes to its targets one after the other,

    .. math:: u = \mathrm{clip}\bigl(k_p e + x\bigr), \qquad \dot x = k_i e,

    where x stands still while u is at its limit, or at its fastest, and e would drive it on.
    """

    period: float  # between samples [s]
    targets: Sequence[float]  # values of the quantity, one after the other
    hold: float = math.inf  # how long each is asked for, from when its ramp ends [s]
    speed: float = math.inf  # of what is asked for, on its way there [1/s]
    gains: tuple[float, float]  # kp [rad per unit] and ki [rad/s per unit]
    limit: float  # how far it moves [rad]
    fastest: float  # how fast [rad/s]

    def next(self, measured: Any, memory: Mapping[str, Any]) -> tuple[dict[str, Any], Any]:
        """Return the memory after a sample, by names, and the target: of numbers or of expressions alike."""
        number, held, setpoint, before = (memory[name] for name in ("number", "held", "asked", "effort"))
        if len(self.targets) > 1:
            due = held >= self.hold
            number = chosen(due, least(number + 1.0, len(self.targets) - 1.0), number)
            held = chosen(due, 0.0, held)
        target = self.targets[0]
        for place, value in enumerate(self.targets[1:], 1):
            target = chosen(number >= place, value, target)
        if math.isinf(self.speed):
            setpoint = target
        else:
            step, setpoint = self.speed * self.period, chosen(memory["begun"] > 0.5, setpoint, measured)
            setpoint = least(largest(target, setpoint - step), setpoint + step)
        held = chosen(setpoint == target, held + self.period, 0.0)
        error, (kp, ki), step = setpoint - measured, self.gains, self.fastest * self.period
        grown = memory["integral"] + ki * error * self.period
        desired = kp * error + grown
        effort = least(least(largest(largest(desired, before - step), -self.limit), before + step), self.limit)
        integral = chosen((desired - effort) * error <= 0, grown, memory["integral"])  # else it would wind up
        values = (integral, setpoint, effort, number, held, 1.0)
        return dict(zip(MEMORY, values, strict=True)), target

    def system(self) -> SymbolicVectorSystem:
        """Return it as a block of Drake's: in the quantity (1), out u and e (2)."""
        measured, error = symbolic.Variable("measured"), symbolic.Variable("error")
        memory = {name: symbolic.Variable(name) for name in MEMORY}
        known = {name: symbolic.Expression(variable) for name, variable in memory.items()}
        new, _ = self.next(symbolic.Expression(measured), known)
        zero = symbolic.Expression(0.0)
        dynamics = [zero + value for value in (*new.values(), new["asked"] - measured)]
        return SymbolicVectorSystem(
            input=[measured],
            state=[*memory.values(), error],
            dynamics=dynamics,
            output=[known["effort"], symbolic.Expression(error)],
            time_period=self.period,
        )


class Objective(LoopSection):
    """Bring a signal of the station, such as the height of the base, to a value; then perhaps take a posture."""

    label: ClassVar[str] = message("parts.loop_objective", "objective")
    stages: ClassVar[tuple[str, ...]] = (
        message("parts.stage_signal_error", "Error of the signal"),
        message("parts.stage_law", "PI law"),
        message("parts.stage_weights", "Weights of the joints"),
    )

    kind: Literal["objective"]
    measures: str
    """What is to be brought there: a column of `signals.csv`, such as `base.z`, `tcp.z` or `force.tip.z`."""
    target: Number | list[Number]
    """The value, in the unit of the column; several in a list are asked for one after the other."""
    hold: Positive = 2.0
    """How long each of several is asked for, from when its ramp ends [s]."""
    speed: Positive | None = None
    """How fast the value that is asked for goes there from where it is at the start [1/s]; at once unless given."""
    weights: dict[str, Number] = Field(min_length=1)
    """By how much each axis takes part, by name: in which proportions, and in which sense, they raise the quantity."""
    kp: NotNegative = 0.0
    """How far an axis of weight 1 moves for an error [deg or m per unit of the column]."""
    ki: NotNegative = 0.0
    """How fast it moves for an error [deg/s or m/s per unit]."""
    limit_deg: Positive = 90.0
    """How far an axis of weight 1 may move [deg, or m where it slides]."""
    rate_deg: Positive = 60.0
    """How fast [deg/s or m/s]."""
    tolerance: Positive | None = None
    """How near is near enough, for the posture [unit of the column]."""
    settled: NotNegative = 0.5
    """How long it must be that near [s]."""
    then_deg: dict[str, Number] = Field(default_factory=dict)
    """Where other axes go once that is so, by name."""
    then_duration: NotNegative = 1.0
    """How long they take [s]."""

    @model_validator(mode="after")
    def _can_act(self) -> "Objective":
        if self.target == []:
            raise ValueError(message("parts.empty_target", "target is an empty list: nothing is asked for"))
        if not any(self.weights.values()):
            raise ValueError(message("parts.weights_all_zero", "weights are all zero: no axis would move"))
        if self.kp == 0 and self.ki == 0:
            raise ValueError(message("parts.gains_both_zero", "kp and ki are both zero: nothing would move"))
        if self.then_deg and self.tolerance is None:
            raise ValueError(message("parts.then_deg_needs_tolerance", "then_deg needs a tolerance"))
        return self

    @property
    def read_names(self) -> list[str]:
        """What it reads by names of the user's."""
        return [*super().read_names, self.measures]

    def axes(self, robot: ResolvedRobot) -> Sequence[str]:
        """Return the axes with weights, and those of the posture."""
        moved = [robot.axes[robot.model.axis_index(axis, "weights")] for axis in self.weights]
        return [*moved, *self.target_axes(robot)]

    def target_axes(self, robot: ResolvedRobot) -> Sequence[str]:
        """Return the axes of the posture."""
        return [robot.axes[robot.model.axis_index(axis, "then_deg")] for axis in self.then_deg]

    def source(self, builder: DiagramBuilder, name: str, robot: StationRobot, site: Site, key: str) -> OutputPort:
        """Return what an input reads; ``measured`` is one entry of an output."""
        if name != "measured" or name in self.reads:
            return super().source(builder, name, robot, site, key)
        signal, entry = self._measured(site, key)
        site.picture.draw_nothing(f"{key}.measured")
        if signal.output in site.outputs.of_state:
            matrix = site.outputs.of_state[signal.output].matrix(site.state.size())
            return add_matrix_gain(builder, f"{key}.measured", matrix[[entry]], site.state)
        output = super().source(builder, signal.output, robot, site, key)
        return add_matrix_gain(builder, f"{key}.measured", np.eye(output.size())[[entry]], output)

    def _measured(self, site: Site, key: str) -> tuple[Signal, int]:
        """Return the signal that the column belongs to, and its place in the output."""
        measured = [signal for signal in site.outputs.signals if signal.output in site.outputs]
        for signal in measured:
            if self.measures in signal.names:
                place = signal.names.index(self.measures)
                return signal, place if signal.entries is None else signal.entries[place]
        known = [column for signal in measured for column in signal.names]
        raise UnknownName(
            message("parts.signal_for_measures", "signal of the station for {key}.measures", key=key),
            self.measures,
            known,
        )

    def wire(self, builder: DiagramBuilder, name: str, robot: StationRobot, site: Site) -> LoopPorts:
        """Add the loop; without a posture it is one of expressions, for which no Python is asked while stepping.

        Drake's integrators ask every system for derivatives, which sampled expressions refuse: there it is the block.
        """
        engine = site.station.engine
        is_integrated = engine.moves_by_forces and not engine.has_discrete_states and not engine.holds_inputs_over_steps
        if self.then_deg or is_integrated:
            return super().wire(builder, name, robot, site)
        law, weights, unit = self._law(f"controllers.{name}", robot, site)
        system = builder.AddNamedSystem(f"controller.{name}", law.system())
        part, output = f"controller.{name}", system.get_output_port()
        outputs = {
            "offset": add_matrix_gain(builder, f"{part}.offset", np.outer(weights, [1.0, 0.0]), output),
            "error": add_matrix_gain(builder, f"{part}.error", np.array([[0.0, 1.0]]), output),
        }
        return LoopPorts({"measured": system.get_input_port()}, outputs, {"offset": "rad", "error": unit})

    def _block(self, key: str, robot: StationRobot, site: Site) -> SampledBlock:
        law, weights, unit = self._law(key, robot, site)
        posture = robot.model.user_units * robot.model.axis_vector(dict(self.then_deg), f"{key}.then_deg")
        return WeightedObjective(
            law=law,
            weights=weights,
            posture=posture if self.then_deg else None,
            near=(self.tolerance or 0.0, self.settled),
            duration=self.then_duration,
            unit=unit,
        )

    def _law(self, key: str, robot: StationRobot, site: Site) -> tuple[PiLaw, Vector, str]:
        """Return the law, the weights of all axes, shape (n,), and the unit of the error."""
        model, weights = robot.model, robot.model.axis_vector(dict(self.weights), f"{key}.weights")
        units = set(model.user_units[weights != 0])
        if len(units) > 1:
            raise InvalidParameter(
                f"{key}.weights",
                message("parts.axes_of_both_sorts", "of axes that turn and that slide"),
                message("parts.axes_of_one_sort", "of axes of one sort"),
            )
        unit = float(units.pop())
        unit_of_error = "1"
        if "measured" not in self.reads:
            signal, _ = self._measured(site, key)
            unit_of_error = signal.units[signal.names.index(self.measures)]
        law = PiLaw(
            period=1 / self.rate,
            targets=self.target if isinstance(self.target, list) else [self.target],
            hold=self.hold,
            speed=math.inf if self.speed is None else self.speed,
            gains=(unit * self.kp, unit * self.ki),
            limit=unit * self.limit_deg,
            fastest=unit * self.rate_deg,
        )
        return law, weights, unit_of_error


class WeightedObjective(SampledBlock):
    """PI control of one quantity by joints in given proportions.

    Ports:
        in  ``measured`` (1); ``reference`` (n) [rad]: where the posture's ramp begins.
        out ``offset`` (n) [rad]: to be added to the reference; ``error`` (1): of the quantity, against what is asked
        for now; ``target`` (n) [rad] and ``active`` (1): the posture, once the objective is met, if there is one.
    """

    def __init__(
        self,
        *,
        law: PiLaw,
        weights: Vector,
        posture: Vector | None = None,
        near: tuple[float, float] = (math.inf, 0.0),
        duration: float = 1.0,
        unit: str = "1",
    ) -> None:
        """Make the block of a law of how far an axis of weight 1 moves, and the weights of all axes (n,).

        The posture (n,) [rad] is taken once the quantity was so ``near`` its target for so long [s], on a way of a
        duration [s].
        """
        self.units = {"offset": "rad", "target": "rad", "error": unit}
        self._law, self._weights = law, weights
        self._posture, self._near, self._duration = posture, near, duration
        zero, one = np.zeros(len(weights)), np.zeros(1)
        memory = {"offset": zero, "error": one, **dict.fromkeys(MEMORY, one)}
        if posture is not None:
            memory |= {"target": zero, "active": one, "origin": zero, "elapsed": one}
        super().__init__(
            period=law.period,
            reads={"measured": 1, **({} if posture is None else {"reference": len(weights)})},
            memory=memory,
            gives=("offset", "error", *(() if posture is None else ("target", "active"))),
        )

    def sample(self, memory: Named, read: Named) -> Changes:
        """Return how far the axes are to be moved now."""
        measured = read["measured"].item()
        new, target = self._law.next(measured, {name: memory[name].item() for name in MEMORY})
        moved: Changes = {**new, "offset": self._weights * new["effort"], "error": new["asked"] - measured}
        return {**moved, **self._posture_now(memory, read, measured - target)}

    def _posture_now(self, memory: Named, read: Named, left: float) -> Changes:
        """Return where the other axes are on their way to the posture, once the quantity has been near long enough."""
        if self._posture is None:
            return {}
        tolerance, settled = self._near
        elapsed = memory["elapsed"][0] + self.period
        if not memory["active"][0]:
            if abs(left) > tolerance:
                return {"elapsed": 0.0}
            if elapsed < settled:
                return {"elapsed": elapsed}
            return {"active": 1.0, "target": read["reference"], "origin": read["reference"], "elapsed": 0.0}
        part = min(elapsed / self._duration, 1.0) if self._duration > 0 else 1.0
        return {"target": memory["origin"] + part * (self._posture - memory["origin"]), "elapsed": elapsed}
