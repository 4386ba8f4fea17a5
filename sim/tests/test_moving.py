"""Objects in uniform motion, against the elastica and against the same experiment in the frame of the object."""

import msgspec
import numpy as np
import pytest

from whisker_sim.certificate import certify
from whisker_sim.scene import Scene
from whisker_sim.simulate import simulate

VELOCITY_M_S = np.array((0.0012, -0.0015))


@pytest.fixture(params=["straight", "curved"])
def moved(request, make_run):
    """A run with a moving circle, and its simulation."""
    run = make_run(whisker=request.param, object_velocity_m_s=list(VELOCITY_M_S))
    return run, simulate(run)


def test_val_contacts_with_a_moving_object_agree_with_the_elastica(moved):
    run, simulated = moved
    scene = run.scene
    certificate = certify(scene.resolved_whisker, [scene.object], scene.face, simulated, vibrates=False)
    assert certificate.sampled == 50
    assert certificate.unsolved == 0
    assert certificate.moment_rms < 5e-4
    assert certificate.surface_worst_m < 30e-6


def test_verif_positions_are_those_in_world(moved):
    """The base follows its plan, at rest at first, and the contact is on the object where that is at the instant."""
    run, simulated = moved
    plan = run.scene.plan()
    planned = plan.poses[:: run.scene.steps_per_row]
    assert np.max(np.abs(simulated.base_pose[:37] - planned[0])) < 1e-12
    assert np.max(np.abs(simulated.base_pose - planned)) < 3e-4, "the base lags behind its command"
    assert np.max(np.abs(simulated.rotations_rad[:37])) < 1e-12, "the whisker does not ring"
    object_m = simulated.time_s[:, None] * VELOCITY_M_S
    _, distance_m = run.scene.object.closest(simulated.truth.surface_m - object_m)
    assert np.max(np.abs(distance_m[simulated.touching])) < 1e-12
    # The recorded twist, integrated, is the motion of the base.
    yaw = simulated.base_pose[:, 2]
    vx, vy = simulated.base_twist[:, :2].T
    velocity_m_s = np.stack((np.cos(yaw) * vx - np.sin(yaw) * vy, np.sin(yaw) * vx + np.cos(yaw) * vy), axis=-1)
    way_m = np.cumsum(0.5 * (velocity_m_s[1:] + velocity_m_s[:-1]) * np.diff(simulated.time_s)[:, None], axis=0)
    np.testing.assert_allclose(way_m, simulated.base_pose[1:, :2] - simulated.base_pose[0, :2], atol=2e-5)


def test_verif_an_object_at_rest_is_one_of_velocity_zero(make_run):
    resting, still = simulate(make_run()), simulate(make_run(object_velocity_m_s=[0.0, 0.0]))
    assert np.array_equal(resting.rotations_rad, still.rotations_rad)
    assert np.array_equal(resting.base_pose, still.base_pose)
    assert still.object_m is None


def test_robust_a_fast_object_is_refused(make_run):
    scene = msgspec.to_builtins(make_run().scene)
    with pytest.raises(msgspec.ValidationError, match="object_velocity_m_s"):
        msgspec.convert({**scene, "object_velocity_m_s": [0.02, 0.0]}, Scene)
