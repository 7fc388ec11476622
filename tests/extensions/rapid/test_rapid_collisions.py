"""Collisions of an arm with itself are found when a RAPID program is read."""

from simrob_drake.extensions.rapid.importing import import_rapid
from simrob_drake.stations.load import bare_station

FOLDED_DEG = [0, -90, 168, 0, 0, 0]
"""A UR5 whose wrist is some 40 mm deep in its shoulder."""


def test_a_move_into_the_arm_itself_is_lost(tmp_path):
    module = tmp_path / "Folded.mod"
    target = f"[{FOLDED_DEG},[9E9,9E9,9E9,9E9,9E9,9E9]]"
    home = "[[0,-90,90,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"
    lines = [f"MoveAbsJ {home},v500,fine,tool0;", f"MoveAbsJ {target},v500,fine,tool0;"]
    module.write_text("MODULE Folded\nPROC main()\n" + "\n".join(lines) + "\nENDPROC\nENDMODULE\n")
    (lost,) = import_rapid(module, bare_station("ur5")).lost
    assert "link_1 would collide with link_" in lost.text
    assert lost.line == 4
