"""The errors of the toolbox: every refusal is an `INCError` that names the culprit and the assumption that fails."""


class INCError(Exception):
    """Base of every error that the toolbox raises on purpose."""


class InvalidInputError(INCError, ValueError):
    """A value at the door is not usable: NaN, infinite, indefinite, outside its range, or of the wrong kind."""


class DimensionError(InvalidInputError):
    """The shapes of two arguments do not fit each other."""


class EmptySetError(InvalidInputError):
    """A set has no point, no interior, or no bound, where the theory needs one that has."""


class NotWellPosedError(INCError):
    """The fixed point eta = phi(W eta + U y + b) is not proved to exist and be unique (thm:wellposed)."""


class ConvergenceError(INCError):
    """An iteration ended with a residual above its tolerance; the message states the residual."""


class NoEquilibriumError(INCError):
    """No equilibrium of a biased loop was found."""


class NotStabilizableError(INCError):
    """The plant has an unstable mode that the input does not reach."""


class InfeasibleError(INCError):
    """No controller whatever can do what is asked; the message states the obstruction."""


class NotCertifiedError(INCError):
    """A certificate was required and does not hold; the message states the worst margin."""


class SolverError(INCError):
    """A solver is missing or ended without numbers that could be checked."""


class FormatError(INCError, ValueError):
    """A file is not a saved noun of this toolbox, is of an unknown version, or was altered."""


class TranslationError(INCError, ValueError):
    """A network from elsewhere cannot be written as a controller, or answers otherwise than the original; names the part."""
