r"""Loop that brings a measured quantity to a desired value by joints that move in given proportions.

No joint angles are given: the robot finds its own (the thesis, automatic control with an objective, p. 102 to 107). The
*quantity* is any column of the station's results, such as the height of the base. Its desired value at the moment is
the *setpoint*, which moves to the *targets* of the section, one after the other. A PI law computes the *effort* u from
the error of the quantity, and an axis of weight :math:`w_i` moves by :math:`\Delta q_i = w_i u`. For prismatic axes,
read m for rad.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field, model_validator
from pydrake import symbolic
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import SymbolicVectorSystem

from simrob_drake.base.errors import UnknownName, Unsuitable
from simrob_drake.base.frames import Vector
from simrob_drake.base.messages import message
from simrob_drake.base.sections import NotNegative, Number, Positive
from simrob_drake.blocks.block import add_matrix_gain
from simrob_drake.blocks.sampled import Changes, Named, SampledBlock
from simrob_drake.parts.controllers.flow_blocks import choose, maximum, minimum
from simrob_drake.parts.controllers.loop import LoopPorts, LoopSection
from simrob_drake.parts.resolved import ResolvedRobot
from simrob_drake.parts.site import Site
from simrob_drake.parts.station_plant import StationRobot


class PiMemory(NamedTuple):
    """Values that a `PiLaw` keeps from one sample to the next: numbers, or symbolic expressions of Drake.

    All are zero at the start of a run.

    Attributes:
        integral: integral part x of the effort [rad].
        setpoint: value that is asked for now [unit of the quantity].
        effort: effort u, the distance by which an axis of weight 1 moves [rad].
        target_index: index of the present target.
        held: time for which the setpoint has been at the target [s].
        has_begun: 1 after the first sample, 0 before it.
    """

    integral: Any
    setpoint: Any
    effort: Any
    target_index: Any
    held: Any
    has_begun: Any


@dataclass(frozen=True, kw_only=True)
class PiLaw:
    r"""PI law for the effort u, by which an axis of weight 1 moves.

    With the error e, the setpoint minus the measured quantity,

    .. math:: u = \mathrm{clip}\bigl(k_p e + x\bigr), \qquad \dot x = k_i e.

    Clip limits both u and its rate. While it does, x does not change if e would drive u further beyond the limit.

    The law computes with numbers and with symbolic expressions of Drake alike, by the same code: so a diagram can have
    it as a system of Drake's, which calls no Python while it is stepped. An expression has no value to branch on:
    conditions are calls of `choose`, not ``if`` statements.

    Attributes:
        period: time between two samples [s].
        targets: desired values of the quantity, one after the other.
        hold: time for which the setpoint stays at each target [s].
        speed: speed of the setpoint on its way to a target [unit of the quantity per second]. If it is infinite, the
            setpoint jumps.
        kp: proportional gain [rad per unit of the quantity].
        ki: integral gain [rad/s per unit of the quantity].
        limit: largest effort [rad].
        fastest: largest rate of the effort [rad/s].
    """

    period: float
    targets: Sequence[float]
    hold: float = math.inf
    speed: float = math.inf
    kp: float
    ki: float
    limit: float
    fastest: float

    def next(self, measured: Any, memory: PiMemory) -> PiMemory:
        """Compute the memory after a sample.

        Args:
            measured: the quantity at the sample [unit of the quantity], a number or an expression.
            memory: memory before the sample.
        """
        target_index = memory.target_index
        held = memory.held
        # A single target needs no terms for the change to the next one: shorter expressions are faster.
        if len(self.targets) > 1:
            is_over = held >= self.hold
            # The last target stays.
            next_index = minimum(target_index + 1.0, len(self.targets) - 1.0)
            target_index = choose(is_over, next_index, target_index)
            held = choose(is_over, 0.0, held)
        target = self.target(target_index)
        setpoint = self._next_setpoint(measured, memory, target)
        held = choose(setpoint == target, held + self.period, 0.0)

        # u = clip(kp e + x), with the new x. Keep the order of the arithmetic: results are compared to the last bit.
        error = setpoint - measured
        grown_integral = memory.integral + self.ki * error * self.period
        desired_effort = self.kp * error + grown_integral
        effort = self._clip(desired_effort, memory.effort)

        # Anti-windup: x takes its new value unless the clipped part of the effort has the sign of the error.
        clipped_part = desired_effort - effort
        integral = choose(clipped_part * error <= 0, grown_integral, memory.integral)
        return PiMemory(
            integral=integral,
            setpoint=setpoint,
            effort=effort,
            target_index=target_index,
            held=held,
            has_begun=1.0,
        )

    def target(self, target_index: Any) -> Any:
        """Target of an index from 0, which may be an expression [unit of the quantity]."""
        # An index that is an expression cannot index a list: the last target whose index is reached remains.
        target: Any = self.targets[0]
        for index, value in enumerate(self.targets[1:], 1):
            target = choose(target_index >= index, value, target)
        return target

    def _next_setpoint(self, measured: Any, memory: PiMemory, target: Any) -> Any:
        """Move the setpoint towards the target, by the distance of one period at most.

        Without a limit of its speed it jumps. Otherwise it starts at the measured quantity of the first sample.
        """
        if math.isinf(self.speed):
            return target
        largest_step = self.speed * self.period
        # `has_begun` is 0 at the first sample, at which there is no setpoint yet.
        last_setpoint = choose(memory.has_begun > 0.5, memory.setpoint, measured)
        not_too_low = maximum(target, last_setpoint - largest_step)
        return minimum(not_too_low, last_setpoint + largest_step)

    def _clip(self, desired_effort: Any, last_effort: Any) -> Any:
        """Limit an effort [rad], and its change since the effort at the last sample."""
        largest_step = self.fastest * self.period
        # The last effort is within the limit, so both bounds can be kept.
        not_too_low = maximum(maximum(desired_effort, last_effort - largest_step), -self.limit)
        return minimum(minimum(not_too_low, last_effort + largest_step), self.limit)

    def make_system(self) -> SymbolicVectorSystem:
        """Create the law as a system of Drake's.

        Its input is the measured quantity (1), its output (2) the effort u [rad] and the error e [unit of the
        quantity]. Its discrete state is the memory of the law, in the order of `PiMemory`, then the error.
        """
        measured = symbolic.Variable("measured")
        error = symbolic.Variable("error")
        variables = [symbolic.Variable(name) for name in PiMemory._fields]
        memory = PiMemory._make(symbolic.Expression(variable) for variable in variables)
        new_memory = self.next(symbolic.Expression(measured), memory)
        new_error = new_memory.setpoint - measured
        # The sums below make expressions of plain numbers, which Drake does not accept as dynamics. The error is a
        # state, too, since an output must hold between samples.
        zero = symbolic.Expression(0.0)
        return SymbolicVectorSystem(
            input=[measured],
            state=[*variables, error],
            dynamics=[zero + value for value in (*new_memory, new_error)],
            output=[memory.effort, symbolic.Expression(error)],
            time_period=self.period,
        )


class _Column(NamedTuple):
    """Column of the results whose value the loop controls.

    Attributes:
        output: name of the station's output that contains the value.
        entry: index of the value in the vector of that output.
        unit: unit of the value.
    """

    output: str
    entry: int
    unit: str


class Objective(LoopSection):
    """Bring a signal of the station, such as the height of the base, to a value; then perhaps take a posture."""

    label: ClassVar[str] = message("parts.loop_objective", "objective")
    stages: ClassVar[tuple[str, ...]] = (
        message("parts.stage_signal_error", "Signal error"),
        message("parts.stage_law", "PI law"),
        message("parts.stage_weights", "Joint weights"),
    )

    kind: Literal["objective"]
    measures: str
    """Signal that is controlled: a column of `signals.csv`, such as `base.z`, `tcp.z` or `force.tip.z`."""
    target: Number | list[Number]
    """Desired value of the signal, in the unit of the column; several in a list are asked for one after the other."""
    hold: Positive = 2.0
    """Time for which each of several targets is asked for, from the end of its ramp [s]."""
    speed: Positive | None = None
    """Speed at which the value that is asked for moves to a target, at first from the value at the start [unit of the
    column per second]. If it is left out, the value jumps."""
    weights: dict[str, Number] = Field(min_length=1)
    """Weight of each axis that takes part, by name: the proportions and the directions in which axes raise the
    signal."""
    kp: NotNegative = 0.0
    """Distance by which an axis of weight 1 moves for an error [deg or m per unit of the column]."""
    ki: NotNegative = 0.0
    """Speed at which an axis of weight 1 moves for an error [deg/s or m/s per unit of the column]."""
    limit_deg: Positive = 90.0
    """Largest distance by which an axis of weight 1 moves [deg, or m for a prismatic axis]."""
    rate_deg: Positive = 60.0
    """Largest speed of an axis of weight 1 [deg/s, or m/s for a prismatic axis]."""
    tolerance: Positive | None = None
    """Distance from the target within which the posture of `then_deg` may begin [unit of the column]."""
    settled: NotNegative = 0.5
    """Time for which the signal must be within the tolerance [s]."""
    then_deg: dict[str, Number] = Field(default_factory=dict)
    """Posture of other axes after that, by name [deg, or m for a prismatic axis]."""
    then_duration: NotNegative = 1.0
    """Time that the axes take to the posture [s]."""

    @model_validator(mode="after")
    def _check_keys(self) -> "Objective":
        """Check that the section has a target, moves an axis, has a gain, and a tolerance if it has a posture.

        Raises:
            ValueError: one of these is missing.
        """
        if self.target == []:
            raise ValueError(
                message(
                    "parts.empty_target", "target is an empty list; it needs at least one value"
                )
            )
        if not any(self.weights.values()):
            raise ValueError(
                message(
                    "parts.weights_all_zero",
                    "all weights are 0; at least one axis must have a weight",
                )
            )
        if self.kp == 0 and self.ki == 0:
            raise ValueError(
                message(
                    "parts.gains_both_zero", "kp and ki are both 0; at least one must be positive"
                )
            )
        if self.then_deg and self.tolerance is None:
            raise ValueError(
                message("parts.then_deg_needs_tolerance", "then_deg needs the key tolerance")
            )
        return self

    @property
    def read_names(self) -> list[str]:
        """Names of the sensors, outputs and result columns that the loop reads, as the section writes them."""
        return [*super().read_names, self.measures]

    def axes(self, robot: ResolvedRobot) -> Sequence[str]:
        """Names of the axes that the loop moves: those with weights, then those of the posture.

        Raises:
            SimrobError: the section names an axis that the robot does not have.
        """
        # The section may write aliases, of which `axis_index` finds the axes.
        weighted = [robot.axes[robot.model.axis_index(axis, "weights")] for axis in self.weights]
        # The loop adds offsets to the former, and replaces the reference of the latter.
        return [*weighted, *self.target_axes(robot)]

    def target_axes(self, robot: ResolvedRobot) -> Sequence[str]:
        """Names of the axes whose reference the loop replaces: those of the posture."""
        return [robot.axes[robot.model.axis_index(axis, "then_deg")] for axis in self.then_deg]

    def source(
        self, builder: DiagramBuilder, name: str, robot: StationRobot, site: Site, key: str
    ) -> OutputPort:
        """Find the port that an input of the loop reads, for the input ``measured`` by adding a block.

        That block picks the value of the column `measures` from the output that contains it. It is left out if the
        section names a sensor or an output for ``measured`` under `reads`.

        Args:
            builder: builder of the diagram.
            name: name of the input.
            robot: robot that the loop drives.
            site: the station under construction.
            key: key of the section, ``controllers.<name>``.

        Raises:
            UnknownName: the station has no such output or column.
        """
        if name != "measured" or name in self.reads:
            return super().source(builder, name, robot, site, key)
        column = self._find_column(site, key)
        block_name = f"{key}.measured"
        site.picture.draw_nothing(block_name)
        rule = site.outputs.of_state.get(column.output)
        if rule is not None:
            # A row of the rule's matrix picks the value from the plant's state, which spares the block of the output.
            row = rule.matrix(site.state.size())[[column.entry]]
            return add_matrix_gain(builder, block_name, row, site.state)
        # The matrix with one row that picks one entry of the output, shape (1, size).
        output = super().source(builder, column.output, robot, site, key)
        row = np.eye(output.size())[[column.entry]]
        return add_matrix_gain(builder, block_name, row, output)

    def _find_column(self, site: Site, key: str) -> _Column:
        """Find the column that `measures` names.

        Args:
            site: the station under construction.
            key: key of the section, for errors.

        Raises:
            UnknownName: no output of the station has such a column.
        """
        known_names = list[str]()
        for signal in site.outputs.signals:
            # Columns that are only computed after a run have no output, and cannot be read during the run.
            if signal.output not in site.outputs:
                continue
            if self.measures in signal.names:
                # `entries` has the indices of the columns in the output, or is None if each entry is a column.
                index = signal.names.index(self.measures)
                entry = index if signal.entries is None else signal.entries[index]
                return _Column(output=signal.output, entry=entry, unit=signal.units[index])
            known_names += signal.names
        raise UnknownName(
            message(
                "parts.signal_for_measures", "signal of the station for {key}.measures", key=key
            ),
            self.measures,
            known_names,
        )

    def wire(
        self, builder: DiagramBuilder, name: str, robot: StationRobot, site: Site
    ) -> LoopPorts:
        """Add the loop to the diagram, and return its ports.

        Without a posture it is a system of Drake's, which calls no Python while it is stepped. Drake's integrators ask
        every system of a diagram for derivatives, which a sampled system of expressions refuses. With such an
        integrator, or with a posture, the loop is a `WeightedObjective`.

        Args:
            builder: builder of the diagram.
            name: name of the loop in the station file.
            robot: robot that the loop drives.
            site: the station under construction.

        Raises:
            SimrobError: no output has the column, some axes with weights turn and others slide, or the section names an
                axis that the robot does not have.
        """
        engine = site.station.engine
        # Whether an integrator of Drake's steps the whole diagram. An engine that holds inputs over steps integrates
        # the plant alone, and one with discrete states nothing.
        is_integrated = (
            engine.moves_by_forces
            and not engine.has_discrete_states
            and not engine.holds_inputs_over_steps
        )
        if self.then_deg or is_integrated:
            return super().wire(builder, name, robot, site)

        # The key is that of the section in the station's file, the other name that of the system in the diagram.
        key = f"controllers.{name}"
        block_name = f"controller.{name}"
        weights = self._weights(key, robot)
        law = self._law(key, robot, weights)
        error_unit = self._error_unit(key, site)
        system = builder.AddNamedSystem(block_name, law.make_system())
        effort_and_error = system.get_output_port()
        # The output of the law is (u, e): offset = weights u, and the error is e.
        to_offset = np.outer(weights, [1.0, 0.0])
        to_error = np.array([[0.0, 1.0]])
        return LoopPorts(
            inputs={"measured": system.get_input_port()},
            outputs={
                "offset": add_matrix_gain(
                    builder, f"{block_name}.offset", to_offset, effort_and_error
                ),
                "error": add_matrix_gain(
                    builder, f"{block_name}.error", to_error, effort_and_error
                ),
            },
            units={"offset": "rad", "error": error_unit},
        )

    def _block(self, key: str, robot: StationRobot, site: Site) -> SampledBlock:
        """Create the loop's block for its robot in the station under construction, the site. The key is for errors."""
        weights = self._weights(key, robot)
        law = self._law(key, robot, weights)
        error_unit = self._error_unit(key, site)
        posture = None
        if self.then_deg:
            assert self.tolerance is not None  # _check_keys() has checked it
            posture = FinalPosture(
                positions=robot.model.user_units
                * robot.model.axis_vector(dict(self.then_deg), f"{key}.then_deg"),
                tolerance=self.tolerance,
                settled=self.settled,
                duration=self.then_duration,
            )
        return WeightedObjective(law=law, weights=weights, posture=posture, error_unit=error_unit)

    def _weights(self, key: str, robot: StationRobot) -> Vector:
        """Spread the weights over the axes of a robot, shape (n,). Axes that are not named have the weight 0."""
        return robot.model.axis_vector(dict(self.weights), f"{key}.weights")

    def _error_unit(self, key: str, site: Site) -> str:
        """Unit of the error: that of the column, or 1 if the section reads another sensor or output in its place."""
        return "1" if "measured" in self.reads else self._find_column(site, key).unit

    def _law(self, key: str, robot: StationRobot, weights: Vector) -> PiLaw:
        """Create the law.

        Args:
            key: key of the section, for errors.
            robot: robot that the loop drives.
            weights: weights of its axes, shape (n,).

        Raises:
            Unsuitable: some of the axes with weights turn, others slide. The effort has only one unit.
        """
        user_units = set(robot.model.user_units[weights != 0])
        if len(user_units) > 1:
            raise Unsuitable(
                f"{key}.weights",
                message("parts.axes_of_both_sorts", "some of the axes turn, others are prismatic"),
                message("parts.axes_of_one_sort", "give weights to axes of one sort only"),
            )
        # The only unit left: rad per degree, or 1 for metres.
        user_unit = float(user_units.pop())
        return PiLaw(
            period=1 / self.rate,
            targets=self.target if isinstance(self.target, list) else [self.target],
            hold=self.hold,
            speed=math.inf if self.speed is None else self.speed,
            kp=user_unit * self.kp,
            ki=user_unit * self.ki,
            limit=user_unit * self.limit_deg,
            fastest=user_unit * self.rate_deg,
        )


@dataclass(frozen=True, kw_only=True)
class FinalPosture:
    """Posture that some axes take once the quantity has come to its target.

    Attributes:
        positions: positions of all n axes in the posture, shape (n,) [rad]; of no effect for the other axes.
        tolerance: distance from the target within which the quantity must be [unit of the quantity].
        settled: time for which it must be there [s].
        duration: time that the axes take to the posture [s].
    """

    positions: Vector
    tolerance: float
    settled: float = 0.0
    duration: float = 1.0


class WeightedObjective(SampledBlock):
    """PI control of one quantity by joints in given proportions.

    Ports:
        in  ``measured`` (1): the quantity; with a posture also ``reference`` (n) [rad]: start of the ramp to it.
        out ``offset`` (n) [rad], added to the reference; ``error`` (1): setpoint minus quantity; with a posture also
        ``target`` (n) [rad]: positions on the way to it, which replace the reference while ``active`` (1) is 1.
    """

    def __init__(
        self,
        *,
        law: PiLaw,
        weights: Vector,
        posture: FinalPosture | None = None,
        error_unit: str = "1",
    ) -> None:
        """Create the block.

        Args:
            law: law for the effort.
            weights: weights of all axes, shape (n,).
            posture: posture to take at the target, or None if there is none.
            error_unit: unit of the quantity.
        """
        self.units = {"offset": "rad", "target": "rad", "error": error_unit}
        self._law = law
        self._weights = weights
        self._posture = posture
        zeros = np.zeros(len(weights))
        zero = np.zeros(1)
        reads = {"measured": 1}
        outputs = {"offset": zeros, "error": zero}
        more_memory = dict.fromkeys(PiMemory._fields, zero)
        if posture is not None:
            reads["reference"] = len(weights)
            outputs |= {"target": zeros, "active": zero}
            more_memory |= {
                "origin": zeros,  # reference at the start of the ramp to the posture [rad]
                "elapsed": zero,  # time within the tolerance; once active, time since the start of the ramp [s]
            }
        super().__init__(
            period=law.period, reads=reads, memory={**outputs, **more_memory}, gives=tuple(outputs)
        )

    def sample(self, memory: Named, read: Named) -> Changes:
        """Compute the offsets of the axes, and with a posture the next positions on the way to it.

        Args:
            memory: memory before the sample.
            read: inputs of the block.

        Returns:
            The new values of the memory.
        """
        measured = read["measured"].item()
        # Arithmetic with plain numbers is faster than with those of NumPy.
        last = PiMemory._make([memory[name].item() for name in PiMemory._fields])
        new = self._law.next(measured, last)
        changes: dict[str, Vector | float] = new._asdict()
        changes["offset"] = self._weights * new.effort
        changes["error"] = new.setpoint - measured
        if self._posture is not None:
            distance = abs(measured - self._law.target(new.target_index))
            changes.update(self._move_to_posture(self._posture, memory, read, distance))
        return changes

    def _move_to_posture(
        self, posture: FinalPosture, memory: Named, read: Named, distance: float
    ) -> Changes:
        """Wait until the quantity has settled, then move the axes to the posture.

        Args:
            posture: the posture.
            memory: memory before the sample.
            read: inputs of the sample.
            distance: distance of the quantity from its target, not from the setpoint [unit of the quantity].

        Returns:
            The new values of the memory. Once the axes move to the posture, the distance has no effect any more.
        """
        elapsed = memory["elapsed"][0] + self.period
        if not memory["active"][0]:
            if distance > posture.tolerance:
                return {"elapsed": 0.0}
            if elapsed < posture.settled:
                return {"elapsed": elapsed}
            # The ramp starts where the axes are asked to be, so that they do not jump.
            start = read["reference"]
            return {"active": 1.0, "target": start, "origin": start, "elapsed": 0.0}
        part = min(elapsed / posture.duration, 1.0) if posture.duration > 0 else 1.0
        origin = memory["origin"]
        return {"target": origin + part * (posture.positions - origin), "elapsed": elapsed}
