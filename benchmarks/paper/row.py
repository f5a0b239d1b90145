"""One figure: as it is printed, as it is computed here, and whether the two agree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal


@dataclass(frozen=True)
class Row:
    """A figure as printed, beside the computed one.

    printed: the text, such as "1.3006", whose last digit says how much rounding it stands for, or "1.3579 +- 0.0071";
    relation: "=" (they agree to the printed rounding or interval), "<=" or ">=" (computed against printed);
    source: where it is printed, a label of the paper or "recorded" for a figure that earlier runs gave.
    """

    name: str
    printed: str
    computed: float
    source: str
    relation: str = "="

    @property
    def value(self) -> float:
        """The printed figure as a number."""
        return float(self.printed.split("+-")[0])

    @property
    def tolerance(self) -> float:
        """Half a unit of the last printed digit, or the printed interval.

        >>> Row("gain", "-1.2174", -1.21739, "").tolerance
        5e-05
        """
        figure, _, interval = self.printed.partition("+-")
        if interval:
            return float(interval)
        exponent = Decimal(figure.strip()).as_tuple().exponent
        return 0.5 * 10.0 ** int(exponent)

    @property
    def difference(self) -> float:
        """Computed less printed."""
        return self.computed - self.value

    @property
    def agrees(self) -> bool:
        """Whether the computed figure stands in the stated relation to the printed one."""
        room = 1.001 * self.tolerance  # the printed digit itself is not exact in floats
        allowed = {"=": abs(self.difference) <= room, "<=": self.difference <= room, ">=": self.difference >= -room}
        return allowed[self.relation]


def formula(value: float, digits: int = 8) -> str:
    """Return the value of a closed formula as a printed figure.

    >>> formula(1 / 3)
    '0.33333333'
    """
    return f"{value:.{digits}f}"


def table(rows: Sequence[Row]) -> str:
    """Return rows as text: figure, printed, computed, difference, verdict, source."""
    width = max(len(row.name) for row in rows)
    lines = [f"{'figure':<{width}}  {'printed':>20}  {'computed':>14}  {'difference':>10}  agrees  source"]
    for row in rows:
        relation = "" if row.relation == "=" else row.relation + " "
        lines.append(f"{row.name:<{width}}  {relation + row.printed:>20}  {row.computed:>14.8g}  "
                     f"{row.difference:>10.1e}  {'yes' if row.agrees else 'NO':<6}  {row.source}")
    return "\n".join(lines)
