"""The separation theorems: the saturated law against every linear controller, in closed form and computed."""

from __future__ import annotations

from benchmarks.plants.paper import Case, output_feedback, scalar
from inc_casadi import INC, Regional, bounds, certify
from inc_casadi.bounds.scalar import ScalarSeparation
from inc_casadi.linear.static_gain import best_static_gain

from .row import Row, formula

DISCOUNTS, INPUT_COSTS = (0.5, 0.9, 1.0), (0.0, 0.1)
CLOSED = "closed form, ScalarSeparation"
BEYOND = ((0.5, 0.4), (0.9, 0.9), (1.0, 3.0))  # discounts and input costs above discount/2, which the theorem leaves out


def rows() -> list[Row]:
    """Return costs and lower bounds for several discounts and input costs, each beside the theorem's formula."""
    out = []
    for beta in DISCOUNTS:
        for r in INPUT_COSTS:
            out += _state_input(beta, r)
        out.append(_static_gain(beta))
        out.append(_threshold(beta))
    for beta, r in BEYOND:
        out += _beyond(beta, r)
    return out + _embedding()


def two_relu_law() -> INC:
    """Return u = 1 - relu(1.5 y + 1) + relu(1.5 y - 1) (eq:relu_sat_controller, app:saturation_relu).

    >>> two_relu_law()([[-1.0, 0.2, 1.0]]).round(12).tolist()
    [[1.0, -0.3, -1.0]]
    """
    return INC([[0.0, 0.0], [0.0, 0.0]], [[1.5], [1.5]], [[-1.0, 1.0]], [[0.0]], [1.0, -1.0], [1.0])


def exact_cost(case: Case, inc: INC) -> float:
    """Return the expected discounted cost by subdividing the initial set, with the limits proved."""
    spec = case.spec
    claim = Regional(spec.initial, spec.inputs, spec.Q, spec.R, spec.discount)  # type: ignore[arg-type]
    return certify(case.plant, inc, claim).require().bound


def _state_input(beta: float, r: float) -> list[Row]:
    case = scalar(beta, r)
    here = f"beta = {beta:g}, r = {r:g}"
    law = 1 / 3 + beta / 36 + r * (5 / 9 + beta / 16)
    linear = 1 / 3 + r / 3 + beta / 12
    labels = ("eq:nn_cost_state", "eq:dyn_lower_state") if r == 0 else ("eq:nn_input_penalty_cost",
                                                                       "eq:dyn_input_penalty_lower")
    return [
        Row(f"two-ReLU law, {here}", formula(law), exact_cost(case, two_relu_law()), labels[0]),
        Row(f"linear controllers at least, {here}", formula(linear, 7), float(bounds.first_move(case.plant, case.spec)),
            labels[1]),
    ]


def _static_gain(beta: float) -> Row:
    case = scalar(beta)
    found = best_static_gain(case.plant, case.spec).cost
    return Row(f"best static gain, beta = {beta:g}", formula(1 / (3 * (1 - beta / 4))), found, "eq:lsof_optimal_cost")


def _threshold(beta: float) -> Row:
    """The input cost up to which the law wins: both sides are affine in r, so two values of r give the crossing."""
    gaps = []
    for r in INPUT_COSTS:
        case = scalar(beta, r)
        gaps.append(float(bounds.first_move(case.plant, case.spec)) - exact_cost(case, two_relu_law()))
    crossing = INPUT_COSTS[0] + (INPUT_COSTS[1] - INPUT_COSTS[0]) * gaps[0] / (gaps[0] - gaps[1])
    return Row(f"separation for r below, beta = {beta:g}", formula(8 * beta / (32 + 9 * beta), 6), crossing,
               "eq:r_threshold")


def _beyond(beta: float, r: float) -> list[Row]:
    """Where the input costs more than thm:input_penalty_sep covers: the closed forms against the computed figures."""
    case, closed, here = scalar(beta, r), ScalarSeparation(beta, r), f"beta = {beta:g}, r = {r:g}"
    return [
        Row(f"linear controllers at least, {here}", formula(float(closed.dynamic_linear), 7),
            float(bounds.first_move(case.plant, case.spec)), CLOSED),
        Row(f"best static gain, {here}", formula(float(closed.static_linear)), best_static_gain(case.plant, case.spec).cost,
            CLOSED),
        Row(f"two-ReLU law, {here}", formula(float(closed.relu_law), 7), exact_cost(case, two_relu_law()), CLOSED),
    ]


def _embedding() -> list[Row]:
    beta, alpha, weight = 0.9, 0.5, 0.3
    case = output_feedback(alpha, beta, weight)
    free = weight / (3 * (1 - beta * alpha**2))  # what the second state costs whatever the controller
    law, gain = exact_cost(case, two_relu_law()), best_static_gain(case.plant, case.spec).cost
    first_move = 1 / 3 + beta / 12 + weight / 3 * (1 + beta * alpha**2)
    return [
        Row("output feedback, two-ReLU law", formula(1 / 3 + beta / 36 + free), law, "cor:genuine_of"),
        Row("output feedback, best static gain", formula(1 / (3 * (1 - beta / 4)) + free), gain, "cor:genuine_of"),
        Row("output feedback, linear controllers at least", formula(first_move, 7),
            float(bounds.first_move(case.plant, case.spec)), "eq:Jlin_star"),
    ]
