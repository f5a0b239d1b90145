"""Colours that the colour-blind can tell apart, and the door to the disk."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

# Okabe and Ito, Color Universal Design (2008), the darker ones first because lines on white need them.
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#999933", "#000000")
WORST, QUIET, LIMIT = "#000000", "#7A7A7A", "#B22222"
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


def written(figure: Figure, path: str | Path | None) -> Figure:
    """Return the figure itself, written to `path` when one is given; the ending of its name chooses the format."""
    if path is not None:
        figure.savefig(path, dpi=150)
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
