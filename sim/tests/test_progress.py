"""Progress of long commands: estimate of the time left, and the shares that a simulation reports."""

import pytest

from whisker_sim import progress
from whisker_sim.progress import Progress, part, report_share, work_on
from whisker_sim.simulate import simulate


@pytest.fixture
def clock(monkeypatch):
    """A clock that the test sets: a list with the time in seconds."""
    now_s = [0.0]
    monkeypatch.setattr(progress, "_LINE_S", 10.0)
    monkeypatch.setattr(progress.time, "monotonic", lambda: now_s[0])
    return now_s


def test_verif_the_time_left_is_estimated_before_the_first_item_is_finished(clock, capsys):
    """An eighth of the work is done after 2 s, so that 14 s are left; there is at most one line in ten seconds."""
    shares = [0.5, 0.0, 0.0, 0.0]
    shown = Progress("simulate", "trace", 4)
    shown.start(shares)
    clock[0] = 2.0
    shown._show()
    shown._show()
    assert capsys.readouterr().err == "simulate: 0 of 4 traces, about 14 s left\n"
    shares[:2] = 1.0, 0.5
    shown.finish("first: done")
    clock[0] = 600.0
    shown._show()
    assert capsys.readouterr().err == "first: done\nsimulate: 1 of 4 traces, about 17 min left\n"


def test_verif_no_time_is_estimated_while_workers_start(clock, capsys):
    """A small finished share after a long start does not determine the speed: the estimate waits for ten seconds."""
    shown = Progress("simulate", "trace", 4)
    shown.start(shares := [0.01, 0.0, 0.0, 0.0])
    clock[0] = 2.0
    shown._show()
    assert capsys.readouterr().err == ""
    shares[0], clock[0] = 0.2, 10.0
    shown._show()
    assert capsys.readouterr().err == "simulate: 0 of 4 traces, about 3 min left\n"


def test_verif_items_that_are_up_to_date_do_not_count_for_the_speed(clock, capsys):
    shown = Progress("simulate", "trace", 100)
    for _ in range(90):
        shown.finish()
    shown.start([0.0] * 10)
    shown.finish()
    clock[0] = 4.0
    shown._show()
    assert capsys.readouterr().err == "simulate: 91 of 100 traces, about 36 s left\n"


def test_verif_short_jobs_show_no_estimate(clock, capsys):
    shown = Progress("simulate", "trace", 4)
    shown.start([0.5, 0.5, 0.0, 0.0])
    clock[0] = 1.5
    shown._show()
    assert capsys.readouterr().err == ""


def test_verif_a_simulation_reports_its_share(make_run):
    """Ascending shares up to one, mapped to the surrounding part; at the end of the item its share is one."""

    class Recorded(list):
        def __setitem__(self, index, value):
            values.append(value)
            super().__setitem__(index, value)

    values = []
    shares = Recorded([0.0, 0.0])
    with work_on(shares, 1), part(0.0, 0.5):
        simulate(make_run())
    assert len(values) > 1
    assert values == sorted(values)
    assert values[-2:] == [0.5, 1.0]
    assert list(shares) == [0.0, 1.0]
    report_share(0.3)
    assert list(shares) == [0.0, 1.0]
