"""What the engine says of a run, in Spanish."""

import pytest

from simrob_drake import load_station, simulate
from simrob_drake.results.verdict.judge import CRITERIA
from simrob_drake.results.verdict.motion import MOTION
from simrob_drake.teach.pages.engine_words import spoken


@pytest.mark.parametrize(
    ("said", "spanish"),
    [
        ("ran to its end at 5 s", "llegó a su final a los 5 s"),
        (
            "robot fell: it leans by more than 60 deg, at 2.14 s",
            "robot cayó: se inclina más de 60 grados, a los 2.14 s",
        ),
        (
            "the force on tip reached the limit of 20 N, at 1.24 s",
            "la fuerza sobre tip alcanzó el límite de 20 N, a los 1.24 s",
        ),
        (
            "right_knee moved at 271 % of its speed, 20.3 of 7.5 rad/s, at 1.14 s (bound 105 %; 4 more beyond it)",
            "right_knee fue al 271 % de su velocidad, 20.3 de 7.5 rad/s, a los 1.14 s (cota 105 %; 4 más la pasan)",
        ),
        (
            "final error 1.74 deg (right_knee), penetration 2.46 mm (left_foot and floor)",
            "error final 1.74 grados (right_knee), penetración 2.46 mm (left_foot y floor)",
        ),
        (
            "the robot has stood still (below 1 deg/s) for 0.2 s",
            "el robot está quieto (menos de 1 grados/s) desde hace 0.2 s",
        ),
        ("nobody ever said that, so far", "nobody ever said that, so far"),
    ],
)
def test_sentences_are_said_in_spanish(said, spanish):
    assert spoken(said, "es") == spanish
    assert spoken(said, "en") == said


@pytest.mark.parametrize("criterion", [*MOTION, *CRITERIA], ids=lambda criterion: criterion.name)
def test_every_warning_of_a_verdict_has_spanish_words(criterion):
    of = "one and other" if criterion.name == "penetration" else "one"
    said = criterion.sentence.format(of=of, value="7 mm", amount="3 of 4 N·m", when=" at 1.14 s")
    assert not {"was", "were", "its", "of", "the", "at", "ended"} & set(spoken(said, "es").split()), spoken(said, "es")
    assert spoken(f"{criterion.title} 7 mm (one)", "es") != f"{criterion.title} 7 mm (one)"


@pytest.mark.parametrize(
    ("monitors", "spanish"),
    [
        ({"joint_limit": {"margin_deg": 85}}, "alcanzó su límite"),
        ({"torque_limit": {"limit": 1, "hold": 0.01}}, "permaneció en"),
        ({"power_limit": {"limit": 0.1}}, "la potencia de las articulaciones"),
        ({"workspace": {"lower": [-1, -1, -1], "upper": [0.1, 1, 1]}}, "salió de su espacio"),
        ({"divergence": {"speed_limit": 0.1}}, "se disparó"),
    ],
)
def test_what_monitors_say_has_spanish_words(monitors, spanish):
    station = load_station("irb120_dynamic", {"monitors": monitors, "duration": 0.6, "reference.duration": 0.3})
    said = simulate(station, progress=False).message
    assert spanish in spoken(said, "es"), said
    assert ", a los " in spoken(said, "es")
