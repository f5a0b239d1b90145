"""Search for a short expression of max and min that is true and false where it must be."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import reduce
from operator import and_, or_

import numpy as np

from ..errors import InvalidInputError
from .expression import Expression, Gate, flat, leaves
from .order import Order

Sets = tuple[int, ...]  # sets of laws as bits of integers, none of them containing another
Table = tuple[Sets, Sets]

LOOKED_AT = 30  # of all ways to divide a table, how many are looked at closely,
FOLLOWED = 3  # how many of these are followed in a second search,
STEPS = 3000  # over how many tables,
MANY = 150  # and for how many laws there is a second search
LAWS = 400  # how many distinct laws one output may have


def shortest_expression(order: Order, pairs: frozenset[tuple[int, int]] = frozenset()) -> Expression:
    """Return an expression of the laws that equals f on all cells, with few leaves.

    In a table with the minimal sets `above` for rows and the minimal sets `below` for columns, entry (A, B) holds the laws
    that A and B have in common. One law in all entries is an expression by itself. Else rows are divided, f = max(f_1, f_2),
    f_1 right for the first and f_2 for the other rows; or columns, f = min(f_1, f_2); and so on. Each expression arises so
    (M. Karchmer, A. Wigderson, 1990); all rows first is the max-min form, all columns first the min-max form. Rows are
    divided by whether they hold a law, and columns too.

    Divisions come first whose halves share the fewest laws that they cannot do without, the only ones in an entry. Every law
    holds on some open set, so an expression of L laws has at least L leaves, and takes L - 1 units unless it clips; the
    search ends when it gets there. pairs: laws (a, b), b above a by a constant: where a <= f <= b, f is clipped to them.

    Raises InvalidInputError when there are more than 400 laws.

    Notes
    -----
    What is found is to be checked by `fulfils`. That it is the shortest is known only at L leaves.
    """
    if len(order) > LAWS:
        raise InvalidInputError(f"the law has {len(order)} distinct affine laws in one output, more than {LAWS}")
    table = (_least(_bits(order.above)), _least(_bits(order.below)))
    best = flat(_Search(1, pairs).solve(*table))
    if len(order) < leaves(best) and len(order) <= MANY:
        best = min(best, flat(_Search(FOLLOWED, pairs).solve(*table)), key=leaves)
    return best


@dataclass(eq=False)
class _Search:
    """Divide tables along the most promising ways; the same table is solved once."""

    follow: int
    pairs: frozenset[tuple[int, int]]
    known: dict[Table, Expression] = field(default_factory=dict)

    def solve(self, rows: Sets, columns: Sets) -> Expression:
        table = _reduced(rows, columns)
        if table not in self.known:
            shared = reduce(and_, table[0] + table[1])
            self.known[table] = _lowest(shared) if shared else self._clipped(*table) or self._divided(*table)
        return self.known[table]

    def _clipped(self, rows: Sets, columns: Sets) -> Gate | None:
        over, under = reduce(and_, rows), reduce(and_, columns)
        for a, b in self.pairs:
            rest = tuple(row for row in rows if not row >> a & 1), tuple(each for each in columns if not each >> b & 1)
            if under >> a & 1 and over >> b & 1 and rest[0] and rest[1]:
                return Gate("clip", (a, b, self.solve(*rest)))
        return None

    def _divided(self, rows: Sets, columns: Sets) -> Gate:
        ways, low = _ways(rows, columns)
        best: Gate | None = None
        for total, name, halves in ways[: self.follow if len(self.known) < STEPS else 1]:
            if best is not None and (leaves(best) <= low or total >= leaves(best)):
                break
            found = Gate(name, tuple(self.solve(*half) for half in halves))
            best = found if best is None or leaves(found) < leaves(best) else best
        assert best is not None, "no law tells two rows or two columns apart"
        return best


def _ways(rows: Sets, columns: Sets) -> tuple[list[tuple[int, str, tuple[Table, Table]]], int]:
    """Ways to divide a table, the best first, each with the laws its halves need; and how many laws the table needs."""
    by_row, by_column = _needed(rows, columns), _needed(columns, rows)
    rough = [(_count(needs, part), size * len(across), name, part)
             for name, sets, across, needs in (("max", rows, columns, by_row), ("min", columns, rows, by_column))
             for part, size in _parts(sets)]
    close = []
    for total, _, name, part in sorted(rough)[:LOOKED_AT]:
        sets = rows if name == "max" else columns
        first, second = _chosen(sets, part), _chosen(sets, ~part)
        halves = ((_reduced(first, columns), _reduced(second, columns)) if name == "max" else
                  (_reduced(rows, first), _reduced(rows, second)))
        close.append((total, sum(len(half[0]) * len(half[1]) for half in halves), name, part, halves))
    return [(way[0], way[2], way[4]) for way in sorted(close, key=lambda way: way[:4])], reduce(or_, by_row).bit_count()


def _needed(sets: Sets, others: Sets) -> Sets:
    # For each set the laws that are the only one it has in common with one of the others.
    out = []
    for each in sets:
        both = [each & other for other in others]
        out.append(reduce(or_, [law for law in both if not law & (law - 1)], 0))
    return tuple(out)


def _parts(sets: Sets) -> Iterator[tuple[int, int]]:
    # The sets that hold a law, as bits of an integer, for every law that not all hold; and the size of the larger part.
    union, seen = reduce(or_, sets), {(1 << len(sets)) - 1}
    while union:
        law = union & -union
        union ^= law
        part = sum(1 << i for i, each in enumerate(sets) if each & law)
        if part not in seen:
            seen.add(part)
            yield part, max(part.bit_count(), len(sets) - part.bit_count())


def _count(needs: Sets, part: int) -> int:
    inside, outside = (reduce(or_, _chosen(needs, which), 0) for which in (part, ~part))
    return inside.bit_count() + outside.bit_count()


def _chosen(sets: Sets, part: int) -> Sets:
    return tuple(each for i, each in enumerate(sets) if part >> i & 1)


def _reduced(rows: Sets, columns: Sets) -> Table:
    # Laws in no column say nothing about rows, and a row that contains another follows from it; columns alike.
    while True:
        in_columns = reduce(or_, columns)
        fewer = _least(row & in_columns for row in rows)
        in_rows = reduce(or_, fewer)
        table = fewer, _least(column & in_rows for column in columns)
        if table == (rows, columns):
            return table
        rows, columns = table


def _least(sets: Iterator[int]) -> Sets:
    # The sets that contain no other, in order of size.
    out: list[int] = []
    for each in sorted(set(sets), key=lambda bits: (bits.bit_count(), bits)):
        if not any(other & each == other for other in out):
            out.append(each)
    return tuple(out)


def _bits(sets: np.ndarray) -> Iterator[int]:
    for row in np.packbits(np.unique(sets, axis=0), axis=1, bitorder="little"):
        yield int.from_bytes(row.tobytes(), "little")


def _lowest(bits: int) -> int:
    return (bits & -bits).bit_length() - 1
