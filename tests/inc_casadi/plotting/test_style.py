"""The one look of all pictures: grounds that differ without colours, lines that differ without colours, own axes."""

from __future__ import annotations

import inspect
import struct

import numpy as np
import pytest
from matplotlib.colors import to_rgb

from inc_casadi import INC, Box, Ellipsoid, Plant, Spec, compare, plotting
from inc_casadi.errors import InvalidInputError
from inc_casadi.plotting import plot_attraction, plot_bounds, plot_comparison, plot_intervals
from inc_casadi.plotting.cost_panel import AT_LEAST, AT_MOST, Row
from inc_casadi.plotting.style import DASHES, LIGHTNESS, MARKERS, PALETTE, ground, lightness, new_figure

# Machado, Oliveira, Fernandes (IEEE TVCG 15, 2009), severity 1, on linear RGB.
PROTAN = np.array([[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]])
DEUTAN = np.array([[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]])


def linear(colour: object) -> np.ndarray:
    parts = np.array(to_rgb(colour))  # type: ignore[arg-type]
    return np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)


def lab(rgb: np.ndarray) -> np.ndarray:
    xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]) @ np.clip(rgb, 0, 1)
    t = xyz / [0.9505, 1.0, 1.089]
    f = np.where(t > 216 / 24389, np.cbrt(t), (24389 / 27 * t + 16) / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("sight", [np.eye(3), PROTAN, DEUTAN], ids=["full", "protan", "deutan"])
def test_grounds_differ_for_the_colour_blind(sight: np.ndarray):
    seen = np.array([lab(sight @ linear(ground(i))) for i in range(len(PALETTE))])
    gaps = np.linalg.norm(seen[:, None] - seen, axis=2)[np.triu_indices(len(seen), 1)]
    assert gaps.min() > 3.0  # about the least difference that is seen is 2.3


def test_grounds_have_the_lightness_that_is_asked_and_differ_in_greyscale():
    assert [lightness(ground(i)) for i in range(8)] == pytest.approx(list(LIGHTNESS), abs=0.01)
    assert lightness(ground(1, 0.5)) == pytest.approx(100 - 0.5 * (100 - LIGHTNESS[1]), abs=0.01)
    assert np.diff(np.sort(LIGHTNESS)).min() >= 3.0 and lightness("#777777") == pytest.approx(lab(linear("#777777"))[0])


def test_lines_next_to_each_other_share_neither_dash_nor_marker():
    assert len(set(MARKERS)) == len(MARKERS) == 8 and len({str(one) for one in DASHES}) == len(DASHES) == 5


def test_pictures_are_drawn_into_the_axes_of_the_caller():
    plant, spec = Plant(1.5, 1.0), Spec(1.0, 0.0, 0.9, Box(-1, 1), Box(-1, 1))
    found = compare(plant, spec, {"clipped": INC.saturated([[-1.5]], 1.0)}, bounds=["linear"])
    figure = new_figure(9, 9)
    panels = figure.subplots(2, 2).ravel()
    assert plot_attraction(ellipsoids={"disc": Ellipsoid(np.eye(2))}, ax=panels[0]) is figure
    assert plot_bounds([Row("all", 1.0, AT_LEAST), Row("law", 2.0, AT_MOST)], ax=panels[1]) is figure
    assert plot_comparison(found, ax=panels[2]) is figure and plot_intervals(found, ax=panels[3]) is figure
    assert all(axes.has_data() for axes in panels) and not figure.legends
    figure.draw_without_rendering()


def pixels(path) -> tuple[int, int]:
    """The width and the height that a PNG states."""
    width, height = struct.unpack(">II", path.read_bytes()[16:24])
    return width, height


def test_a_figure_and_its_file_have_the_width_and_the_resolution_asked_for(tmp_path):
    rows, path = [Row("all", 1.0, AT_LEAST), Row("law", 2.0, AT_MOST)], tmp_path / "a.png"
    usual = plot_bounds(rows, path=path)
    size = usual.get_size_inches()
    assert pixels(path) == tuple(np.floor(150 * size))
    found = plot_bounds(rows, path=path, dpi=40)
    assert pixels(path) == tuple(np.floor(40 * size)) and found.get_dpi() == 40
    wide = plot_bounds(rows, path=path, width=2 * size[0], dpi=40)
    assert wide.get_size_inches() == pytest.approx(2 * size) and np.array(pixels(path)) == pytest.approx(80 * size, rel=0.1)


def test_letters_that_a_narrow_figure_has_no_room_for_widen_the_file(tmp_path):
    figure = plot_bounds([Row("all", 1.0, AT_LEAST)], "a long title " * 8, tmp_path / "a.png", width=4.0, dpi=40)
    assert figure.get_size_inches()[0] == 4.0 and pixels(tmp_path / "a.png")[0] > 200


def test_a_size_that_is_not_positive_is_refused():
    for options, name in (({"width": 0.0}, "width = 0"), ({"dpi": -1.0}, "dpi = -1")):
        with pytest.raises(InvalidInputError, match=name):
            plot_bounds([Row("all", 1.0, AT_LEAST)], **options)


def test_every_picture_takes_a_width_and_a_resolution():
    lacking = [name for name in plotting.__all__ if name.startswith("plot_")
               and not {"path", "width", "dpi"} <= set(inspect.signature(getattr(plotting, name)).parameters)]
    assert lacking == []
