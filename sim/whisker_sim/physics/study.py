"""What every study gives: tasks that worker processes run, and what follows from their results.

A new study is one file with a `Study`, and one row in the registry.
"""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple


class Claim(NamedTuple):
    """A claim about the physics, measured. It holds where the figure is at most, or at least, the bound."""

    id: str
    claim: str
    measured: float
    relation: str
    """`<=` or `>=`."""
    bound: float
    unit: str

    @property
    def holds(self) -> bool:
        """Whether the figure keeps the bound; a figure that is not a number does not."""
        return self.measured <= self.bound if self.relation == "<=" else self.measured >= self.bound


class Findings(NamedTuple):
    """What a study found."""

    tables: dict[str, Sequence[NamedTuple]]
    """Rows of each table, by its name; the fields of a row are the columns."""
    claims: list[Claim]


class Study(NamedTuple):
    """A question put to the simulator."""

    name: str
    about: str
    tasks: Callable[[Path], list[partial[Any]]]
    """Makes the tasks, given the folder of the standard suite's traces. Tasks are independent of one another."""
    conclude: Callable[[list[Any]], Findings]
    """Draws the findings from the tasks' results, in the order of the tasks."""


PERCENT = 100.0
"""Shares are given to people in percent."""
