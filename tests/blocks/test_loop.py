"""Loops alone, sample by sample: what one remembers is given in, what changes comes out."""

import numpy as np
import pytest

from simrob_drake.blocks.sampled import RunEnds, SampledBlock
from simrob_drake.parts.controllers.objective import FinalPosture, PiLaw, WeightedObjective
from simrob_drake.parts.controllers.postures import CellSequence, FallGuard, ProtectivePosture, Sequencer
from simrob_drake.parts.controllers.support import Limb
from simrob_drake.parts.controllers.touchdown import Touchdown, UnknownGround

NAN = np.nan


class Driven:
    """A loop that is driven by hand."""

    def __init__(self, loop: SampledBlock) -> None:
        """Begin as the loop does."""
        self.loop = loop
        self.context = loop.CreateDefaultContext()

    def sample(self, **read):
        """Let it sample once, and return its outputs by name."""
        for name, value in read.items():
            self.loop.GetInputPort(name).FixValue(self.context, np.atleast_1d(value))
        update = self.loop.EvalUniquePeriodicDiscreteUpdate(self.context)
        self.context.get_mutable_discrete_state().SetFrom(update)
        ports = [self.loop.get_output_port(index) for index in range(self.loop.num_output_ports())]
        return {port.get_name(): port.Eval(self.context) for port in ports}


def two_cells(**changed):
    cells = [{"targets_deg": {"hip": 1}, "duration": 0.5}, {"targets_deg": {"knee": 1}, "duration": 0.0}]
    section = Sequencer.model_validate({"kind": "sequencer", "rate": 10, "cells": cells, **changed})
    targets = [np.array([1.0, NAN]), np.array([NAN, -0.5])]
    return CellSequence(
        section, targets=targets, tolerance=np.full(2, 0.05), largest_speed=np.full(2, 0.2), axes=["hip", "knee"]
    )


def test_a_sequence_ramps_waits_for_each_joint_and_for_its_speed_and_then_goes_on():
    driven = Driven(two_cells())
    start = np.array([0.2, 0.1])
    read = {"position": start, "velocity": np.zeros(2), "reference": start}
    assert driven.sample(**read)["target"] == pytest.approx(start)
    for k in range(1, 6):  # the ramp of the first cell; the other axis stays where it was asked to be
        assert driven.sample(**read)["target"] == pytest.approx([0.2 + 0.8 * k / 5, 0.1])
    late = {**read, "position": [0.94, 0.1]}
    for _ in range(20):  # one joint is late by more than its tolerance: no cell is skipped
        assert driven.sample(**late)["cell"] == 0
    assert driven.sample(**{**read, "position": [0.96, 0.1], "velocity": [0.0, 0.3]})["cell"] == 0  # too fast
    assert driven.sample(**{**read, "position": [0.96, 0.1]})["cell"] == 1
    given = driven.sample(**{**read, "position": [0.96, 0.1]})
    assert given["target"] == pytest.approx([1.0, -0.5])
    assert given["done"] == 0
    given = driven.sample(**{**read, "position": [0.96, -0.49]})
    assert (given["cell"], given["done"]) == (1, 1)


def test_a_cell_that_takes_too_long_ends_the_run_with_the_late_joint_or_goes_on():
    read = {"position": np.zeros(2), "velocity": np.zeros(2), "reference": np.zeros(2)}
    loop = two_cells(timeout=1.0)
    memory = {"target": np.zeros(2), "active": np.ones(1), "cell": np.zeros(1), "done": np.zeros(1)}
    memory |= {"elapsed": np.array([0.95]), "origin": np.zeros(2), "clock": np.ones(1), "reached": np.full(2, -1.0)}
    with pytest.raises(RunEnds, match="cell 0 was not reached within 1 s: hip is late"):
        loop.sample(memory, read)
    went_on = two_cells(timeout=1.0, on_timeout="go_on").sample(memory, read)
    assert went_on["cell"] == 1
    assert "reached" not in went_on
    with pytest.raises(RunEnds, match="the last of 2 cells is done"):
        two_cells(ends=True).sample({**memory, "done": np.ones(1)}, read)


def guard(**changed):
    posture, toward = np.array([1.0, -1.0]), changed.pop("toward", None)
    figures = {"height": 0.4, "tilt_deg": np.rad2deg(0.5), "posture_deg": {"hip": 1}, **changed}
    section = FallGuard.model_validate({"kind": "fall_guard", "rate": 10, **figures})
    return ProtectivePosture(section, posture=posture, up=np.array([0.0, 0.0, 1.0]), toward=toward)


UPRIGHT, LOW = np.array([0, 0, 0.41, 1, 0, 0, 0.0]), np.array([0, 0, 0.39, 1, 0, 0, 0.0])


def leaning(angle):
    return np.array([0, 0, 0.41, np.cos(angle / 2), 0, np.sin(angle / 2), 0.0])


def test_a_guard_acts_at_the_first_sample_beyond_its_threshold_and_stays():
    driven, asked = Driven(guard()), np.array([0.2, 0.2])
    for pose in (UPRIGHT, leaning(0.49), leaning(-0.49)):
        assert driven.sample(base_pose=pose, reference=asked)["active"] == 0
    given = driven.sample(base_pose=LOW, reference=asked)
    assert given["active"] == 1
    assert given["target"] == pytest.approx(asked)
    assert driven.sample(base_pose=UPRIGHT, reference=asked)["target"] == pytest.approx([0.6, -0.4])
    for _ in range(20):
        given = driven.sample(base_pose=UPRIGHT, reference=asked)
    assert given["active"] == 1
    assert given["target"] == pytest.approx([1.0, -1.0])
    assert Driven(guard()).sample(base_pose=leaning(0.51), reference=asked)["active"] == 1


def test_a_guard_of_one_side_leaves_a_fall_to_the_other_side_alone():
    one_side = {"toward": np.array([-1.0, 0.0, 0.0]), "height": None}
    for angle, acts in ((0.51, 0), (0.49, 0), (-0.49, 0), (-0.51, 1)):  # about y: a positive angle leans along x
        assert Driven(guard(**one_side)).sample(base_pose=leaning(angle), reference=np.zeros(2))["active"] == acts


def test_a_guard_lets_go_once_all_was_well_for_long_enough():
    driven, asked = Driven(guard(reset_after=0.3)), np.zeros(2)
    seen = [
        driven.sample(base_pose=pose, reference=asked)["active"][0]
        for pose in (LOW, UPRIGHT, UPRIGHT, LOW, UPRIGHT, UPRIGHT, UPRIGHT, UPRIGHT)
    ]
    assert seen == [1, 1, 1, 1, 1, 1, 0, 0]


KP = 2.0  # rad per unit
KI = 0.4  # rad/s per unit
SAMPLE = 0.1  # s
WEIGHTS = np.array([0.5, -1.0, 0.0])


def law(**changed):
    """A law with limits that it does not reach, but for what is changed."""
    return PiLaw(**{"period": SAMPLE, "targets": [1.0], "kp": KP, "ki": KI, "limit": 10.0, "fastest": 100.0, **changed})


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
        context.get_mutable_discrete_state().SetFrom(system.EvalUniquePeriodicDiscreteUpdate(context))
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
    assert offsets_after[1] > -1.0  # had it wound up over 4 s, it would stay at its limit for as long


def test_an_objective_asks_for_its_targets_one_after_the_other_along_ramps():
    """The setpoint starts at the first measurement, 0.6, moves by 0.2 a sample, and stays at a target for 0.2 s."""
    driven = Driven(objective(targets=[1.0, 0.5], speed=2.0, hold=0.2, kp=1.0, ki=0.0))

    setpoints = [driven.sample(measured=0.6)["error"][0] + 0.6 for _ in range(8)]

    assert setpoints == pytest.approx([0.8, 1.0, 1.0, 0.8, 0.6, 0.5, 0.5, 0.5])


def test_a_posture_follows_once_the_objective_has_been_met_for_long_enough():
    """The axis moves from its reference, 0.5, to the posture, 1, once the quantity was near 1 for two samples."""
    posture = FinalPosture(positions=np.array([0.0, 0.0, 1.0]), tolerance=0.1, settled=0.2, duration=0.2)
    driven = Driven(objective(posture=posture))

    outputs = []
    for measured in (0.5, 0.95, 0.7, 0.95, 0.95, 0.95, 0.7, 0.7):
        output = driven.sample(measured=measured, reference=[0.0, 0.0, 0.5])
        outputs.append((output["active"][0], output["target"][2]))

    assert outputs == [(0, 0)] * 4 + [(1, 0.5), (1, 0.75), (1, 1.0), (1, 1.0)]


FORCE = np.array([0.0, 0.0, 30.0])
LEG = {"turns": np.array([[0.0, -1.0, 0.0]]), "points": np.zeros((1, 3)), "end": np.array([1.0, 0.0, 0.0])}


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
        read = {"reference": np.array([left, 0.0]) + offset, "position": [position, 0.0], "torque": [7.0, 1.0]}
        told = driven.sample(**forces, **read)
        offset = told["offset"]
        return told

    return step


def test_a_foot_that_touches_early_stays_and_then_comes_to_the_reference():
    step = touchdown()
    assert step(0.0, force=1)["phase"] == pytest.approx([2, 2])
    assert step(0.05, force=1)["phase"] == pytest.approx([0, 2])  # on the way up what it still feels is no touch
    told = step(0.04)
    assert (told["phase"][0], told["offset"][0]) == (0, 0)
    for plan in (0.035, 0.02):  # it touched at 0.036 and stays there
        told = step(plan, force=1, position=0.036)
        assert (told["phase"][0], told["offset"][0]) == (1, pytest.approx(0.036 - plan))
    assert told["offset_velocity"] == pytest.approx([-(0.02 - 0.035) / 0.01, 0])
    for sample in range(1, 4):  # the reference has come down
        told = step(0.0, force=1, position=0.016)
        assert (told["phase"][0], told["offset"][0]) == (2, pytest.approx(0.016 * np.exp(-0.1 * sample)))
    before = told["offset"][0]
    assert step(0.03, force=1)["offset"][0] == pytest.approx(before * np.exp(-0.2))
    assert not told["feedforward"].any()


def test_a_foot_that_finds_no_ground_goes_on_downward_as_far_as_it_may():
    step = touchdown()
    step(0.05)
    step(0.03)
    assert [round(float(step(0.0)["offset"][0]), 5) for _ in range(4)] == [-0.005, -0.01, -0.012, -0.012]
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
