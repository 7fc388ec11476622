"""Loops alone, sample by sample: what one remembers is given in, what changes comes out."""

import numpy as np
import pytest

from simrob_drake.blocks.sampled import RunEnds, SampledBlock
from simrob_drake.parts.controllers.objective import FinalPosture, PiLaw, WeightedObjective
from simrob_drake.parts.controllers.postures import (
    CellSequence,
    FallGuard,
    ProtectivePosture,
    Sequencer,
)
from simrob_drake.parts.controllers.support import Limb
from simrob_drake.parts.controllers.touchdown import Touchdown, UnknownGround

NAN = np.nan


class Driven:
    """A loop whose inputs are set by the test."""

    def __init__(self, loop: SampledBlock) -> None:
        """Begin with the loop's initial memory."""
        self.loop = loop
        self.context = loop.CreateDefaultContext()

    def sample(self, **read):
        """Take one sample with these inputs, and return the loop's outputs by name."""
        for name, value in read.items():
            self.loop.GetInputPort(name).FixValue(self.context, np.atleast_1d(value))
        update = self.loop.EvalUniquePeriodicDiscreteUpdate(self.context)
        self.context.get_mutable_discrete_state().SetFrom(update)
        ports = [self.loop.get_output_port(index) for index in range(self.loop.num_output_ports())]
        return {port.get_name(): port.Eval(self.context) for port in ports}


RAMP_SAMPLES = 5  # samples of the first cell's ramp: 0.5 s at 10 Hz
TOLERANCE = 0.05  # rad
LARGEST_SPEED = 0.2  # rad/s


def two_cells(**changed):
    """A sequence for the axes hip and knee: the hip to 1 rad within 0.5 s, then the knee to -0.5 rad at once."""
    cells = [
        {"targets_deg": {"hip": 1}, "duration": 0.5},
        {"targets_deg": {"knee": 1}, "duration": 0.0},
    ]
    section = Sequencer.model_validate({"kind": "sequencer", "rate": 10, "cells": cells, **changed})
    return CellSequence(
        section,
        targets=[np.array([1.0, NAN]), np.array([NAN, -0.5])],
        tolerance=np.full(2, TOLERANCE),
        largest_speed=np.full(2, LARGEST_SPEED),
        axes=["hip", "knee"],
    )


class TestCellSequence:
    """A sequence of cells, from the reference [0.2, 0.1] rad."""

    START = np.array([0.2, 0.1])  # rad

    @property
    def at_start(self):
        """Inputs of a robot that stands still at the start."""
        return {"position": self.START, "velocity": np.zeros(2), "reference": self.START}

    def after_first_ramp(self):
        """A sequence whose first ramp has just ended, while the robot has not moved."""
        driven = Driven(two_cells())
        for _ in range(1 + RAMP_SAMPLES):
            driven.sample(**self.at_start)
        return driven

    def test_the_first_target_is_the_reference(self):
        """The loop takes over without a jump."""
        first = Driven(two_cells()).sample(**self.at_start)

        assert first["target"] == pytest.approx(self.START)
        assert first["active"] == 1

    def test_a_ramp_moves_at_constant_speed_and_other_axes_stay(self):
        """The target is o + t / T (g - o); an axis without a target keeps its reference."""
        driven = Driven(two_cells())
        driven.sample(**self.at_start)

        for sample in range(1, RAMP_SAMPLES + 1):
            target = driven.sample(**self.at_start)["target"]
            assert target == pytest.approx([0.2 + 0.8 * sample / RAMP_SAMPLES, 0.1])

    @pytest.mark.parametrize(
        ("position", "speed", "cell"),
        [
            (1.0 - 1.2 * TOLERANCE, 0.0, 0),  # too far from the target
            # an axis is too fast, even one without a target
            (
                1.0 - 0.8 * TOLERANCE,
                1.5 * LARGEST_SPEED,
                0,
            ),
            (1.0 - 0.8 * TOLERANCE, 0.5 * LARGEST_SPEED, 1),
        ],
    )
    def test_the_next_cell_begins_once_all_axes_are_near_and_slow(self, position, speed, cell):
        """A cell that is not reached lasts for ever if there is no timeout."""
        driven = self.after_first_ramp()

        for _ in range(20):
            outputs = driven.sample(
                position=[position, 0.1], velocity=[0.0, speed], reference=self.START
            )
            if cell:
                break

        assert outputs["cell"] == cell

    def test_a_ramp_begins_at_the_goal_of_the_last_cell_and_the_last_cell_ends_the_sequence(self):
        """A cell without a duration jumps to its targets; the sequence is done once they are reached."""
        driven = self.after_first_ramp()
        at_first_goal = {**self.at_start, "position": [1.0, 0.1]}
        driven.sample(**at_first_goal)

        second = driven.sample(**at_first_goal)
        last = driven.sample(**{**self.at_start, "position": [1.0, -0.5]})

        assert second["target"] == pytest.approx([1.0, -0.5])
        assert second["done"] == 0
        assert (last["cell"], last["done"]) == (1, 1)


AT_ZERO = {"position": np.zeros(2), "velocity": np.zeros(2), "reference": np.zeros(2)}
LATE_MEMORY = {
    "target": np.zeros(2),
    "active": np.ones(1),
    "cell": np.zeros(1),
    "done": np.zeros(1),
    "elapsed": np.array([0.95]),  # the next sample is at 1.05 s
    "origin": np.zeros(2),
    "clock": np.ones(1),
    "reached": np.full(2, -1.0),
}


class TestTimeoutOfACell:
    """A cell whose robot has not moved when its time of 1 s is over."""

    def test_it_ends_the_run_and_names_the_late_joint(self):
        """The knee has no target in this cell, so only the hip is late."""
        loop = two_cells(timeout=1.0)

        with pytest.raises(RunEnds, match="cell 0 was not reached within 1 s; late: hip"):
            loop.sample(LATE_MEMORY, AT_ZERO)

    def test_it_begins_the_next_cell_if_the_section_asks_for_that(self):
        """The cell does not count as reached."""
        changes = two_cells(timeout=1.0, on_timeout="go_on").sample(LATE_MEMORY, AT_ZERO)

        assert changes["cell"] == 1
        assert "reached" not in changes

    def test_the_run_ends_after_the_last_cell_if_the_section_asks_for_that(self):
        """The first sample after the last cell ends the run."""
        done = {**LATE_MEMORY, "done": np.ones(1)}

        with pytest.raises(RunEnds, match="the last of 2 cells is reached"):
            two_cells(ends=True).sample(done, AT_ZERO)


def guard(*, toward=None, **changed):
    """A guard of two axes: below 0.4 m, or at a lean of more than 0.5 rad, it moves them to [1, -1] rad in 0.2 s."""
    keys = {"height": 0.4, "tilt_deg": np.rad2deg(0.5), "posture_deg": {"hip": 1}, **changed}
    section = FallGuard.model_validate({"kind": "fall_guard", "rate": 10, **keys})
    return ProtectivePosture(
        section, posture=np.array([1.0, -1.0]), up=np.array([0.0, 0.0, 1.0]), toward=toward
    )


# Poses x y z [m] qw qx qy qz of a base that is just high enough, and one that is too low.
UPRIGHT = np.array([0, 0, 0.41, 1, 0, 0, 0.0])
LOW = np.array([0, 0, 0.39, 1, 0, 0, 0.0])


def leaning(angle):
    """Pose of a base that is high enough and leans by an angle [rad] about y; a positive angle leans along x."""
    return np.array([0, 0, 0.41, np.cos(angle / 2), 0, np.sin(angle / 2), 0.0])


class TestFallGuard:
    """A guard against falls whose robot is asked to stand at [0.2, 0.2] rad."""

    REFERENCE = np.array([0.2, 0.2])  # rad

    @pytest.mark.parametrize(
        ("pose", "acts"),
        [
            (UPRIGHT, 0),
            (leaning(0.49), 0),
            (leaning(-0.49), 0),
            (LOW, 1),
            (leaning(0.51), 1),
            (leaning(-0.51), 1),
        ],
    )
    def test_it_acts_beyond_its_bounds(self, pose, acts):
        """The height and the lean to either side each have a bound."""
        outputs = Driven(guard()).sample(base_pose=pose, reference=self.REFERENCE)

        assert outputs["active"] == acts

    def test_it_ramps_from_the_reference_to_the_posture_and_stays_there(self):
        """The ramp continues although the base is high again: only a reset ends it."""
        driven = Driven(guard())

        first = driven.sample(base_pose=LOW, reference=self.REFERENCE)
        halfway = driven.sample(base_pose=UPRIGHT, reference=self.REFERENCE)
        for _ in range(20):
            last = driven.sample(base_pose=UPRIGHT, reference=self.REFERENCE)

        assert first["target"] == pytest.approx(self.REFERENCE)
        assert halfway["target"] == pytest.approx([0.6, -0.4])
        assert last["target"] == pytest.approx([1.0, -1.0])
        assert last["active"] == 1

    @pytest.mark.parametrize(("angle", "acts"), [(0.51, 0), (0.49, 0), (-0.49, 0), (-0.51, 1)])
    def test_a_guard_of_one_side_leaves_a_fall_to_the_other_side_alone(self, angle, acts):
        """A guard against falls along -x does not act if the base leans along x."""
        backward = guard(toward=np.array([-1.0, 0.0, 0.0]), height=None)

        outputs = Driven(backward).sample(base_pose=leaning(angle), reference=self.REFERENCE)

        assert outputs["active"] == acts

    def test_it_ends_once_no_bound_was_exceeded_for_long_enough(self):
        """Another fall begins the time of the reset, three samples, anew."""
        driven = Driven(guard(reset_after=0.3))
        poses = (LOW, UPRIGHT, UPRIGHT, LOW, UPRIGHT, UPRIGHT, UPRIGHT, UPRIGHT)

        active = [
            driven.sample(base_pose=pose, reference=self.REFERENCE)["active"][0] for pose in poses
        ]

        assert active == [1, 1, 1, 1, 1, 1, 0, 0]


KP = 2.0  # rad per unit
KI = 0.4  # rad/s per unit
SAMPLE = 0.1  # s
WEIGHTS = np.array([0.5, -1.0, 0.0])


def law(**changed):
    """A law with limits that it does not reach, but for what is changed."""
    return PiLaw(
        **{
            "period": SAMPLE,
            "targets": [1.0],
            "kp": KP,
            "ki": KI,
            "limit": 10.0,
            "fastest": 100.0,
            **changed,
        }
    )


def objective(*, posture=None, **changed):
    """A loop for three axes, of which the last one does not take part."""
    return WeightedObjective(law=law(**changed), weights=WEIGHTS, posture=posture)


@pytest.mark.parametrize(
    "changed",
    [
        {},
        {"kp": 0.0, "ki": 5.0, "limit": 0.3, "fastest": 1.0},
        {"targets": [1.0, 0.5, 0.8], "speed": 2.0, "hold": 0.3},
        {"targets": [1.0, 0.2], "hold": 0.3, "fastest": 2.0},
    ],
)
def test_an_objective_of_expressions_is_the_one_of_numbers(changed):
    """The system of Drake's gives the effort and the error that the block computes, for any measurements."""
    system = law(**changed).make_system()
    context = system.CreateDefaultContext()
    of_numbers = Driven(objective(**changed))

    for measured in np.random.default_rng(3).uniform(0, 1.5, 60):
        system.get_input_port().FixValue(context, [measured])
        context.get_mutable_discrete_state().SetFrom(
            system.EvalUniquePeriodicDiscreteUpdate(context)
        )
        effort, error = system.get_output_port().Eval(context)
        outputs = of_numbers.sample(measured=measured)

        assert WEIGHTS * effort == pytest.approx(outputs["offset"], abs=1e-12)
        assert error == pytest.approx(outputs["error"][0], abs=1e-12)


def test_an_objective_is_a_pi_controller_spread_over_the_axes_by_their_weights():
    driven = Driven(objective())
    integral = 0.0
    for measured in (0.2, 0.5, 1.3, 1.1):
        error = 1.0 - measured
        integral += KI * error * SAMPLE

        outputs = driven.sample(measured=measured)

        assert outputs["error"] == pytest.approx(error)
        assert outputs["offset"] == pytest.approx((KP * error + integral) * WEIGHTS)


def test_an_objective_keeps_to_its_limits_and_does_not_wind_up_there():
    """The offset falls by at most 2 a second to its limit, and leaves it as soon as the error changes its sign."""
    driven = Driven(objective(kp=0.0, ki=5.0, limit=1.0, fastest=2.0))

    offsets = [driven.sample(measured=-9.0)["offset"][1] for _ in range(40)]
    offsets_after = [driven.sample(measured=1.5)["offset"][1] for _ in range(10)]

    assert np.diff(offsets).min() >= -2.0 * SAMPLE - 1e-12
    assert min(offsets) == -1.0
    # had it wound up over 4 s, it would stay at its limit for as long
    assert offsets_after[1] > -1.0


def test_an_objective_asks_for_its_targets_one_after_the_other_along_ramps():
    """The setpoint starts at the first measurement, 0.6, moves by 0.2 a sample, and stays at a target for 0.2 s."""
    driven = Driven(objective(targets=[1.0, 0.5], speed=2.0, hold=0.2, kp=1.0, ki=0.0))

    setpoints = [driven.sample(measured=0.6)["error"][0] + 0.6 for _ in range(8)]

    assert setpoints == pytest.approx([0.8, 1.0, 1.0, 0.8, 0.6, 0.5, 0.5, 0.5])


def test_a_posture_follows_once_the_objective_has_been_met_for_long_enough():
    """The axis moves from its reference, 0.5, to the posture, 1, once the quantity was near 1 for two samples."""
    posture = FinalPosture(
        positions=np.array([0.0, 0.0, 1.0]), tolerance=0.1, settled=0.2, duration=0.2
    )
    driven = Driven(objective(posture=posture))

    outputs = []
    for measured in (0.5, 0.95, 0.7, 0.95, 0.95, 0.95, 0.7, 0.7):
        output = driven.sample(measured=measured, reference=[0.0, 0.0, 0.5])
        outputs.append((output["active"][0], output["target"][2]))

    assert outputs == [(0, 0)] * 4 + [(1, 0.5), (1, 0.75), (1, 1.0), (1, 1.0)]


FORCE = np.array([0.0, 0.0, 30.0])
LEG = {
    "turns": np.array([[0.0, -1.0, 0.0]]),
    "points": np.zeros((1, 3)),
    "end": np.array([1.0, 0.0, 0.0]),
}


def touchdown(**changed):
    """Two legs of 1 m that lie ahead: a small angle lifts a foot by as many metres."""
    figures = {
        "kind": "touchdown",
        "force": 15.0,
        "clearance": 0.01,
        "search": 0.5,
        "reach": 0.012,
        "release": 0.05,
        "settle": 0.1,
    }
    limbs = {"left": Limb([0], **LEG), "right": Limb([1], **LEG)}
    driven = Driven(UnknownGround(Touchdown.model_validate({**figures, **changed}), limbs, 2))
    offset = np.zeros(2)

    def step(left, *, force=0.0, position=0.0):
        """Sample with a plan for the left leg; the servos are asked for the plan and the offset."""
        nonlocal offset
        forces = {"left": force * FORCE, "right": FORCE}
        read = {
            "reference": np.array([left, 0.0]) + changed.get("weight", 1.0) * offset,
            "position": [position, 0.0],
            "torque": [7.0, 1.0],
        }
        told = driven.sample(**forces, **read)
        offset = told["offset"]
        return told

    return step


def test_a_foot_that_touches_early_stays_and_then_comes_to_the_reference():
    step = touchdown()

    assert step(0.0, force=1)["phase"] == pytest.approx([2, 2])
    # on the way up what it still feels is no touch
    assert step(0.05, force=1)["phase"] == pytest.approx([0, 2])

    told = step(0.04)
    assert (told["phase"][0], told["offset"][0]) == (0, 0)
    for plan in (0.035, 0.02):  # it touched at 0.036 and stays there
        told = step(plan, force=1, position=0.036)
        assert (told["phase"][0], told["offset"][0]) == (1, pytest.approx(0.036 - plan))
    assert told["offset_velocity"] == pytest.approx([-(0.02 - 0.035) / 0.01, 0])
    for sample in range(1, 4):  # the reference has come down
        told = step(0.0, force=1, position=0.016)
        assert (told["phase"][0], told["offset"][0]) == (
            2,
            pytest.approx(0.016 * np.exp(-0.1 * sample)),
        )
    before = told["offset"][0]
    assert step(0.03, force=1)["offset"][0] == pytest.approx(before * np.exp(-0.2))
    assert not told["feedforward"].any()


def test_a_loop_of_a_weight_knows_the_part_of_its_offset_in_the_reference():
    step = touchdown(weight=0.5)
    step(0.05)
    step(0.04)

    for plan in (0.035, 0.02, 0.015):  # it touched at 0.036, and its offset still leads there
        told = step(plan, force=1, position=0.036)

        assert told["offset"][0] == pytest.approx(0.036 - plan)


def test_a_foot_that_finds_no_ground_goes_on_downward_as_far_as_it_may():
    step = touchdown()
    step(0.05)

    step(0.03)

    assert [round(float(step(0.0)["offset"][0]), 5) for _ in range(4)] == [
        -0.005,
        -0.01,
        -0.012,
        -0.012,
    ]
    assert step(0.0, force=1)["phase"][0] == 2


def test_a_foot_that_touches_may_keep_its_torques_instead():
    step = touchdown(holds="torques")
    step(0.05)

    step(0.04)

    assert step(0.03, force=1, position=0.036)["feedforward"] == pytest.approx([7, 0])
    for plan, position in ((0.02, 0.03), (0.0, 0.02), (0.0, 0.01)):  # it goes where it is pushed
        told = step(plan, force=1, position=position)
        assert told["offset"][0] == pytest.approx(position - plan)
        assert told["feedforward"] == pytest.approx([7, 0])
    assert not step(0.05)["feedforward"].any()
