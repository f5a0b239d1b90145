"""Whether any static gain stabilizes a plant with one input and one measurement, decided in exact arithmetic."""

from __future__ import annotations

from fractions import Fraction
from math import gcd, lcm

from inc_casadi import Plant

Poly = list[int]  # coefficients, lowest first, up to a positive factor
MOST_STATES = 6


def no_stabilizing_gain(plant: Plant) -> str:
    """Return why no static gain u = f y makes A + B f C stable, or "" where one does or the question is left open.

    With one input and one measurement, det(zI - A - f B C) = a(z) - f c(z), and z = (1 + s) / (1 - s) turns stability into
    that of q(s; f), whose coefficients are affine in f: all roots of q in the open left half plane, degree n. As f moves,
    that can change only where q_0 = 0, q_n = 0, or the Hurwitz determinant of order n - 1 is 0 (a pair of roots +-s): at the
    real roots of polynomials in f. Sturm sequences isolate these, and one f in each gap between them is tested by Hurwitz
    determinants. All in whole numbers, the floats A, B, C taken as what they are: necessary and sufficient.

    A static law that is differentiable at its equilibrium acts there as the gain du/dy, so where none stabilizes no such
    law makes motions converge exponentially (Lyapunov's indirect method).

    >>> no_stabilizing_gain(Plant([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]], [[1.0, 0.0]])).split(" (")[0]
    'no static gain u = f y stabilizes this plant'
    >>> no_stabilizing_gain(Plant([[1.0, 1.0], [0.0, 1.0]], [[0.5], [1.0]], [[1.0, 1.0]]))
    ''
    """
    if not plant.discrete or plant.m != 1 or plant.p != 1 or plant.n > MOST_STATES:
        return ""
    a, c = _characteristic(plant)
    q = [[x, -y] for x, y in zip(_mapped(a), _mapped(c), strict=True)]  # q_k as a polynomial in f
    borders = [q[0], q[-1], _hurwitz_determinant(q, len(q) - 2)]
    samples = _between([_trimmed(border) for border in borders])
    if any(_is_hurwitz([_at(coefficient, f, 1) for coefficient in q]) for f in samples):
        return ""
    return ("no static gain u = f y stabilizes this plant (exact Hurwitz determinants, all f), so no static law that is "
            "differentiable at its equilibrium makes motions converge exponentially: measure more, or " + with_memory())


def with_memory() -> str:
    """Return where controllers with states of their own are, in words.

    >>> with_memory().split(" (")[0]
    'give the controller memory with synthesis.synthesize_dynamic'
    """
    return ("give the controller memory with synthesis.synthesize_dynamic (from parts of inc_casadi.dynamic: observer, "
            "DynamicINC, certify_dynamic)")


def _characteristic(plant: Plant) -> tuple[Poly, Poly]:
    """a(z) = det(zI - A) and c(z) = C adj(zI - A) B by Faddeev and LeVerrier, n + 1 coefficients each, times one number."""
    n = plant.n
    A = [[Fraction(x) for x in row] for row in plant.A.tolist()]
    B, C = [Fraction(x) for x in plant.B[:, 0].tolist()], [Fraction(x) for x in plant.C[0].tolist()]
    M = [[Fraction(int(i == j)) for j in range(n)] for i in range(n)]
    a, c = [Fraction(0)] * n + [Fraction(1)], [Fraction(0)] * (n + 1)
    for k in range(1, n + 1):
        c[n - k] = sum((C[i] * M[i][j] * B[j] for i in range(n) for j in range(n)), Fraction(0))
        AM = [[sum((A[i][l] * M[l][j] for l in range(n)), Fraction(0)) for j in range(n)] for i in range(n)]
        a[n - k] = -sum((AM[i][i] for i in range(n)), Fraction(0)) / k
        M = [[AM[i][j] + (a[n - k] if i == j else 0) for j in range(n)] for i in range(n)]
    factor = lcm(*(x.denominator for x in a + c))
    return [int(factor * x) for x in a], [int(factor * x) for x in c]


def _mapped(p: Poly) -> Poly:
    """(1 - s)^n p((1 + s) / (1 - s))."""
    n, out = len(p) - 1, [0] * len(p)
    for k, coefficient in enumerate(p):
        term = [1]
        for factor in [[1, 1]] * k + [[1, -1]] * (n - k):
            term = _times(term, factor)
        out = [x + coefficient * y for x, y in zip(out, term, strict=True)]
    return out


def _hurwitz_determinant(q: list[Poly], order: int) -> Poly:
    """The leading minor of the Hurwitz matrix H_ij = q_{n - 2i + j} (counted from 1), a polynomial in f."""
    n = len(q) - 1
    return _determinant([[q[n - 2 * i + j] if 0 <= n - 2 * i + j <= n else [0] for j in range(1, order + 1)]
                         for i in range(1, order + 1)])


def _determinant(H: list[list[Poly]]) -> Poly:
    if not H:
        return [1]
    total = [0]
    for j, entry in enumerate(H[0]):
        if any(entry):
            minor = _determinant([row[:j] + row[j + 1:] for row in H[1:]])
            total = _plus(total, [(-1) ** j * x for x in _times(entry, minor)])
    return total


def _is_hurwitz(q: Poly) -> bool:
    """Whether q has n roots, all with negative real parts: q_n > 0, up to sign, and all Hurwitz determinants positive."""
    sign = 1 if q[-1] > 0 else -1
    return q[-1] != 0 and all(_hurwitz_determinant([[sign * x] for x in q], order)[0] > 0 for order in range(1, len(q)))


def _between(borders: list[Poly]) -> list[Fraction]:
    """One point in each gap between the real roots of some polynomials; none where one of them vanishes identically."""
    if any(border == [0] for border in borders):
        return []
    product = [1]
    for border in borders:
        product = _times(product, border)
    chain = _sturm(_squarefree(product))
    top = chain[0]
    reach = 1 + max((Fraction(abs(x), abs(top[-1])) for x in top[:-1]), default=Fraction(0))
    reach = Fraction(1 << (int(reach) + 1).bit_length())  # a power of 2 keeps the points that follow short
    cuts: list[tuple[Fraction, Fraction]] = []
    todo = [(-reach, reach)]
    while todo:  # depth first, left to right
        low, high = todo.pop()
        roots = _changes(chain, low) - _changes(chain, high)
        if roots == 1 and (not cuts or cuts[-1][1] < low):  # apart from the one before, so that a gap has a middle
            cuts.append((low, high))
        elif roots:
            middle = (low + high) / 2
            todo += [(middle, high), (low, middle)]
    inner = [(left[1] + right[0]) / 2 for left, right in zip(cuts[:-1], cuts[1:], strict=True)]
    return [-reach, *inner, reach]


def _sturm(p: Poly) -> list[Poly]:
    """Sturm's chain of p without multiple roots: sign changes at low less those at high are the roots in (low, high]."""
    chain = [p, _primitive([k * x for k, x in enumerate(p)][1:] or [0])]
    while len(chain[-1]) > 1:
        rest = _trimmed([-x for x in _divided(chain[-2], chain[-1])[1]])
        if rest == [0]:
            break
        chain.append(rest)
    return chain


def _squarefree(p: Poly) -> Poly:
    """p over the greatest common divisor of p and its derivative: the same roots, each once."""
    divisor = _sturm(p)[-1]
    return p if len(divisor) == 1 else _divided(p, divisor)[0]


def _changes(chain: list[Poly], x: Fraction) -> int:
    signs = [value > 0 for value in (_at(p, x) for p in chain) if value != 0]
    return sum(left != right for left, right in zip(signs[:-1], signs[1:], strict=True))


def _divided(p: Poly, d: Poly) -> tuple[Poly, Poly]:
    """Quotient and remainder of p by d, each up to a positive factor."""
    quotient, rest, lead = [0] * max(0, len(p) - len(d) + 1), list(p), abs(d[-1])
    while len(rest) >= len(d):
        shift, factor = len(rest) - len(d), rest[-1] * (1 if d[-1] > 0 else -1)
        rest = [lead * x - (factor * d[k - shift] if k >= shift else 0) for k, x in enumerate(rest)][:-1]
        quotient = [lead * x for x in quotient]
        quotient[shift] = factor
    return _primitive(quotient or [0]), _primitive(rest or [0])


def _primitive(p: Poly) -> Poly:
    factor = gcd(*p)
    return [x // factor for x in p] if factor else p


def _times(p: Poly, q: Poly) -> Poly:
    out = [0] * (len(p) + len(q) - 1)
    for i, x in enumerate(p):
        for j, y in enumerate(q):
            out[i + j] += x * y
    return out


def _plus(p: Poly, q: Poly) -> Poly:
    size = max(len(p), len(q))
    return [x + y for x, y in zip(p + [0] * (size - len(p)), q + [0] * (size - len(q)), strict=True)]


def _trimmed(p: Poly) -> Poly:
    p = list(p)
    while len(p) > 1 and p[-1] == 0:
        p.pop()
    return p


def _at(p: Poly, x: Fraction, degree: int | None = None) -> int:
    """p(x) times the denominator of x to the power of the degree, by default that of p: a whole number of p(x)'s sign."""
    degree = len(p) - 1 if degree is None else degree
    return sum(coefficient * x.numerator**k * x.denominator ** (degree - k) for k, coefficient in enumerate(p))
