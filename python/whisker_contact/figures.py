"""Figures of replays, by matplotlib."""

from collections.abc import Callable, Mapping
from itertools import cycle
from typing import Any

import numpy as np

from ._native import Replay, SpatialReplay, SpatialTrial, Trial

#: Half width of a 95 % interval, in standard deviations.
_NORMAL_95 = 1.959963984540054

#: Colours of the replays, distinguishable with the common forms of colour blindness: Okabe and Ito, "Color Universal Design", 2008.
_COLORS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#d55e00", "#56b4e9")


def _axes(function: str, axes: Any) -> Any:
    if axes is not None:
        return axes
    try:
        from matplotlib import pyplot
    except ImportError as error:
        raise ImportError(f"{function}: found no matplotlib, expected it to be installed: pip install matplotlib") from error
    return pyplot.subplots(layout="constrained")[1]


def plot_sweep(
    trial: Trial | SpatialTrial,
    replays: Replay | SpatialReplay | Mapping[str, Replay] | Mapping[str, SpatialReplay],
    axes: Any = None,
) -> Any:
    """Contact error of replays over time, with the standard deviation that they state and the posterior Cramér–Rao bound.

    `trial` is one in the plane or in space; in space also the bound with an unknown object is drawn. `replays` is one replay of the
    trial, or several by their labels. Draws on `axes`, by default new ones, and returns them.
    """
    axes = _axes("plot_sweep", axes)
    t_s = trial.trace.recording["t_s"]
    labelled: Mapping[str, Any] = replays if isinstance(replays, Mapping) else {"estimate": replays}
    # Replays of the other kind are refused by `errors_m`.
    error_m: Callable[[Any], Any] = trial.errors_m
    for (label, replay), color in zip(labelled.items(), cycle(_COLORS), strict=False):
        axes.plot(t_s, 1e3 * error_m(replay), linewidth=1.0, color=color, label=label)
        axes.plot(t_s, 1e3 * replay.sd_m, linewidth=1.5, linestyle=":", color=color, label=f"{label}, stated")
    bound = trial.bound
    axes.plot(t_s, 1e3 * bound["bound_m"], color="black", linewidth=1.5, label="Cramér–Rao bound")
    if isinstance(trial, SpatialTrial) and np.isfinite(bound["object_bound_m"]).any():
        label = "Cramér–Rao bound, unknown object"
        axes.plot(t_s, 1e3 * bound["object_bound_m"], color="black", linewidth=1.5, linestyle="--", label=label)
    axes.set(xlabel="time (s)", ylabel="contact error (mm)", yscale="log", title=trial.trace.name)
    # To the right of the axes the legend covers neither data nor title.
    axes.legend(frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return axes


def plot_outline(trial: Trial, replay: Replay, axes: Any = None) -> Any:
    """Estimated outline with its 95 % band, estimated and true contacts, and the true outline, in World.

    Draws on `axes`, by default new ones, and returns them.
    """
    axes = _axes("plot_outline", axes)
    truth, contacts = trial.trace.truth, replay.table
    axes.plot(1e3 * contacts["surface_x_m"], 1e3 * contacts["surface_y_m"], ".", markersize=2, label="estimated contacts")
    axes.plot(1e3 * truth["surface_x_m"], 1e3 * truth["surface_y_m"], color="gray", linewidth=3, label="true contacts")
    if trial.trace.outline is not None:
        axes.plot(*(1e3 * trial.trace.outline.T), color="black", linewidth=1, label="true outline")
    outline = trial.outline(replay)
    if outline is not None:
        (line,) = axes.plot(*(1e3 * outline.points.T), linewidth=1.5, label="estimated outline")
        offset = _NORMAL_95 * outline.sd_m[:, None] * outline.normals
        inner, outer = outline.points - offset, outline.points + offset
        band = np.concatenate([inner, outer[::-1]])
        if np.isfinite(band).all():
            axes.fill(*(1e3 * band.T), alpha=0.3, linewidth=0, color=line.get_color(), label="95 % band")
    axes.set(xlabel="x (mm)", ylabel="y (mm)", aspect="equal", title=trial.trace.name)
    axes.legend(frameon=False)
    return axes
