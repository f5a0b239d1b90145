"""See a law and its loop exactly: regions, reachable sets, region of attraction, cost from every starting point.

The plant is the paper's two-state example, unstable and with a limited input, under the clipped LQR law. Its hidden units
are piecewise affine, so nothing has to be sampled or approximated: a set of states is cut into polygons on each of which
the loop is one affine map, and these are followed. The same question is put to a matrix inequality, whose ellipsoid
certifies a box less than half as large, and to simulation, which refutes a box hardly any larger than the certified one.
"""

from __future__ import annotations

import numpy as np

from inc_casadi import INC, Box, Plant, Regional, Uniform, certify, simulate
from inc_casadi.claims.attraction import Attraction
from inc_casadi.local.certify import certify_attraction
from inc_casadi.pieces.basin import region_of_attraction
from inc_casadi.pieces.reach import reachable
from inc_casadi.pieces.regions import regions
from inc_casadi.pieces.scale import largest_scale
from inc_casadi.pieces.walk import Budget
from inc_casadi.plotting import plot_attraction, plot_cost, plot_reachable, plot_regions

Figures = dict[str, float]
PLANT = Plant(A=[[1.10, 1.00], [0.00, 1.02]], B=[[0.20], [0.50]])
LAW = INC.saturated([[-1.3749, -2.6490]], 1.0)
INITIAL, LIMITS = Box([-0.8, -0.8], [0.8, 0.8]), Box([-1.0], [1.0])


def simulated(region: Box, points: int = 121) -> tuple[np.ndarray, np.ndarray]:
    """Return a grid over a region (2, N), and which of its motions have come to rest after 120 steps (N,)."""
    sides = [np.linspace(low, high, points) for low, high in zip(region.lower, region.upper, strict=True)]
    grid = np.stack(np.meshgrid(*sides)).reshape(2, -1)
    last = simulate(PLANT, LAW, grid, steps=120).x[..., -1]
    return grid, np.abs(last).max(axis=0) < 1e-2


def no_return() -> tuple[np.ndarray, float]:
    """Return (v, bound): from |v'x| > bound no input within the limits brings the state back.

    v'A = a v' with a > 1 is an unstable direction of the plant: w = v'x moves by w+ = a w + v'B u, which grows from
    |w| > |v'B| / (a - 1) whatever |u| <= 1 is.
    """
    a, v = np.linalg.eig(PLANT.A.T)
    fastest = int(np.argmax(a))
    row = v[:, fastest] / np.max(np.abs(v[:, fastest]))
    return row, float(np.abs(row @ PLANT.B[:, 0]) / (a[fastest] - 1))


def main() -> tuple[Figures, Figures]:
    """Print what is known, draw four pictures, and return computed and expected figures by name."""
    pieces = regions(PLANT, LAW, INITIAL)
    plot_regions(pieces, "regions.png")
    print(f"The law has {len(pieces)} regions on the initial box.")

    sets = reachable(PLANT, LAW, INITIAL, steps=6)
    draws = INITIAL.sample(200, np.random.default_rng(0))
    motions = simulate(PLANT, LAW, draws, steps=6).x
    plot_reachable(sets, motions, "reachable_sets.png")
    print(f"The set after 6 steps is a union of {sets.pieces[-1]} polygons, between {sets.boxes[-1].round(4).tolist()}.")

    claim = Regional(Uniform(INITIAL), LIMITS, Q=np.eye(2), R=[[0.05]], discount=0.98)
    certificate = certify(PLANT, LAW, claim)
    plot_cost(certificate, "cost_to_go.png")
    print(f"{certificate.sentence}\nproved: {certificate.prove().succeeded}")

    scale = largest_scale(PLANT, LAW, claim)
    ellipsoid = certify_attraction(PLANT, LAW, Attraction(LIMITS, directions=INITIAL.vertices), "convex hull")
    print(f"The initial box may be scaled by {scale.factor:.4f}, certified by exact pieces; by {ellipsoid.bound:.4f}, "
          f"certified by an ellipsoid; a motion refutes {scale.refuted:.4f}.")

    around = Box([-4.0, -2.5], [4.0, 2.5])
    basin = region_of_attraction(PLANT, LAW, around, LIMITS, budget=Budget(pieces=2000))
    grid, converges = simulated(around)
    plot_attraction(basin, {"certified ellipsoid, of the largest box": ellipsoid.ellipsoid}, (grid, converges),
                    no_return(), "region_of_attraction.png")
    print(f"{basin.sentence()}\nIn simulation {100 * converges.mean():.4g} % do.")

    computed = {
        "regions": float(len(pieces)),
        "largest x1 at step 2": float(sets.boxes[2, 1, 0]),
        "largest sampled excess over the exact boxes": excess(sets.boxes, motions),
        "largest cost from the initial box": certificate.worst_bound,
        "largest factor by exact pieces": scale.factor,
        "largest factor by an ellipsoid": ellipsoid.bound,
        "more than 88 % of the larger box certified": float(basin.share > 0.88),
    }
    expected = {
        "regions": 3.0,
        "largest x1 at step 2": 1.744,
        "largest sampled excess over the exact boxes": 0.0,
        "largest cost from the initial box": 11.16812,
        "largest factor by exact pieces": 2.3635,  # refuted from 2.365 on; the search ends within 1e-3
        "largest factor by an ellipsoid": 1.052,
        "more than 88 % of the larger box certified": 1.0,  # 89.6 % converge in simulation
    }
    return computed, expected


def excess(boxes: np.ndarray, motions: np.ndarray) -> float:
    """Return by how much motions (n, N, K) leave boxes (K, 2, n), rounding aside; 0 when they do not."""
    low, high = boxes[:, 0].T[:, None, :], boxes[:, 1].T[:, None, :]
    beyond = max(float(np.max(motions - high)), float(np.max(low - motions)))
    return max(0.0, beyond - 1e-12)


if __name__ == "__main__":
    main()
