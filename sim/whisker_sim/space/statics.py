"""Statics of the chain in space under one force, for many loads at once, without MuJoCo.

As for the rod (`whisker_sim.rod`), the equilibrium is found from the contact back to the root: the force is given in the frame of
the loaded link, so that the moment about each joint, and hence its angle, follows from those beyond it. The joints of a hinge are
undone one by one, from the tip to the root.
"""

from collections.abc import Callable

import numpy as np

from whisker_sim.rod import SpatiallyLoaded
from whisker_sim.space.rotation import about, applied, undone
from whisker_sim.space.whisker import ROOT_ORDER, SpatialWhisker, hinge_order
from whisker_sim.whisker import Array

Order = tuple[int, int, int]


def chain_under_load(
    whisker: SpatialWhisker, node: int, force_n: Array, order_of: Callable[[int], Order] = hinge_order
) -> tuple[SpatiallyLoaded, Array]:
    """The chain under forces `force_n` (n, 3) at the node `node`, and its joint angles (n, 3 N + 3).

    The components of a force are along the tangent and the left and upper normals of the link there. The angles are those of the
    root, then of the hinges, each in the order `order_of` of its joints.
    """
    count, links = len(force_n), whisker.whisker.segments
    points_m, frames = whisker.rest_point_m(whisker.node_arcs_m), whisker.rest_frame(whisker.node_arcs_m)
    hinges_m, hinge_frames = whisker.rest_point_m(whisker.hinge_arcs_m), whisker.rest_frame(whisker.hinge_arcs_m)
    angles = np.zeros((count, links + 1, 3))
    # Place and directors of the current link in the frame of the contact.
    place_m, directors = np.zeros((count, 3)), np.broadcast_to(np.eye(3), (count, 3, 3))
    for hinge in range(node - 1, -1, -1):
        place_m = place_m + applied(directors, undone(frames[hinge + 1], hinges_m[hinge] - points_m[hinge + 1]))
        moment = np.cross(force_n, place_m)
        at_hinge = directors @ (frames[hinge + 1].T @ hinge_frames[hinge])
        found, at_hinge = _undone_joints(at_hinge, moment, order_of(hinge), whisker.stiffness_n_m_rad(hinge))
        angles[:, hinge + 1] = found
        directors = at_hinge @ (hinge_frames[hinge].T @ frames[hinge])
        place_m = place_m + applied(directors, undone(frames[hinge], points_m[hinge] - hinges_m[hinge]))
    moment = np.cross(force_n, place_m)
    root_rad, base = _undone_joints(directors, moment, ROOT_ORDER, whisker.root_stiffness_n_m_rad)
    angles[:, 0] = root_rad
    to_base = np.swapaxes(base, 1, 2)
    loaded = SpatiallyLoaded(-applied(to_base, place_m), to_base, applied(to_base, moment), root_rad)
    return loaded, angles.reshape(count, -1)


def _undone_joints(frame: Array, moment: Array, order: Order, stiffness: Array) -> tuple[Array, Array]:
    """Angles (n, 3) of the joints between `frame` (n, 3, 3) and the part nearer to the root, in their order, and its frame."""
    angles = np.zeros((len(moment), 3))
    for index in (2, 1, 0):
        axis = order[index]
        angles[:, index] = undone(frame, moment)[:, axis] / stiffness[axis]
        frame = frame @ about(axis, -angles[:, index])
    return angles, frame
