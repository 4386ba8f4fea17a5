"""Progress of many items of work on stderr, with an estimate of the time left.

A process that works on an item reports the finished share of it by `report_share`; so the estimate does not have to wait for the
first item to be finished. It is shown after `_KNOWN_S`, or once `_KNOWN_SHARE` of the work is finished: until then, the start of
the worker processes takes most of the time.
"""

import sys
import threading
import time
from collections.abc import Iterator, MutableSequence, Sequence
from contextlib import contextmanager
from types import TracebackType
from typing import NamedTuple, Self

_REFRESH_S = 0.5
_FIRST_LINE_S, _LINE_S = 1.0, 10.0
"""Time of the first line without a terminal, and time between lines; shorter jobs than the latter have none."""

_KNOWN_S, _KNOWN_SHARE = 10.0, 0.1
_BAR = "{desc}: {percentage:3.0f}%|{bar}| {n:.0f}/{total} {unit}s [{elapsed}<{remaining}]"


class Progress:
    """Progress of `total` items of work: a bar on a terminal, a line every ten seconds elsewhere.

    `verb` names the work and `noun` an item, in the singular. A context manager, within which progress is shown.
    """

    def __init__(self, verb: str, noun: str, total: int) -> None:
        self._verb, self._noun, self._total = verb, noun, total
        self._finished = self._reused = 0
        self._shares: Sequence[float] = ()
        self._start_s = self._line_s = time.monotonic()
        self._bar = None
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._refresh, daemon=True)

    def __enter__(self) -> Self:
        """Starts to show the progress."""
        if sys.stderr.isatty():
            from tqdm import tqdm

            options = {"unit": self._noun, "desc": self._verb, "bar_format": _BAR.replace("{remaining}", "?")}
            self._bar = tqdm(total=self._total, smoothing=0.0, dynamic_ncols=True, **options)
        else:
            self._line_s += _FIRST_LINE_S
        self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        """Shows the final state."""
        self._stopped.set()
        self._thread.join()
        if self._bar is not None:
            self._show()
            self._bar.close()

    def start(self, shares: Sequence[float]) -> None:
        """Starts the estimate after the items that are up to date; `shares` are the finished shares (0 to 1) of the others."""
        self._reused, self._start_s = self._finished, time.monotonic()
        self._shares = shares
        if self._bar is not None:
            self._bar.initial, self._bar.start_t = self._reused, self._bar._time()

    def finish(self, line: str = "", failed: bool = False) -> None:
        """Counts one finished item. `line` is printed without a terminal, or if the item failed."""
        self._finished += 1
        if self._bar is None and line:
            print(line, file=sys.stderr, flush=True)
        elif self._bar is not None and failed:
            self._bar.write(line, file=sys.stderr)

    @property
    def _done(self) -> float:
        return max(self._finished, self._reused + sum(self._shares))

    def _refresh(self) -> None:
        while not self._stopped.wait(_REFRESH_S):
            self._show()

    def _show(self) -> None:
        done, now_s = self._done, time.monotonic()
        elapsed_s = now_s - self._start_s
        share = (done - self._reused) / max(1, self._total - self._reused)
        is_known = share >= _KNOWN_SHARE or (share > 0.0 and elapsed_s >= _KNOWN_S)
        if self._bar is not None:
            self._bar.n = max(self._bar.n, done)
            if is_known:
                self._bar.bar_format = _BAR
            self._bar.refresh()
            return
        if not is_known or now_s < self._line_s:
            return
        left_s = elapsed_s * (self._total - done) / (done - self._reused)
        if elapsed_s + left_s > _LINE_S:
            counted = f"{self._finished} of {self._total} {self._noun}s"
            print(f"{self._verb}: {counted}, {_duration(left_s)} left", file=sys.stderr, flush=True)
        self._line_s = now_s + _LINE_S


def _duration(duration_s: float) -> str:
    """A duration in seconds below two minutes, else in minutes, for people."""
    return f"about {duration_s:.0f} s" if duration_s < 120.0 else f"about {duration_s / 60.0:.0f} min"


class _Item(NamedTuple):
    """The item that this process works on, and the span of shares that its current part covers."""

    shares: MutableSequence[float]
    index: int
    start: float = 0.0
    end: float = 1.0


_item: _Item | None = None


@contextmanager
def work_on(shares: MutableSequence[float], index: int) -> Iterator[None]:
    """Makes `shares[index]` the target of `report_share`; at the end it is one."""
    global _item
    _item = _Item(shares, index)
    try:
        yield
    finally:
        shares[index], _item = 1.0, None


@contextmanager
def part(start: float, end: float) -> Iterator[None]:
    """Maps the shares that are reported within to the span from `start` to `end` of the surrounding part or item."""
    global _item
    outer = _item
    if outer is not None:
        width = outer.end - outer.start
        _item = outer._replace(start=outer.start + start * width, end=outer.start + end * width)
    try:
        yield
    finally:
        _item = outer


def report_share(share: float) -> None:
    """Reports the finished share (0 to 1) of the current part of the item that this process works on, if any."""
    if _item is not None:
        _item.shares[_item.index] = _item.start + share * (_item.end - _item.start)
