"""Labels of a station's block picture: in which block of the picture each system of the diagram stands.

The picture is drawn from Drake's diagram. A system is a system of that diagram; several may share a block of the
picture.
"""

from collections.abc import Mapping, Sequence

from simrob_drake.base.messages import translate
from simrob_drake.parts.captions import BlockRole, Drawn, InnerBlock
from simrob_drake.parts.station_plant import StationRobot


class PictureLabels:
    """Labels of the block picture, which the parts of a station give while they are wired.

    Attributes:
        drawn: block of the picture, by the name of a system, or the part of its name before a dot. None if the system
            is wiring, which is drawn as a part of the arrows.
    """

    def __init__(self) -> None:
        """Begin without labels."""
        self.drawn: dict[str, Drawn | None] = {}

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {', '.join(self.drawn)}>"

    def draw(
        self,
        name: str,
        role: BlockRole,
        label: str,
        robot: StationRobot | None = None,
        *,
        key: str = "",
        inside: Sequence[str] = (),
        within: str = "",
        net: Mapping[str, InnerBlock] | None = None,
    ) -> None:
        """Label the block of the picture in which a system stands.

        Systems whose names begin with the system's name and a dot stand in the same block, unless a longer part of
        their names has a label of its own.

        Args:
            name: name of the system.
            role: what the block is for. It determines the column and the colour.
            label: text in the block, with line feeds between its lines. A message is shown in the language of the
                output.
            robot: robot to which the block belongs; None if it belongs to none.
            key: key of the block. Systems with the same key share a block. If it is empty, it is the system's name.
            inside: texts of the steps in the block, in the order in which they are done.
            within: key of the block whose system does the work; empty if the system does it itself.
            net: blocks that are drawn in place of this block, by name; None if this block itself is drawn.
        """
        # If the station has one robot only, blocks do not name it.
        owner = robot.name if robot is not None and robot.prefix else ""
        steps = tuple(translate(step) for step in inside)
        self.drawn[name] = Drawn(
            key or name, role, translate(label), owner, steps, within, net or {}
        )

    def draw_nothing(self, *names: str) -> None:
        """Declare systems as wiring, which is drawn as a part of the arrows.

        Systems whose names begin with one of these names and a dot are wiring, too, unless they have a label.
        """
        # None for each name: the picture draws lines through such systems, and no blocks.
        self.drawn.update(dict.fromkeys(names))
