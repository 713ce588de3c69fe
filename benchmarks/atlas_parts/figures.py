"""Pictures of the atlas, for readers who have never seen a paper about DPD."""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter  # noqa: E402

from .summary import BOUND, DRIFT  # noqa: E402

#: Colour and marker of each method: ours filled, peers open.
COLOURS = {
    "mvv": "tab:gray", "mvv, lambda 0.65": "tab:olive", "shardlow": "tab:purple", "middle": "tab:blue", "aboba": "tab:green",
    "bababo": "tab:cyan",
    "LAMMPS dpd + nve": "tab:red", "LAMMPS dpd/ext + nve": "tab:red", "LAMMPS dpd + charges + nve": "tab:red",
    "LAMMPS dpd/fdt + shardlow": "tab:orange", "LAMMPS dpd/fdt/energy + shardlow": "tab:orange",
    "OpenMM DPDIntegrator, CPU": "black", "OpenMM DPDIntegrator, OpenCL": "tab:brown",
}  # fmt: skip
SPARE = ("tab:pink", "gold", "teal", "navy")

LABELS = {
    "T_conf": "error of the configurational temperature / %",
    "U": "error of the potential energy,\nas a temperature / %",
    "T_kin": "error of the kinetic temperature / %",
    "P": "error of the pressure / %",
    "g": "error of the structure g(r) / %",
    "D": "error of the diffusion coefficient / %",
    "drift": "drift of the total energy per ps, relative",
    "agree": "largest difference between temperatures / %",
}


def draw(atlas: dict, folder: Path) -> None:
    """All pictures for which there is data."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, fluid in atlas["fluids"].items():
        measures = ("drift", "agree") if name == "energy" else ("T_conf", "U")
        unit = "ps" if name == "energy" else "reduced units"
        title = f"{fluid['title'].capitalize()}: how wrong a result is at a given time step"
        _chart(fluid, measures, "step", folder / f"atlas_{name}_step.png", title, f"time step / {unit}")
        title = f"{fluid['title'].capitalize()}: how wrong a result is for the time it takes (1 core)"
        _chart(fluid, measures, "wall", folder / f"atlas_{name}_wall.png", title, "wall seconds for one unit of simulated time")
        if name != "energy":
            title = f"{fluid['title'].capitalize()}: other quantities"
            _chart(fluid, ("T_kin", "P", "g", "D"), "step", folder / f"atlas_{name}_more.png", title, f"time step / {unit}")
    _bars(atlas, folder / "atlas_summary.png")


def series(entry: dict, measure: str, against: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """x, |error| and its standard error of one method."""
    x, y, e = [], [], []
    clock = entry["ms"].get("1", {})
    steps, ms = np.array([float(dt) for dt in clock]), np.array(list(clock.values()))
    for row in entry["runs"]:
        found = row["errors"]
        pair = max((found[k] for k in ("T_conf", "T_kin") if k in found), key=lambda p: abs(p[0]), default=None) if measure == "agree" else found.get(measure)  # fmt: skip
        if pair is None or (against == "wall" and not len(steps)):
            continue
        x.append(row["dt"] if against == "step" else 1e-3 * np.interp(row["dt"], steps, ms) / row["dt"])
        y.append(abs(pair[0]))
        e.append(pair[1] or 0.0)
    scale = 1.0 if measure == "drift" else 100.0
    return np.array(x), scale * np.array(y), scale * np.array(e)


def _apart(steps: list[float]) -> list[float]:
    """Those far enough from each other for their labels to be read."""
    kept = steps[:1]
    for step in steps[1:]:
        if step > 1.12 * kept[-1]:
            kept.append(step)
    return kept


def _chart(fluid: dict, measures: tuple[str, ...], against: str, file: Path, title: str, label: str) -> None:
    columns = 2
    figure, grid = plt.subplots(
        len(measures) // 2, columns, figsize=(11, 1.2 + 3.9 * (len(measures) // 2)), layout="constrained", squeeze=False
    )
    spare, drawn = iter(SPARE), False
    colours = {name: COLOURS.get(name) or next(spare, "gray") for name in fluid["methods"]}
    for axes, measure in zip(grid.ravel(), measures, strict=True):
        floor, bound = (1e-11, DRIFT) if measure == "drift" else (0.03, 100 * BOUND)
        for name, entry in fluid["methods"].items():
            x, y, e = series(entry, measure, against)
            if not len(x):
                continue
            drawn, ours = True, entry["kind"] == "ours"
            low = np.minimum(e, np.maximum(y, floor) * 0.9)
            axes.errorbar(
                x, np.maximum(y, floor), yerr=[low, e], color=colours[name], marker="o" if ours else "s", linestyle="-" if ours else "--",
                markerfacecolor=None if ours else "white", capsize=2, linewidth=1.6, markersize=5, label=name,
            )  # fmt: skip
        axes.axhline(bound, color="black", linewidth=0.8)
        axes.axhspan(floor, bound, color="tab:green", alpha=0.08)
        axes.set(xscale="log", yscale="log", xlabel=label, ylabel=LABELS[measure])
        axes.set_ylim(bottom=floor)
        if against == "step":
            steps = _apart(sorted({run["dt"] for entry in fluid["methods"].values() for run in entry["runs"]}))
            axes.set_xticks(steps, [f"{dt:g}" for dt in steps], rotation=60, fontsize=8)
            axes.set_xticks([], minor=True)
        axes.grid(alpha=0.25, which="both")
        better = "right and lower is better" if against == "step" else "left and lower is better"
        axes.set_title(
            f"{'below the line: accurate enough' if measure != 'drift' else 'below the line: less than 1e-7'}; {better}", fontsize=9
        )
    if drawn:
        handles, labels = grid.ravel()[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=9)
        figure.suptitle(title)
        figure.savefig(file, dpi=110)
    plt.close(figure)


def _bars(atlas: dict, file: Path) -> None:
    """Wall time for a unit of simulated time at 1 %, every method, for the fluids that were timed."""
    timed = {name: f for name, f in atlas["fluids"].items() if any(entry["wall"].get("1") for entry in f["methods"].values())}
    if not timed:
        return
    columns = min(2, len(timed))
    lines = -(-len(timed) // columns)
    figure, grid = plt.subplots(lines, columns, figsize=(6.5 * columns, 4.2 * lines), layout="constrained", squeeze=False)
    for axes in grid.ravel()[len(timed) :]:
        axes.remove()
    for axes, (name, fluid) in zip(grid.ravel(), timed.items(), strict=False):
        measures = ("drift", "agree") if name == "energy" else ("T_conf", "U")
        rows = [(m, entry) for m, entry in fluid["methods"].items() if entry["wall"].get("1")][::-1]
        for k, (_, entry) in enumerate(rows):
            for shift, measure, colour in ((0.2, measures[0], "tab:blue"), (-0.2, measures[1], "tab:orange")):
                wall = entry["wall"]["1"].get(measure)
                if wall:
                    axes.barh(
                        k + shift, wall["seconds"], 0.38, xerr=wall["sem"], color=colour, alpha=1.0 if entry["kind"] == "ours" else 0.45
                    )
        axes.set_yticks(range(len(rows)), [m for m, _ in rows], fontsize=8)
        axes.set(xscale="log", xlabel="wall seconds for one unit of simulated time, 1 core")
        # a span of less than a decade or so gets names for its minor ticks, which run into each other
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        words = ("drift below 1e-7 per ps", "temperatures agree within 1 %") if name == "energy" else ("configurational temperature within 1 %", "potential energy within 1 %")  # fmt: skip
        axes.set_title(f"{fluid['title']}\nblue: {words[0]}\norange: {words[1]}", fontsize=9)
        axes.grid(alpha=0.25, axis="x")
    figure.suptitle("What an accurate result costs (shorter is better; pale bars: other programs)")
    figure.savefig(file, dpi=110)
    plt.close(figure)
