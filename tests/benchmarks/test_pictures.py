"""The paper's two pictures, from the figures that the tables print."""

from __future__ import annotations

import pytest

from benchmarks import paper
from benchmarks.__main__ import main
from benchmarks.paper import pictures
from benchmarks.paper.row import Row


@pytest.mark.slow
def test_more_moves_add_nothing_without_input_cost_and_something_with_it():
    for r, more in ((0.0, False), (0.1, True)):
        axes = pictures.scalar_separation(r).axes[2]
        labels = [str(line.get_label()) for line in axes.lines]
        first, many = (next(line for line, label in zip(axes.lines, labels, strict=True) if words in label)
                       for words in ("first move", "many"))
        at_one = float(first.get_ydata()[-1]), float(many.get_ydata()[-1])
        assert many.get_xdata()[-1] == 1.0 and at_one[1] >= at_one[0] - 1e-6
        assert (at_one[1] > at_one[0] + 0.01) is more


def test_the_two_state_picture_has_the_figures_of_the_section():
    axes = pictures.two_states().axes
    bars = [bar.get_x() + bar.get_width() for bar in axes[3].patches]
    assert bars == pytest.approx([1.36496190, 3.3472, 3.5639], abs=5e-5)
    floors = sorted(float(text.get_text().split("at least ")[1]) for text in axes[3].texts)
    assert floors[0] == pytest.approx(1.3649, abs=2e-4) and floors[1] == pytest.approx(2.116763, abs=2e-6)
    starts = [(line.get_xdata()[0], line.get_ydata()[0]) for line in axes[0].lines[:3]]
    assert starts == [(0.8, 0.8)] * 3


@pytest.mark.slow
def test_the_command_draws_where_it_is_told(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(paper, "all_rows", lambda: [Row("gain", "1.0", 1.0, "here")])
    assert main(["paper", "--figures", str(tmp_path / "new")]) == 0
    drawn = sorted(path.name for path in (tmp_path / "new").iterdir())
    assert drawn == ["scalar_separation.png", "scalar_separation_input_cost.png", "two_states.png"]
    assert capsys.readouterr().out.count("drawn: ") == 3
    assert all(path.stat().st_size > 20_000 for path in (tmp_path / "new").iterdir())


def test_without_a_folder_nothing_is_drawn(monkeypatch, capsys):
    monkeypatch.setattr(paper, "all_rows", lambda: [Row("gain", "1.0", 2.0, "here")])
    monkeypatch.setattr(paper, "draw_all", lambda folder: pytest.fail("drawn unasked"))
    assert main(["paper"]) == 1 and "drawn" not in capsys.readouterr().out
