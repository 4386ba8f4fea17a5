"""Interface of the studies: tasks for worker processes, and findings from their results.

A new study is one file with a `Study`, and one row in the registry.
"""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple


class Claim(NamedTuple):
    """A measured claim about the physics. It holds if the measured value is at most, or at least, the bound."""

    id: str
    claim: str
    measured: float
    relation: str
    """`<=` or `>=`."""
    bound: float
    unit: str

    @property
    def holds(self) -> bool:
        """Whether the measured value keeps the bound; NaN does not."""
        return self.measured <= self.bound if self.relation == "<=" else self.measured >= self.bound


class Findings(NamedTuple):
    """Findings of a study."""

    tables: dict[str, Sequence[NamedTuple]]
    """Rows of each table, by its name; the fields of a row are the columns."""
    claims: list[Claim]


class Study(NamedTuple):
    """A question about the simulator."""

    name: str
    about: str
    tasks: Callable[[Path], list[partial[Any]]]
    """Creates independent tasks, given the folder of the standard suite's traces."""
    conclude: Callable[[list[Any]], Findings]
    """Derives the findings from the results of the tasks, in their order."""


PERCENT = 100.0
"""Ratios are reported in percent."""
