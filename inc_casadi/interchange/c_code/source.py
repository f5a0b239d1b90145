"""C source of a law with what is proved of it: error bound, number of steps, operations."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...arrays import Array
from ...brief import Brief
from ...sets import Box


@dataclass(frozen=True, eq=False)
class CSource(Brief):
    """Two files of C99, `name`.h and `name`.c, and what holds of the function in them.

    For every y with |y_j| <= reach (over `inputs`, where a box was given) the computed u satisfies, without any knowledge
    of the compiler but that it keeps to IEEE 754 and to the order of sums or fuses multiply-add,

        max_i |u_i - inc(y)_i| <= absolute + relative max_j |y_j|.

    For a loop with a multiplier only, this is so whenever the return value is not negative.

    header, source: the text; inputs: the box of measurements, or None; iterations: how many steps all loops take together
    at most, each an evaluation of their units (a splitting's looks at its residual and the steps within a trial are in
    `operations` alone);
    operations: additions, multiplications, divisions and comparisons at most; curved: calls of tanh at most; numbers:
    floats of constant data; methods: how loops are solved; stack: bytes of stack at most (`stack.FRAME` says what the
    compiler is allowed); precision: "double" or "float", the type of y and u and of everything between.
    """

    name: str
    header: str
    source: str
    inputs: Box | None
    absolute: float
    relative: float
    reach: float
    iterations: int
    operations: int
    curved: int
    numbers: int
    methods: tuple[str, ...]
    stack: int = 0
    precision: str = "double"

    @property
    def error_bound(self) -> float:
        """What |u - inc(y)| is at most over the box of measurements; infinite without one (see `error`)."""
        return self.absolute if self.inputs is not None else np.inf

    def error(self, y: Array) -> float:
        """Return the bound absolute + relative max |y_j| on |u - inc(y)| at y (p,); infinite where nothing is stated.

        >>> from inc_casadi import INC
        >>> from inc_casadi.interchange.c_code import to_c
        >>> to_c(INC.saturated([[2.0]], 1.0)).error([3.0]) < 1e-13
        True
        """
        y = np.asarray(y, dtype=float)
        size = float(np.max(np.abs(y)))
        known = size <= self.reach and (self.inputs is None or bool(self.inputs.contains(y)))
        return self.absolute + self.relative * size if known else np.inf

    @property
    def sentence(self) -> str:
        """What is proved, in one sentence."""
        over = "over the box of measurements" if self.inputs is not None else f"for |y_j| <= {self.reach:.3g}"
        more = f" + {self.relative:.3g} max |y_j|" if self.relative else ""
        single = " in single precision" if self.precision == "float" else ""
        calls = f" and {self.curved} calls of tanh" if self.curved else ""
        if not self.methods:
            return (f"{self.name} evaluates the law in one pass{single} with {self.operations} operations{calls}, within "
                    f"{self.absolute:.3g}{more} {over}.")
        how = f"({', '.join(self.methods)}){single}"
        return (f"{self.name} solves the law's loops {how} in at most {self.iterations} steps, "
                f"{self.operations} operations{calls}, within {self.absolute:.3g}{more} {over}.")

    def write(self, folder: str | Path) -> tuple[Path, Path]:
        """Write both files into a folder, which is made where it is missing, and return their paths: header, source."""
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        paths = folder / f"{self.name}.h", folder / f"{self.name}.c"
        for path, text in zip(paths, (self.header, self.source), strict=True):
            path.write_text(text, encoding="ascii")
        return paths

    def __str__(self) -> str:
        return self.sentence
