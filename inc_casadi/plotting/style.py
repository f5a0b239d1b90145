"""Colours that the colour-blind can tell apart, and the door to the disk."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from ..arrays import number

# Okabe and Ito, Color Universal Design (2008), the darker ones first because lines on white need them.
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#999933", "#000000")
WORST, QUIET, LIMIT = "#000000", "#7A7A7A", "#B22222"
LIGHTNESS = (88.0, 72.0, 80.0, 94.0, 76.0, 91.0, 68.0, 84.0)  # L* of the grounds
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")  # with a colour and a dash each line has three signs of its own
DASHES: tuple[Any, ...] = ("-", (0, (5, 2)), "-.", (0, (1, 1.2)), (0, (7, 2, 1, 2, 1, 2)))
FILE_DPI = 150.0
Colour = tuple[float, float, float]


def colour(index: int) -> str:
    """Return the palette's colour for an index; it starts over when it is used up.

    >>> colour(0) == colour(len(PALETTE))
    True
    """
    return PALETTE[index % len(PALETTE)]


def tint(name: str, share: float = 0.3) -> Colour:
    """Return a colour mixed with white, `share` of it in (0, 1]: a ground that lines stay readable on.

    >>> tint("#000000", 0.5)
    (0.5, 0.5, 0.5)
    """
    red, green, blue = (float(1 - share * (1 - part)) for part in to_rgb(name))
    return red, green, blue


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of that size in inches, laid out so that labels do not overlap, with an Agg canvas."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def lightness(colour: Any) -> float:
    """Return the lightness L* of a colour in 0 to 100 (CIE 1976), which is what remains of it in greyscale.

    >>> round(lightness("#ffffff"), 3), lightness("#000000")
    (100.0, 0.0)
    """
    parts = np.array(to_rgb(colour))
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    Y = float(linear @ [0.2126, 0.7152, 0.0722])
    return 116 * Y ** (1 / 3) - 16 if Y > 216 / 24389 else Y * 24389 / 27


def ground(index: int, depth: float = 1.0) -> Colour:
    """Return the palette's colour mixed with white to a lightness of its own, so that grounds differ in greyscale too.

    depth: in (0, 1]: 1 for grounds that lie alone, less where much is drawn on them.

    >>> [round(lightness(ground(i))) for i in range(4)]
    [88, 72, 80, 94]
    """
    wanted = 100 - depth * (100 - LIGHTNESS[index % len(LIGHTNESS)])
    low, high = 0.0, 1.0
    for _ in range(30):  # lightness falls with the share of the colour
        middle = (low + high) / 2
        low, high = (middle, high) if lightness(tint(colour(index), middle)) > wanted else (low, middle)
    return tint(colour(index), high)


def canvas(ax: Any, width: float, height: float) -> tuple[Figure, Any]:
    """Return a figure and axes to draw into: those of the caller, or new ones of that size in inches.

    >>> figure, axes = canvas(None, 4.0, 3.0)
    >>> canvas(axes, 9.0, 9.0)[0] is figure
    True
    """
    if ax is not None:
        return ax.get_figure(root=True), ax
    figure = new_figure(width, height)
    return figure, figure.subplots()


def written(figure: Figure, path: str | Path | None, width: float | None = None, dpi: float | None = None) -> Figure:
    """Return the figure itself, written to `path` when one is given; the ending of its name chooses the format.

    width: inches to bring the figure to, its height in proportion. Letters keep their size; where a narrow figure has no
    room for them the file is wider instead, as it is in a notebook. dpi: dots per inch; by default the figure's own, and in
    the file 150.

    Raises InvalidInputError for a width or a dpi that is not positive.

    >>> written(new_figure(6.0, 4.0), None, width=3.0, dpi=50).get_size_inches().tolist()
    [3.0, 2.0]
    """
    if width is not None:
        size = figure.get_size_inches()
        figure.set_size_inches(size * number("width", width, 0.0, open_low=True) / size[0])
    if dpi is not None:
        figure.set_dpi(number("dpi", dpi, 0.0, open_low=True))
    if path is not None:
        figure.savefig(path, dpi=FILE_DPI if dpi is None else dpi, bbox_inches=None if width is None else "tight")
    return figure


def say_in(axes: Any, words: str) -> None:
    """Write words into axes that have nothing to show."""
    axes.set_axis_off()
    axes.text(0.5, 0.5, words, ha="center", va="center", color=QUIET, wrap=True, transform=axes.transAxes)


def name_of(symbol: str, index: int, count: int) -> str:
    """Return the mathtext name of an entry of a vector; a vector of one entry needs no index.

    >>> name_of("u", 0, 1), name_of("x", 1, 3)
    ('$u$', '$x_{2}$')
    """
    return f"${symbol}$" if count == 1 else f"${symbol}_{{{index + 1}}}$"


def formula(row: np.ndarray, constant: float, symbol: str = "x") -> str:
    """Return an affine map's formula in three digits, such as -1.37 x_1 - 2.65 x_2 + 1, in mathtext without dollars.

    >>> formula(np.array([-1.3749, 0.0]), 1.0)
    '-1.37\\\\,x_{1} + 1'
    >>> formula(np.zeros(2), -1.0)
    '-1'
    """
    scale = max(float(np.max(np.abs(row), initial=0.0)), abs(constant))
    terms = [(float(value), symbol if row.size == 1 else f"{symbol}_{{{i + 1}}}") for i, value in enumerate(row)]
    terms.append((float(constant), ""))
    out = ""
    for value, name in terms:
        if abs(value) <= 1e-9 * scale:
            continue
        sign = ("-" if value < 0 else "") if not out else (" - " if value < 0 else " + ")
        out += sign + f"{abs(value):.3g}" + (rf"\,{name}" if name else "")
    return out or "0"


def law_name(G: np.ndarray, g: np.ndarray) -> str:
    """Return the affine law u = G x + g as text, one line for each input; G (m, n), g (m,).

    >>> law_name(np.array([[2.0]]), np.array([1.0]))
    '$u$$ = 2\\\\,x + 1$'
    """
    m = len(g)
    return "\n".join(f"{name_of('u', k, m)}$ = {formula(G[k], g[k])}$" for k in range(m))
