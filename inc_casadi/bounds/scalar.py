"""The paper's scalar separation theorems in closed form, exact on Fractions: the clipped law against linear control."""

from __future__ import annotations

from dataclasses import dataclass, fields
from fractions import Fraction
from math import inf, isqrt, nextafter, sqrt
from numbers import Rational
from typing import Any

from ..arrays import number
from ..errors import InvalidInputError
from ..figures import at_least, at_most

Number = Fraction | float


@dataclass(frozen=True, eq=False)
class ScalarSeparation:
    """What linear controllers and the law u = -sat(a x) cost on x+ = a x + u, |u| <= 1, x_0 uniform on [-1, 1].

    The cost is J = E sum_k beta^k (x_k^2 + r u_k^2). A second state x_2+ = alpha x_2, neither steered nor seen, uniform on
    [-1, 1] and weighed by `weight`, adds weight / (3 (1 - beta alpha^2)) to the cost of every controller.

    Parameters
    ----------
    discount : beta in (0, 1]
    r : weight of the input, >= 0
    a : the pole, 1 < a with a (a - 1) <= 1, so up to 1.618: |x_1| <= a - 1 <= 1/a, and the law ends in two steps
    alpha, weight : the second state of cor:genuine_of, |alpha| < 1 and weight >= 0

    Integers and Fractions give Fractions, exactly; a float makes what it enters into a float, a few roundings off.

    Raises
    ------
    InvalidInputError : a number outside its range

    Notes
    -----
    Source: thm:longrun_dyn, thm:input_penalty_sep (r <= beta/2 there, every r here), thm:lsof_sep (r = 0 there),
    cor:genuine_of; a = 3/2 there. For r = 0 the law is the best of all controllers: x_1 is as small as the limits allow
    from every x_0, and x_2 = 0.

    Examples
    --------
    >>> paper = ScalarSeparation(1)
    >>> print(paper.relu_law, paper.dynamic_linear, paper.static_linear, paper.gap, paper.threshold)
    13/36 5/12 4/9 1/18 8/41
    """

    discount: Number
    r: Number = Fraction(0)
    a: Number = Fraction(3, 2)
    alpha: Number = Fraction(0)
    weight: Number = Fraction(0)

    def __post_init__(self) -> None:
        ends = {"discount": (0.0, 1.0), "r": (0.0, inf), "a": (1.0, inf), "alpha": (-1.0, 1.0), "weight": (0.0, inf)}
        for name, (low, high) in ends.items():
            value = _checked(name, getattr(self, name), low, high, open_low=name in "discount a alpha".split(),
                             open_high=name == "alpha")
            object.__setattr__(self, name, value)
        if self.a * (self.a - 1) > 1:
            raise InvalidInputError(f"a = {float(self.a):g} has a (a - 1) = {float(self.a * (self.a - 1)):g} > 1: the law "
                                    "-sat(a x) then needs more than two steps, and these formulas do not hold")

    @property
    def first_gain(self) -> Number:
        """The gain kappa in [-1, 0) of the linear first move u_0 = kappa x_0 that attains `dynamic_linear`.

        The unconstrained minimizer -beta a / (r + beta) of r kappa^2 + beta (a + kappa)^2, or -1 where that is beyond.
        """
        reach = self.discount * self.a
        return Fraction(-1) if self.r + self.discount <= reach else -reach / (self.r + self.discount)

    @property
    def dynamic_linear(self) -> Number:
        """A lower bound on every admissible linear controller of any finite order, from its first move.

        u_0 = kappa x_0 + d with |kappa| + |d| <= 1, and all terms that are left out are nonnegative, so
        J >= 1/3 + (r + beta) d^2 + (r kappa^2 + beta (a + kappa)^2) / 3. The best d is 0, the best kappa `first_gain`:
        1/3 + (r + beta (a - 1)^2) / 3 for r <= beta (a - 1), and 1/3 + r beta a^2 / (3 (r + beta)) beyond.

        >>> print(ScalarSeparation(1, Fraction(1, 2)).dynamic_linear, ScalarSeparation(1, 2).dynamic_linear)
        7/12 5/6
        """
        kappa = self.first_gain
        return (1 + self.r * kappa**2 + self.discount * (self.a + kappa) ** 2) / 3 + self.unsteered

    @property
    def relu_law(self) -> Number:
        """The cost of u = -sat(a x) = 1 - relu(a x + 1) + relu(a x - 1), exactly.

        |x_1| = max(a |x_0| - 1, 0) <= a - 1 <= 1/a, hence x_2 = 0. With E x_1^2 = (a - 1)^3 / (3 a),
        E u_0^2 = 1 - 2 / (3 a) and u_1 = -a x_1: J = 1/3 + r E u_0^2 + (beta + r beta a^2) E x_1^2.

        >>> print(ScalarSeparation(1, 1).relu_law)  # 1/3 + 1/36 + 5/9 + 1/16
        47/48
        """
        after = (self.a - 1) ** 3 / (3 * self.a)
        first = Fraction(1, 3) + self.r * (1 - 2 / (3 * self.a))
        return first + self.discount * (1 + self.r * self.a**2) * after + self.unsteered

    @property
    def static_gain(self) -> Number:
        """The best gain F of u = F x among |F| <= 1.

        J(F) = (1 + r F^2) / (3 (1 - beta (a + F)^2)) is finite on an interval about -a. Its derivative has the sign of
        g(F) = r F (1 - beta (a + F)^2) + beta (a + F) (1 + r F^2) = -r beta a F^2 + p F + beta a,
        p = r (1 - beta a^2) + beta. On that interval g < 0 for F <= -a (if r > 0), and g > 0 for F >= 0 and at the
        upper end. The roots of g have opposite signs, so J falls up to the negative one,
        F = -2 beta a / (p + sqrt(p^2 + 4 r beta^2 a^2)), the regulator's gain, and rises from there on. The best is that
        root, or -1 where it is beyond: for r (1 - beta a (a - 1)) <= beta (a - 1). A float where the root is irrational.

        >>> print(ScalarSeparation(1, 2).static_gain, ScalarSeparation(Fraction(1, 2), Fraction(5, 3)).static_gain)
        -1 -2/3
        """
        reach = self.discount * self.a
        if self.r * (1 - reach * (self.a - 1)) <= reach - self.discount:
            return Fraction(-1)
        p = self.r * (1 - reach * self.a) + self.discount
        root = _root(p**2 + 4 * self.r * reach**2)
        return -2 * reach / (p + root) if p > 0 else (p - root) / (2 * self.r * reach)

    @property
    def static_linear(self) -> Number:
        """The cost of the best static gain: no linear law u = F x, |F| <= 1, costs less."""
        return self.static_cost(self.static_gain)

    def static_cost(self, F: Number) -> Number:
        """Return the cost of u = F x, (1 + r F^2) / (3 (1 - beta (a + F)^2)) and what x_2 costs; inf where it diverges.

        Raises
        ------
        InvalidInputError : |F| > 1, which is not admissible

        >>> print(ScalarSeparation(Fraction(1, 2)).static_cost(-1), ScalarSeparation(1).static_cost(0))
        8/21 inf
        """
        F = _checked("F", F, -1.0, 1.0)
        left = 1 - self.discount * (self.a + F) ** 2
        return (1 + self.r * F**2) / (3 * left) + self.unsteered if left > 0 else inf

    @property
    def unsteered(self) -> Number:
        """What the second state costs under every controller: weight / (3 (1 - beta alpha^2)) (cor:genuine_of)."""
        return self.weight / (3 * (1 - self.discount * self.alpha**2))

    @property
    def gap(self) -> Number:
        """`dynamic_linear` less `relu_law`: what the law saves at least against every linear controller."""
        return self.dynamic_linear - self.relu_law

    @property
    def threshold(self) -> Number:
        """The weight of the input below which the gap is positive, beta (a - 1) / (2 + beta a^2 (a - 1)^2).

        For r <= beta (a - 1) the gap is (a - 1) / (3 a) times beta (a - 1) - r (2 + beta a^2 (a - 1)^2), zero at the
        threshold, which is at most beta (a - 1) / 2. It is concave in r, positive at 0, so negative from there on. The
        paper's 8 beta / (32 + 9 beta). It limits this proof, not the truth: `affine_moves` bounds linear control higher.
        """
        return self.discount * (self.a - 1) / (2 + self.discount * (self.a * (self.a - 1)) ** 2)

    @property
    def separated(self) -> bool:
        """Whether the law is proved to cost less than every linear controller; decided exactly, floats as they stand."""
        return self._exact().gap > 0

    @property
    def statement(self) -> str:
        """One sentence for an engineer, lower bounds rounded down and costs up.

        >>> print(ScalarSeparation(1).statement)
        On x+ = 1.5 x + u, |u| <= 1, the law u = -sat(1.5 x) costs at most 0.3611112, every admissible linear controller of
        any finite order at least 0.4166666 and the best static gain 0.4444444: the law beats them all.
        """
        exact, a = self._exact(), f"{float(self.a):g}"
        law, linear = exact.relu_law, exact.dynamic_linear
        verdict = "the law beats them all" if self.separated else (
            f"that does not separate them, for r = {float(self.r):g} is not below {at_least(float(self.threshold))}")
        return (f"On x+ = {a} x + u, |u| <= 1, the law u = -sat({a} x) costs at most {at_most(_float(law, inf))}, every "
                f"admissible linear controller of any finite order at least {at_least(_float(linear, -inf))} and the best "
                f"static gain {float(self.static_linear):.7g}: {verdict}.")

    def _exact(self) -> ScalarSeparation:
        return ScalarSeparation(*(Fraction(getattr(self, field.name)) for field in fields(self)))


def _checked(name: str, value: Any, low: float, high: float, *, open_low: bool = False, open_high: bool = False) -> Number:
    within = number(name, value, low, high, open_low=open_low, open_high=open_high)
    return Fraction(int(value.numerator), int(value.denominator)) if isinstance(value, Rational) else within


def _root(value: Number) -> Number:
    # The square root, a Fraction where it is one.
    if isinstance(value, Fraction):
        above, below = isqrt(value.numerator), isqrt(value.denominator)
        if above**2 == value.numerator and below**2 == value.denominator:
            return Fraction(above, below)
    return sqrt(value)


def _float(value: Number, toward: float) -> float:
    # The float next to the value on the side given, so that rounding it further on that side keeps a bound true.
    near = float(value)
    off = Fraction(near) - Fraction(value)
    return near if (off >= 0 if toward > 0 else off <= 0) else nextafter(near, toward)
