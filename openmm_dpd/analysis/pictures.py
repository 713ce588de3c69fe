"""Plots of results of the analysis, drawn with matplotlib but without its global state."""

import os
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..base.errors import ParameterError, require, what_is
from ..io.pictures import finish_axis, new_figure, with_unit, write_picture
from .clusters import Clusters
from .diffusion import MeanSquaredDisplacement, diffusion_coefficient
from .frames import Curve

#: Colours of lines that colour-blind readers can tell apart.
LINES = ("#1f5a99", "#b3541e", "#3b7d3b", "#7a4a8c", "#8a6d1d", "#555555")


def radial_distribution_picture(
    path: str | os.PathLike, curves: Curve | Mapping[str, Curve], *, unit: str = "nm", cutoff: float | None = None, title: str = ""
) -> None:
    """Plot one or more radial distribution functions g(r), with bands of one standard error.

    Parameters
    ----------
    path : path-like
        PNG file to write.
    curves : Curve, or mapping of str (labels) to Curve
    unit : str
        Unit of length for the axes; empty for reduced units.
    cutoff : float, optional
        Distance to mark by a thin line.
    title : str
        Title of the plot.
    """
    figure, axis = _axes()
    axis.axhline(1.0, color="0.75", linewidth=0.8, zorder=1)
    if cutoff is not None:
        axis.axvline(cutoff, color="0.6", linewidth=0.8, linestyle=":", zorder=1)
    _lines(axis, curves)
    axis.set_ylim(bottom=0)
    _write(figure, axis, path, with_unit("distance $r$", unit), "$g(r)$", title)


def structure_factor_picture(path: str | os.PathLike, curves: Curve | Mapping[str, Curve], *, unit: str = "nm", title: str = "") -> None:
    """Plot structure factors S(q), a Curve or a mapping of labels to Curves, on a logarithmic axis unless a value is <= 0."""
    figure, axis = _axes()
    _lines(axis, curves, marker="o")
    lowest = min(float(line.get_ydata().min()) for line in axis.lines)
    if lowest > 0:
        axis.set(yscale="log", ylim=(0.5 * lowest, None))
    _write(figure, axis, path, with_unit("wave number $q$", f"1/{unit}" if unit else ""), "$S(q)$", title)


def profile_picture(
    path: str | os.PathLike,
    curves: Curve | Mapping[str, Curve],
    *,
    quantity: str = "density",
    quantity_unit: str = "1/nm$^3$",
    axis_name: str = "z",
    unit: str = "nm",
    title: str = "",
) -> None:
    """Plot one or more profiles along an axis: densities, or any ``quantity`` with its unit, from :mod:`openmm_dpd.analysis.profiles`; or
    one along two axes (``axis_name="rz"``), as a map in colours."""
    figure, axis = _axes()
    if isinstance(curves, Curve) and curves.y.ndim == 2:
        if not isinstance(axis_name, str) or len(axis_name) != 2:
            raise ParameterError(f"axis_name must have two letters for a profile along two axes, not {what_is(axis_name)}")
        colours = axis.pcolormesh(*np.moveaxis(curves.x, 2, 0), curves.y, cmap="viridis", shading="nearest", rasterized=True)
        axis.set_aspect("equal")
        figure.colorbar(colours, ax=axis, label=with_unit(quantity, quantity_unit))
        return _write(figure, axis, path, with_unit(f"${axis_name[0]}$", unit), with_unit(f"${axis_name[1]}$", unit), title)
    _lines(axis, curves)
    return _write(figure, axis, path, with_unit(f"${axis_name}$", unit), with_unit(quantity, quantity_unit), title)


def displacement_picture(
    path: str | os.PathLike,
    displacement: MeanSquaredDisplacement,
    *,
    fit: tuple[float, float] | None = None,
    unit: str = "nm",
    time_unit: str = "ps",
    title: str = "",
) -> None:
    """Plot a mean squared displacement on logarithmic axes; with ``fit``, add the line of :func:`diffusion_coefficient` and its D."""
    require(displacement, MeanSquaredDisplacement, "expected what mean_squared_displacement returns")
    figure, axis = _axes()
    later = displacement.x > 0
    shown = Curve(displacement.x[later], displacement.y[later], displacement.sem[later], displacement.n_frames)
    _lines(axis, {"trajectory": shown}, marker="o")
    if fit is not None:
        found = diffusion_coefficient(displacement, fit)
        inside = (shown.x >= fit[0]) & (shown.x <= fit[1])
        slope = 2 * displacement.dimensions * (found.mean or 0.0)
        # the line passes through the mean of the fitted points
        offset = np.mean(shown.y[inside] - slope * shown.x[inside]) if inside.sum() > 1 else 0.0
        error = "" if found.sem is None else rf" $\pm$ {found.sem:.2g}"
        label = with_unit(f"$D$ = {found.mean:.4g}{error}", f"{unit}$^2$/{time_unit}" if unit else "")
        axis.plot(
            shown.x[inside], slope * shown.x[inside] + offset, color="black", linewidth=1.2, linestyle=(0, (5, 3)), label=label, zorder=5
        )
    axis.set(xscale="log", yscale="log")
    labels = with_unit("time", time_unit if unit else ""), with_unit("mean squared displacement", f"{unit}$^2$" if unit else "")
    _write(figure, axis, path, *labels, title)


def cluster_picture(path: str | os.PathLike, clusters: Clusters, *, title: str = "") -> None:
    """Plot the distribution of cluster sizes: the share of all beads or molecules that is in clusters of each size, and both means."""
    require(clusters, Clusters, "expected what cluster_sizes returns")
    figure, axis = _axes()
    size, count = clusters.distribution
    shares = size * count / np.sum(size * count)
    axis.bar(size, shares, width=max(0.8, 0.01 * float(size.max())), color=LINES[0])
    for value, name, style in (
        (clusters.number_average.mean, "mean by number", ":"),
        (clusters.weight_average.mean, "mean by weight", "--"),
    ):
        axis.axvline(value, color="black", linewidth=1.0, linestyle=style, label=f"{name}, {value:.3g}")
    _write(figure, axis, path, "size of the cluster", "share of all units", title)


# -- parts of all plots ----------------------------------------------------------------------------------------------------------
def _axes() -> tuple[Any, Any]:
    figure = new_figure(6.4, 4.0)
    return figure, figure.subplots()


def _lines(axis: Any, curves: Curve | Mapping[str, Curve], marker: str | None = None) -> None:
    """Draw curves with bands of one standard error, and markers if points are few."""
    named = {"": curves} if isinstance(curves, Curve) else curves
    if not isinstance(named, Mapping) or not named or not all(isinstance(curve, Curve) and curve.y.ndim == 1 for curve in named.values()):
        raise ParameterError(f"curves must be a Curve, or a mapping of one or more names to Curves along one axis, not {what_is(curves)}")
    for number, (name, curve) in enumerate(named.items()):
        colour = LINES[number % len(LINES)]
        dots = {"marker": marker, "markersize": 3} if marker and len(curve.x) <= 200 else {}
        axis.plot(curve.x, curve.y, color=colour, linewidth=1.7, label=name or None, zorder=4, **dots)
        axis.fill_between(curve.x, curve.y - curve.sem, curve.y + curve.sem, color=colour, alpha=0.25, linewidth=0, zorder=3)


def _write(figure: Any, axis: Any, path: str | os.PathLike, x_label: str, y_label: str, title: str) -> None:
    finish_axis(axis, y_label, legend=bool(axis.get_legend_handles_labels()[1]))
    axis.set_xlabel(x_label, fontsize=11)
    if title:
        figure.suptitle(title, fontsize=12)
    write_picture(path, figure)
