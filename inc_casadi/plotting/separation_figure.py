"""The figure of the scalar separation: the clipped law against linear control, drawn from closed forms."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from ..arrays import Array, vector
from ..bounds.scalar import ScalarSeparation
from .style import LIMIT, QUIET, colour, new_figure, tint, written

LAW, DYNAMIC, STATIC, MOVES = colour(2), colour(0), colour(1), colour(7)
STARTS, STEPS, DISCOUNTS = (1.0, 0.85, -0.6), 6, 101


def plot_separation(example: ScalarSeparation, moves: tuple[ArrayLike, ArrayLike] | None = None,
                    path: str | Path | None = None, *, width: float | None = None, dpi: float | None = None) -> Figure:
    """Return a Matplotlib figure of u = -sat(a x) against linear control of x+ = a x + u, |u| <= 1.

    Left: the law and the best admissible linear first move. Middle: motions under the law and under the best static gain.
    Right: exact costs and lower bounds against the discount, every curve a closed form.

    example: the plant, the weights, and the discount of the first two panels; moves: discounts and, for each, a lower bound
    on linear controllers that counts more than the first move, (k,) each; path: where to write the figure, the ending
    chooses the format.
    width, dpi: of the figure and its file, in inches (the height in proportion) and dots per inch.

    Raises InvalidInputError when the two arrays do not fit each other.

    >>> figure = plot_separation(ScalarSeparation(1))
    >>> [axes.get_title() for axes in figure.axes]
    ['Law and best linear first move', 'Motions from three starts', 'Costs and lower bounds, $r = 0$']
    """
    figure = new_figure(13.5, 4.4)
    left, middle, right = figure.subplots(1, 3)
    _draw_laws(left, example)
    _draw_motions(middle, example)
    _draw_costs(right, example, None if moves is None else _points(*moves))
    return written(figure, path, width, dpi)


def _points(discounts: ArrayLike, bounds: ArrayLike) -> tuple[Array, Array]:
    beta = vector("moves, the discounts", discounts)
    return beta, vector("moves, the bounds", bounds, beta.size)


def _draw_laws(axes: Any, example: ScalarSeparation) -> None:
    a, kappa = float(example.a), float(example.first_gain)
    x = np.array([-1.0, -1 / a, 1 / a, 1.0])
    for limit in (-1.0, 1.0):
        axes.axhline(limit, color=LIMIT, ls="--", lw=1.2)
    axes.text(-0.98, 1.03, "limits $|u| = 1$", color=LIMIT, fontsize="small", va="bottom")
    axes.plot(x, -np.clip(a * x, -1, 1), "-", color=LAW, lw=2.4, label=rf"law $u = -\mathrm{{sat}}({a:.4g}\,x)$")
    axes.plot(x[1:3], -a * x[1:3], "o", color=LAW, mfc="white", ms=5)
    axes.plot(x, kappa * x, "--", color=DYNAMIC, lw=2.0, label=f"linear first move, gain ${kappa:.4g}$")
    axes.set_xticks([-1, -0.5, 0, 0.5, 1])
    axes.set_ylim(-1.25, 1.25)
    _finish(axes, "state $x$", "input $u$", "Law and best linear first move")
    axes.legend(loc="upper right", bbox_to_anchor=(1.0, 0.87), fontsize="small")  # between the limits, above both lines


def _draw_motions(axes: Any, example: ScalarSeparation) -> None:
    a, F = float(example.a), float(example.static_gain)
    k, start = np.arange(STEPS + 1), np.array(STARTS)
    law, linear = [start], [start]
    for _ in range(STEPS):
        law.append(a * law[-1] - np.clip(a * law[-1], -1, 1))
        linear.append((a + F) * linear[-1])
    axes.axhline(0.0, color=QUIET, lw=0.8)
    dashed = axes.plot(k, np.array(linear), "s--", color=STATIC, lw=1.5, ms=4.5, mfc="white")
    solid = axes.plot(k, np.array(law), "o-", color=LAW, lw=2.0, ms=5)
    solid[0].set_label("law: at rest after two steps")
    dashed[0].set_label(f"best static gain, ${F:.4g}$")
    _finish(axes, "step $k$", "state $x_k$", "Motions from three starts")
    axes.legend(loc="upper right", fontsize="small")


def _draw_costs(axes: Any, example: ScalarSeparation, moves: tuple[Array, Array] | None) -> None:
    beta = np.linspace(0.0, 1.0, DISCOUNTS)[1:]
    each = [replace(example, discount=Fraction(i, DISCOUNTS - 1)) for i in range(1, DISCOUNTS)]
    law, dynamic, static = (np.array([float(getattr(one, name)) for one in each])
                            for name in ("relu_law", "dynamic_linear", "static_linear"))
    axes.fill_between(beta, law, dynamic, where=law < dynamic, color=tint(LAW, 0.18), lw=0, label="gap by the first move")
    axes.plot(beta, static, "-.", color=STATIC, lw=2.0, label="best static gain, exact")
    axes.plot(beta, dynamic, "--", color=DYNAMIC, lw=2.0, label="every linear controller, at least: first move")
    if moves is not None:
        axes.plot(*moves, "D:", color=MOVES, lw=1.0, ms=4.5, mfc="white",
                  label="every linear controller, at least: many moves")
    axes.plot(beta, law, "-", color=LAW, lw=2.4, label="law, exact")
    axes.set_xlim(0.0, 1.02)
    axes.margins(y=0.08)
    _finish(axes, r"discount $\beta$", "expected discounted cost", f"Costs and lower bounds, $r = {float(example.r):g}$")
    axes.legend(loc="best", fontsize="small")


def _finish(axes: Any, x: str, y: str, title: str) -> None:
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.set_title(title, fontsize="medium")
    axes.grid(True, color="0.92")
    axes.set_axisbelow(True)
