"""Figures of users' own: the package's looks, legends that cover nothing, files of each kind."""

import numpy as np
import pytest
from matplotlib.text import Text

from simrob_drake.base.errors import OutputError, UnknownName
from simrob_drake.results.colours import COLOURS
from simrob_drake.results.plots.own import panels, save_figure

TIMES = np.linspace(0.0, 1.0, 20)


def drawn(beside, tmp_path, curves=12):
    """Return a saved figure of two robots with many curves each, and its legends."""
    figure, frames = panels(
        "two robots of six axes", 2, 1, size=(9, 6), titles=("left", "right"), sharex=True
    )
    for axes in frames.flat:
        for number in range(curves):
            axes.plot(TIMES, np.sin(TIMES * number), label=f"joint_{number}")
    save_figure(figure, tmp_path / "own.png", beside=beside)
    return figure, figure.legends or [axes.get_legend() for axes in figure.axes]


@pytest.mark.parametrize("beside", [False, True])
def test_legends_and_title_cover_nothing(beside, tmp_path):
    figure, legends = drawn(beside, tmp_path)
    assert len(legends) == (2 if beside else 1)
    for legend in legends:
        assert [text.get_text() for text in legend.get_texts()] == [
            f"joint_{number}" for number in range(12)
        ]
        box = legend.get_window_extent()
        assert figure.bbox.padded(1).contains(box.x0, box.y0)
        assert figure.bbox.padded(1).contains(box.x1, box.y1)
        assert not any(box.overlaps(axes.get_window_extent()) for axes in figure.axes)
        (title,) = [
            text for text in figure.findobj(Text) if text.get_text() == "two robots of six axes"
        ]
        assert not any(
            title.get_window_extent().overlaps(axes.get_window_extent()) for axes in figure.axes
        )
        assert not any(
            title.get_window_extent().overlaps(text.get_window_extent())
            for text in legend.get_texts()
        )


def test_the_colours_are_those_of_a_runs_plots(tmp_path):
    figure, _ = drawn(False, tmp_path, curves=3)
    assert [line.get_color() for line in figure.axes[0].get_lines()] == list(COLOURS[:3])
    assert [axes.get_title(loc="left") for axes in figure.axes] == ["left", "right"]


def test_a_figure_without_labels_has_its_title_alone(tmp_path):
    figure, ((axes,),) = panels("a way", size=(5, 4))
    axes.plot(TIMES, TIMES)

    file = save_figure(figure, str(tmp_path / "runs" / "way.pdf"))

    assert file.read_bytes().startswith(b"%PDF")
    assert not figure.legends
    assert figure.get_suptitle() == "a way"


def test_what_cannot_be_written_is_one_clear_error(tmp_path):
    figure, _ = panels("a way", size=(5, 4))

    with pytest.raises(UnknownName, match="no format of plots 'gif'"):
        save_figure(figure, tmp_path / "way.gif")

    (tmp_path / "taken").write_text("")
    with pytest.raises(OutputError, match="taken"):
        save_figure(figure, tmp_path / "taken" / "way.png")
