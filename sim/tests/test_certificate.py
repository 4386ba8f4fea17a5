"""Certificate of a trace, and flags of contacts at several points."""

import dataclasses
import json
import re

import numpy as np

from whisker_sim.certificate import Contacts, certify, quasi_static
from whisker_sim.cli import main
from whisker_sim.products import BOUNDS
from whisker_sim.simulate import simulate

from conftest import REPOSITORY


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


def test_verif_bounds_are_those_of_whisker_check():
    """The keys and values of `whisker check` stand in the sources of the crate `trace`, those for users in FORMAT.md."""
    text = (REPOSITORY / "datasets" / "FORMAT.md").read_text()
    rows = re.compile(r"^\| `(\w+)` \| .* \| ([\d.e-]+) \|$", re.MULTILINE)
    for version, file, title in (
        (1, "certificate.rs", "### Certificate"),
        (2, "spatial/certificate.rs", "The certificate compares"),
    ):
        source = (REPOSITORY / "crates" / "trace" / "src" / file).read_text()
        constants = dict(re.findall(r"pub const (\w+): f64 = (\S+);", source))
        assert re.findall(r'\("(\w+)", ', source) == list(BOUNDS[version])
        assert {key.lower(): float(value) for key, value in constants.items()} | {"unsolved": 0.0} == BOUNDS[version]
        section = text.split(title)[1].split("\n#")[0]
        assert {key: float(value) for key, value in rows.findall(section)} == BOUNDS[version]


def test_robust_simulate_names_traces_that_exceed_a_bound(write_scene, tmp_path, capsys):
    """A chain of six segments bends too coarsely; the note also follows traces that are up to date."""
    coarse = [
        write_scene(name=name, whisker={"preset": "straight", "name": "coarse", "segments": 6}) for name in ("rough", "rougher")
    ]
    out = tmp_path / "out"
    command = ["simulate", *map(str, [write_scene(), *coarse]), "--out", str(out), "--jobs", "1"]
    for _ in range(2):
        assert main(command) == 0
        notes = [line for line in capsys.readouterr().err.splitlines() if line.startswith("note: ")]
        expected = (
            "note: the deviation from statics exceeds a bound (quick motion, or coarse simulation) in rough, rougher; "
            f"`whisker check {out}` states the values"
        )
        assert notes == [expected]
    # A trace whose simulation fails keeps the sidecar of an earlier scene.
    slips = {"kind": "lateral_sweep", "contact_arc_m": 0.076, "stroke_m": 0.02}
    write_scene(name="rougher", whisker="curved", motion=slips)
    assert main(command) == 3
    assert (out / "rougher.json").is_file()
    assert f" in rough; `whisker check {out}`" in capsys.readouterr().err
    for path in out.glob("rough*.json"):
        path.write_text(json.dumps(json.loads(path.read_text()) | {"certificate": None}))
    assert main(["simulate", str(coarse[0]), "--out", str(out), "--jobs", "1"]) == 0
    assert "note: " not in capsys.readouterr().err
