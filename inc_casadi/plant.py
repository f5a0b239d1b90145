"""The linear plant: x+ = A x + B u in discrete time or dx/dt = A x + B u in continuous time, measured as y = C x."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from .arrays import Array, matrix, number
from .brief import Brief
from .errors import DimensionError, InvalidInputError, SolverError

# An eigenvalue this close to the stability boundary is on it: a boundary mode must not pass as stable by rounding.
_BOUNDARY_TOL = 1e-12


@dataclass(frozen=True, eq=False)
class Plant(Brief):
    """A linear time-invariant plant without direct feedthrough, the object that a controller closes the loop around.

    x+ = A x + B u (dt > 0) or dx/dt = A x + B u (dt = 0), and y = C x. There is no D: with y = C x + D u the controller
    u = K y + V eta would stand in an algebraic loop with itself, which the well-posedness theorem does not cover.

    Parameters
    ----------
    A : (n, n) array, per step (discrete) or per second (continuous)
    B : (n, m) array
    C : (p, n) array, or None for the full state, C = I
    dt : sampling period in seconds, 0 for continuous time, as in python-control; True means an unspecified period,
        counted as 1.0

    Raises
    ------
    DimensionError : the shapes do not fit, or there is no state, no input or no output
    InvalidInputError : a NaN, an infinity, dt negative or None

    Notes
    -----
    Source: the plants of thm:dt_stability (discrete time) and thm:ct_stability (continuous time).

    Examples
    --------
    >>> plant = Plant(A=[[1.0, 0.1], [0.0, 1.0]], B=[[0.0], [0.1]], C=[[1.0, 0.0]], dt=0.1)
    >>> plant.n, plant.m, plant.p, plant.discrete, plant.full_state
    (2, 1, 1, True, False)
    """

    A: Array
    B: Array
    C: Array = None  # type: ignore[assignment]  # None is replaced by the identity
    dt: float = 1.0

    if TYPE_CHECKING:  # what the constructor takes is wider than what the fields hold
        def __init__(self, A: ArrayLike, B: ArrayLike, C: ArrayLike | None = None, dt: float = 1.0) -> None: ...

    def __post_init__(self) -> None:
        A = matrix("A", self.A)
        n = A.shape[0]
        if n == 0 or A.shape[1] != n:
            raise DimensionError(f"A has shape {A.shape}, but must be square with at least one state")
        B = matrix("B", self.B, (n, None))
        C = matrix("C", np.eye(n) if self.C is None else self.C, (None, n))
        if B.shape[1] == 0:
            raise DimensionError(f"B has shape {B.shape}, but the plant needs at least one input")
        if C.shape[0] == 0:
            raise DimensionError(f"C has shape {C.shape}, but the plant needs at least one output")
        for name, value in (("A", A), ("B", B), ("C", C), ("dt", _period(self.dt))):
            object.__setattr__(self, name, value)

    def __repr__(self) -> str:
        """Return its sizes and its period, say Plant(n=2, m=1, p=1, dt=0.1); p is left out with the full state measured."""
        measured = "" if self.full_state else f", p={self.p}"
        return f"Plant(n={self.n}, m={self.m}{measured}, dt={self.dt:g})"

    @property
    def n(self) -> int:
        """The number of states."""
        return self.A.shape[0]

    @property
    def m(self) -> int:
        """The number of inputs."""
        return self.B.shape[1]

    @property
    def p(self) -> int:
        """The number of measured outputs."""
        return self.C.shape[0]

    @property
    def discrete(self) -> bool:
        """Whether time is counted in steps (dt > 0)."""
        return self.dt > 0

    @property
    def full_state(self) -> bool:
        """Whether the measurement is the state itself, C = I exactly."""
        return self.p == self.n and bool(np.array_equal(self.C, np.eye(self.n)))

    @classmethod
    def from_control(cls, sys: Any) -> Plant:
        """Return the plant of a python-control `StateSpace` whose D is zero.

        Parameters
        ----------
        sys : control.StateSpace; its dt is kept, and dt=True (discrete, period unspecified) becomes 1.0

        Raises
        ------
        InvalidInputError : `sys` is not a StateSpace, has D != 0, or has dt=None

        Examples
        --------
        >>> import control
        >>> Plant.from_control(control.ss([[0.5]], [[1.0]], [[2.0]], [[0.0]], 0.1)).dt
        0.1
        """
        if not _is_state_space(sys):
            raise InvalidInputError(_not_a_plant(sys))
        D = np.asarray(sys.D, dtype=float)
        if np.any(D != 0):
            raise InvalidInputError(
                f"the plant has a direct feedthrough D with an entry of magnitude {np.max(np.abs(D)):g}; an implicit "
                "controller needs a strictly proper plant (D = 0), else u and y form an algebraic loop: delay the "
                "measurement by one step or add a fast sensor or actuator lag to the model"
            )
        return cls(sys.A, sys.B, sys.C, sys.dt)

    def to_control(self) -> Any:
        """Return the plant as a `control.StateSpace` with D = 0.

        Raises
        ------
        SolverError : python-control is not installed

        Examples
        --------
        >>> Plant(0.5, 1.0).to_control().nstates
        1
        """
        try:
            import control
        except ImportError as error:
            raise SolverError("Plant.to_control needs python-control: pip install control") from error
        return control.StateSpace(self.A, self.B, self.C, np.zeros((self.p, self.m)), self.dt)

    def sampled(self, dt: float) -> Plant:
        """Return the discrete-time plant seen under a zero-order hold of period `dt`.

        exp([[A, B], [0, 0]] dt) = [[Ad, Bd], [0, I]], exact for every A, singular ones included. The discrete plant
        describes the sampling instants only, not what happens between them.

        Parameters
        ----------
        dt : sampling period in seconds, > 0

        Raises
        ------
        InvalidInputError : the plant is discrete already, or dt is not positive

        Examples
        --------
        >>> Plant([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], dt=0.0).sampled(0.1).B.round(6).tolist()
        [[0.005], [0.1]]
        """
        if self.discrete:
            raise InvalidInputError(f"the plant is sampled already, with dt = {self.dt:g}")
        from scipy.linalg import expm

        period = number("dt", dt, 0.0, open_low=True)
        n = self.n
        augmented = np.zeros((n + self.m, n + self.m))
        augmented[:n, :n], augmented[:n, n:] = self.A, self.B
        transition = expm(augmented * period)
        return Plant(transition[:n, :n], transition[:n, n:], self.C, period)

    def unstabilizable_modes(self, margin: float = 1e-7) -> list[complex]:
        """Return the eigenvalues of A that are not asymptotically stable and that the input does not reach.

        The test of Popov, Belevitch and Hautus: (A, B) is stabilizable if and only if [lambda I - A, B] has rank n for
        every eigenvalue with |lambda| >= 1 (discrete) or Re lambda >= 0 (continuous). Rank is judged by the smallest
        singular value, after B is scaled to the norm of A, so the units of the input do not matter.

        Parameters
        ----------
        margin : a mode fails when that singular value is at most `margin` times the norm of A. The default leaves
            room for the error of a double eigenvalue, about the square root of the rounding unit.

        Returns
        -------
        The failing eigenvalues, as often as A has them; an empty list says that the plant can be stabilized.

        Examples
        --------
        >>> Plant([[2.0, 0.0], [0.0, 0.5]], [[0.0], [1.0]]).unstabilizable_modes()
        [(2+0j)]
        """
        return _hautus(self.A, self.B, self.discrete, number("margin", margin, 0.0))

    def undetectable_modes(self, margin: float = 1e-7) -> list[complex]:
        """Return the eigenvalues of A that are not asymptotically stable and that the output does not show.

        (A, C) is detectable if and only if (A', C') is stabilizable; see `unstabilizable_modes`. Detectability is
        necessary for any output feedback to stabilize, and not sufficient for a static one.

        Parameters
        ----------
        margin : as in `unstabilizable_modes`

        Examples
        --------
        >>> Plant([[2.0, 0.0], [0.0, 0.5]], [[1.0], [1.0]], C=[[0.0, 1.0]]).undetectable_modes()
        [(2+0j)]
        """
        return _hautus(self.A.T, self.C.T, self.discrete, number("margin", margin, 0.0))


def as_plant(value: Any) -> Plant:
    """Return a Plant as it is, and a `control.StateSpace` converted; python-control is never imported for this.

    Raises
    ------
    InvalidInputError : anything else

    Examples
    --------
    >>> as_plant(Plant(0.5, 1.0)).n
    1
    """
    return value if isinstance(value, Plant) else Plant.from_control(value)


def _hautus(A: Array, B: Array, discrete: bool, margin: float) -> list[complex]:
    size = float(np.linalg.norm(A, 2)) or 1.0
    reach = float(np.linalg.norm(B, 2))
    B = B * (size / reach) if reach > 0 else B
    eigenvalues = np.linalg.eigvals(A).astype(complex)
    stability = 1 - np.abs(eigenvalues) if discrete else -eigenvalues.real
    eigenvalues = eigenvalues[stability <= _BOUNDARY_TOL * (1.0 if discrete else size)]
    pencils = eigenvalues[:, None, None] * np.eye(A.shape[0]) - A
    pencils = np.concatenate([pencils, np.broadcast_to(B, (len(eigenvalues), *B.shape))], axis=2)
    smallest = np.linalg.svd(pencils, compute_uv=False)[:, -1]
    return [complex(value) for value in eigenvalues[smallest <= margin * size]]


def _period(dt: Any) -> float:
    if dt is None:
        raise InvalidInputError(
            "dt is None, which leaves open whether the plant is continuous or discrete: give dt=0 for continuous time "
            "or the sampling period in seconds"
        )
    return number("dt", dt, 0.0)


def _is_state_space(value: Any) -> bool:
    return any(c.__module__.partition(".")[0] == "control" and c.__name__ == "StateSpace" for c in type(value).__mro__)


def _not_a_plant(value: Any) -> str:
    hint = ""
    if type(value).__module__.partition(".")[0] == "control":
        hint = "; convert it first: control.ss(sys)"
    return f"a plant must be a Plant or a control.StateSpace, not {type(value).__name__}{hint}"
