"""Inertias that no body has are correct_rounding, estimated or left out; what is left has the mass that is told."""

import numpy as np
import pytest
from pydrake.multibody.tree import SpatialInertia
from repair_stages import ARM, END, INERTIA, LIMIT, TIP, Repaired, joint, with_defect

from simrob_drake.base.messages import in_language
from simrob_drake.importer.repairs.inertias import correct_rounding
from simrob_drake.robots.bodies import links_without_inertia
from simrob_drake.robots.imports import ImportOptions

ESTIMATE = ImportOptions(estimate_inertia=True)
MASS = '<mass value="1"/>'
INERTIAL = f'<inertial><origin xyz="0 0 0.1"/>{MASS}{INERTIA}</inertial>'
COLLISION = (
    '<collision><origin xyz="0 0 0.1"/><geometry><box size="0.1 0.1 0.3"/></geometry></collision>'
)
BARE = with_defect(COLLISION, "")
BOX = SpatialInertia.SolidBoxWithDensity(1000.0, 0.1, 0.1, 0.3)  # 3 kg
TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"


def moments(xx: float, yy: float, zz: float, xy: float = 0.0) -> str:
    return f'<inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="{xy}" ixz="0" iyz="0"/>'


def body(done: Repaired, name: str = "upper") -> tuple[float, list[float], np.ndarray]:
    """Return a body's mass, its centre, and its moments about that."""
    inertia = done.plant.GetBodyByName(name).default_spatial_inertia()
    central = inertia.Shift(inertia.get_com()).CalcRotationalInertia().CopyToFullMatrix3()
    return inertia.get_mass(), list(inertia.get_com()), central


UNUSABLE = [
    pytest.param(
        INERTIA,
        moments(0.01, 0.01, 0.03),
        "principal moments 0.01, 0.01, 0.03 kg m²: each must be",
        1,
        id="tri",
    ),
    pytest.param(
        INERTIA,
        moments(-0.01, 0.01, 0.01),
        "each must be positive or zero",
        1,
        id="negative moment",
    ),
    pytest.param(
        INERTIA,
        moments(0.01, 0.01, 0.01, 0.02),
        "each must be positive or zero",
        1,
        id="products too large",
    ),
    pytest.param(INERTIA, "", "has a mass but no moments of inertia", 1, id="no moments"),
    pytest.param('ixx="0.01" ', "", "has a mass but no moments", 1, id="one moment missing"),
    pytest.param('ixx="0.01"', 'ixx="?"', "has a mass but no moments", 1, id="unreadable moment"),
    pytest.param(MASS, "", "has moments of inertia but no mass", 3, id="no mass"),
    pytest.param(
        MASS, '<mass value="0"/>', "has moments of inertia but no mass", 3, id="mass zero"
    ),
    pytest.param(MASS, '<mass value="-1"/>', "mass -1 kg is negative", 3, id="mass negative"),
    pytest.param(
        MASS, '<mass value="nan"/>', "has moments of inertia but no mass", 3, id="mass nan"
    ),
]


@pytest.mark.parametrize(("good", "bad", "words", "mass"), UNUSABLE)
def test_an_impossible_inertia_is_left_out_or_estimated(tmp_path, good, bad, words, mass):
    text = with_defect(good, bad)
    left_out = Repaired(text, tmp_path)

    assert any(words in line and line.endswith("left out") for line in left_out.told("dropped"))
    assert left_out.told("open") == [
        "link 'upper': has no usable inertia, so dynamic stations refuse this robot; "
        "write one, or estimate it with --estimate-inertia"
    ]
    assert links_without_inertia(left_out.robot) == ["upper"]

    estimated = Repaired(text, tmp_path, ESTIMATE)
    assert any(words in line and "; estimated " in line for line in estimated.told("defaulted"))
    assert estimated.told("open") == []

    found, centre, about = body(estimated)
    # the link's own where it is possible, of its shapes at 1000 kg/m³ else
    assert found == pytest.approx(mass)
    assert centre == pytest.approx([0, 0, 0.1])
    np.testing.assert_allclose(
        about, BOX.CalcRotationalInertia().CopyToFullMatrix3() * mass / 3, atol=1e-12
    )


def test_a_missing_inertia_is_refused_or_estimated(tmp_path):
    text = with_defect(INERTIAL, "")

    assert len(Repaired(text, tmp_path).told("open")) == 1

    done = Repaired(text, tmp_path, ImportOptions(estimate_inertia=True, density=100))
    assert body(done)[0] == pytest.approx(0.3)
    assert (
        "link 'upper': has no inertia; estimated from its shapes at 100 kg/m³: 0.3 kg"
        in done.told("defaulted")[0]
    )


def test_a_link_that_only_names_a_frame_needs_no_inertia(tmp_path):
    for nothing in ("", "<inertial/>", '<inertial><mass value="0"/></inertial>'):
        done = Repaired(with_defect(TIP, f'<link name="tip">{nothing}</link>'), tmp_path, ESTIMATE)
        assert done.told("open") == done.told("defaulted") == []
        assert body(done)[0] == 1.0


def test_mass_zero_and_moments_zero_is_how_nothing_is_written(tmp_path):
    zero = f'<inertial><mass value="0"/>{moments(0, 0, 0)}</inertial>'
    assert not Repaired(
        with_defect(TIP, f'<link name="tip">{zero}</link>'), tmp_path
    ).report.has_changes


def test_a_point_mass_on_a_body_with_moments_stays(tmp_path):
    point = f'<inertial><origin xyz="0 0 0.1"/><mass value="2"/>{moments(0, 0, 0)}</inertial>'
    clean = Repaired(with_defect(TIP, f'<link name="tip">{point}</link>'), tmp_path)

    assert not clean.report.has_changes

    told = Repaired(
        with_defect(TIP, f'<link name="tip">{point.replace(moments(0, 0, 0), "")}</link>'), tmp_path
    )
    assert (
        "has a mass but no moments of inertia; replaced by a point mass of 2 kg"
        in told.told("defaulted")[0]
    )
    for done in (clean, told):
        mass, centre, _ = body(done)
        assert mass == pytest.approx(3)
        assert centre == pytest.approx([0, 0, (0.1 + 2 * 0.4) / 3])


@pytest.mark.parametrize(
    "given",
    [
        (0.01, 0.01, 0.02000001),
        (0.01, 0.01, 0.020009),
        (0.02, -1e-8, 0.02),
        (0.01, 0.03000002, 0.02),
    ],
)
def test_rounded_moments_are_mended_by_as_much_as_they_miss(tmp_path, given):
    done = Repaired(with_defect(INERTIA, moments(*given)), tmp_path)
    assert any("corrected as a rounding error" in line for line in done.told("repaired"))
    np.testing.assert_allclose(body(done)[2], np.diag(given), atol=1e-3 * max(given))


def test_mending_moves_each_moment_alike_and_turns_with_the_axes():
    turn = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    found = correct_rounding(turn @ np.diag([0.01, 0.01, 0.0200003]) @ turn.T)

    np.testing.assert_allclose(
        found, turn @ np.diag([0.0100001, 0.0100001, 0.0200002]) @ turn.T, atol=1e-10
    )
    assert correct_rounding(np.diag([0.01, 0.01, 0.021])) is None
    assert correct_rounding(np.diag([-0.001, 0.01, 0.01])) is None


def test_shapes_add_up_and_visuals_stand_in_where_there_is_no_collision(tmp_path):
    ball = '<visual><origin xyz="0 0 1"/><geometry><sphere radius="0.1"/></geometry></visual>'
    both = Repaired(
        with_defect(INERTIAL, COLLISION.replace("0 0 0.1", "0 0 0.5")), tmp_path, ESTIMATE
    )

    assert body(both)[0] == pytest.approx(6)
    assert body(both)[1] == pytest.approx([0, 0, 0.3])

    seen = Repaired(with_defect(INERTIAL, ball, BARE), tmp_path, ESTIMATE)
    assert body(seen)[0] == pytest.approx(4 / 3 * np.pi)
    assert body(seen)[1] == pytest.approx([0, 0, 1])


@pytest.mark.parametrize(
    ("shape", "volume"),
    [
        ('<cylinder radius="0.1" length="0.5"/>', np.pi * 0.01 * 0.5),
        ('<capsule radius="0.1" length="0.5"/>', np.pi * 0.01 * 0.5 + 4 / 3 * np.pi * 1e-3),
        ('<drake:ellipsoid a="0.1" b="0.2" c="0.3"/>', 4 / 3 * np.pi * 6e-3),
        ('<mesh filename="t.obj" scale="0.1 0.2 0.3"/>', 1e-3),
        ('<mesh filename="t.obj" scale="0.1"/>', 1e-3 / 6),
    ],
)
def test_every_shape_has_a_volume(tmp_path, shape, volume):
    (tmp_path / "t.obj").write_text(TETRAHEDRON)
    solid = f"<collision><geometry>{shape}</geometry></collision>"

    done = Repaired(with_defect(INERTIAL, solid, BARE), tmp_path, ESTIMATE)

    assert body(done)[0] == pytest.approx(1000 * volume)


def test_a_body_without_mass_and_shape_gets_a_small_ball(tmp_path):
    done = Repaired(with_defect(INERTIAL, "", BARE), tmp_path, ESTIMATE)
    assert body(done)[0] == 0.1
    assert (
        "has neither inertia nor shape; estimated as a small ball: 0.1 kg"
        in done.told("defaulted")[0]
    )


def test_a_flat_mesh_is_no_body(tmp_path):
    (tmp_path / "t.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    flat = '<visual><geometry><mesh filename="t.obj"/></geometry></visual>'
    assert body(Repaired(with_defect(INERTIAL, flat, BARE), tmp_path, ESTIMATE))[0] == 0.1


def test_the_shapes_of_rigidly_joined_links_make_one_body(tmp_path):
    text = with_defect(TIP, f'<link name="tip">{COLLISION}</link>', with_defect(INERTIAL, "", BARE))
    done = Repaired(text, tmp_path, ESTIMATE)

    assert body(done)[0] == pytest.approx(3)
    assert body(done)[1] == pytest.approx([0, 0, 0.4])


def test_the_root_of_a_floating_robot_needs_an_inertia_too(tmp_path):
    floating = ImportOptions(base="floating")

    assert [line.split(":")[0] for line in Repaired(ARM, tmp_path, floating).told("open")] == [
        "link 'base'"
    ]
    assert (
        Repaired(ARM, tmp_path, floating.model_copy(update={"estimate_inertia": True})).told("open")
        == []
    )
    assert Repaired(ARM, tmp_path).told("open") == []


@pytest.mark.parametrize(
    ("good", "bad", "words"),
    [
        (MASS, '<mass value="1000"/>', "in 0.003 m³ is a density of 3.33e+05 kg/m³; were grams"),
        (
            '<origin xyz="0 0 0.1"/><mass',
            '<origin xyz="0 0 100"/><mass',
            "is 99.9 m from the middle of its shapes",
        ),
        (INERTIA, moments(1e4, 1e4, 1e4), "its moments are 1.64e+06 times those of a solid body"),
    ],
)
def test_slips_with_units_are_told_but_kept(tmp_path, good, bad, words):
    done = Repaired(with_defect(good, bad), tmp_path)
    assert any(words in line for line in done.told("read")), done.report.entries
    assert not done.report.has_changes


def test_estimates_are_for_bodies_without_mass_only(tmp_path):
    elbow = joint("elbow", "tip", "hand", "revolute", f'<axis xyz="0 1 0"/>{LIMIT}')
    done = Repaired(
        with_defect(END, f'<link name="hand">{COLLISION}</link>{elbow}{END}'), tmp_path, ESTIMATE
    )

    assert body(done)[0] == 1.0
    assert body(done, "hand")[0] == pytest.approx(3.0)


def test_an_entry_about_an_inertia_keeps_its_messages(tmp_path):
    """Problem and replacement are two messages. Joined as plain texts they would stay English."""
    text = with_defect(MASS, '<mass value="-1"/>')

    done = Repaired(text, tmp_path)

    [entry] = done.report.of("dropped")
    assert in_language(entry.text, "es") == "la masa de -1 kg es negativa; se quita"
