"""Certificate of a trace, and flags of contacts at several points."""

import dataclasses

import numpy as np

from whisker_sim.certificate import Contacts, certify, quasi_static
from whisker_sim.simulate import simulate


def contacts(time_s, arc_m, on_the_side):
    count = len(time_s)
    blank, points = np.zeros(count), np.zeros((count, 2))
    return Contacts(time_s, np.zeros((count, 3)), blank, points, points, arc_m, blank, blank, on_the_side, time_s[-1])


def certified(run, simulated):
    scene = run.scene
    return certify(scene.resolved_whisker, [scene.object], scene.face, simulated, vibrates=False)


def test_verif_quasi_static_instants():
    """Excluded are start and end of a contact, and instants near a fast contact or a second contact point."""
    time_s = np.concatenate((np.arange(200), np.arange(300, 600))) * 0.004
    arc_m = np.where(np.arange(500) < 300, 0.05, 0.04)
    slow = quasi_static(contacts(time_s, arc_m, np.arange(500) != 400))
    assert not np.any(slow[:75])
    assert np.all(slow[75:195])
    assert not np.any(slow[196:275])
    assert np.all(slow[275:299])
    assert not np.any(slow[299:312])
    assert np.all(slow[313:399])
    assert not np.any(slow[399:412])
    assert np.all(slow[413:])


def test_val_certificate_keeps_the_bounds(make_run):
    """The bounds of the default settings are kept at the full number of samples."""
    run = make_run()
    certificate = certified(run, simulate(run))
    assert certificate.sampled == 50
    assert certificate.unsolved == certificate.tip == certificate.split == 0
    assert certificate.moment_rms < 5e-4
    assert certificate.surface_rms_m < 5e-6
    assert certificate.surface_worst_m < 30e-6
    assert certificate.arc_rms_m < 20e-6
    assert certificate.penetration_worst_m < 5e-6


def test_verif_certificate_detects_a_wrong_reading_and_a_wrong_contact_point(make_run):
    run = make_run()
    simulated = simulate(run)
    stiffer = certified(run, dataclasses.replace(simulated, rotations_rad=1.01 * simulated.rotations_rad))
    assert 2e-3 < stiffer.moment_rms < 1e-2
    truth = dataclasses.replace(simulated.truth, surface_m=simulated.truth.surface_m + np.array((1e-4, 0.0)))
    moved = certified(run, dataclasses.replace(simulated, truth=truth))
    assert 0.9e-4 < moved.surface_rms_m < 1.1e-4


def test_verif_certificate_without_a_quasi_static_instant(make_run):
    """For a contact without quasi-static instants all figures are `None`."""
    run = make_run()
    simulated = simulate(run)
    brief = np.zeros_like(simulated.touching)
    brief[np.flatnonzero(simulated.touching)[:10]] = True
    for touching in (brief, np.zeros_like(brief)):
        certificate = certified(run, dataclasses.replace(simulated, touching=touching))
        assert certificate.touching == np.sum(touching)
        assert certificate.sampled == 0
        assert certificate.moment_rms is certificate.surface_worst_m is certificate.penetration_worst_m is None


def test_val_contact_at_two_points_is_flagged(make_run):
    """A curved whisker that rolls over a flat on its concave side temporarily touches both ends; a circle is touched once."""
    flat = {"shape": "rectangle", "width_m": 0.02, "height_m": 0.02, "yaw_rad": 0.7}
    motion = {"kind": "lateral_sweep", "contact_arc_m": 0.05, "stroke_m": 0.01, "strokes": 1, "peak_speed_m_s": 0.01}
    rolling = simulate(make_run(whisker="curved", object=flat, motion=motion))
    assert 5 < np.sum(rolling.split) < 0.1 * np.sum(rolling.touching)
    single_m = rolling.truth.surface_m[rolling.touching & ~rolling.split]
    assert np.max(np.linalg.norm(single_m - single_m[0], axis=1)) > 0.019
    assert not np.any(simulate(make_run(whisker="curved")).split)
