"""Pictures of the atlas, for readers who have never seen a paper about DPD."""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter  # noqa: E402

from .summary import BOUND, DRIFT, EVERY  # noqa: E402

#: Colour and marker of each method: ours filled, peers open.
COLOURS = {
    "mvv": "tab:gray", "mvv, lambda 0.65": "tab:olive", "shardlow": "tab:purple", "middle": "tab:blue", "aboba": "tab:green",
    "bababo": "tab:cyan", "basa": "royalblue", "bababs": "darkcyan", "bab3": "magenta",
    "LAMMPS dpd + nve": "tab:red", "LAMMPS dpd/ext + nve": "tab:red", "LAMMPS dpd + charges + nve": "tab:red",
    "LAMMPS dpd + mvv/dpd, lambda 0.65": "tab:pink",
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


#: What the cost is that of.
_WORDS = {"T_conf": "T_conf within 1 %", "U": "energy within 1 %", "T_kin": "T_kin within 1 %", "P": "pressure within 1 %"}
_WORDS |= {"g": "g(r) within 1 %", "D": "diffusion within 1 %", "drift": "drift below 1e-7 per ps", "agree": "temperatures within 1 %"}


def draw(atlas: dict, folder: Path) -> None:
    """All pictures for which there is data."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, fluid in atlas["fluids"].items():
        measures = ("drift", "agree") if name == "energy" else ("T_conf", "U")
        unit = "ps" if name == "energy" else "reduced units"
        title = f"{fluid['title'].capitalize()}: how wrong a result is at a given time step"
        _chart(fluid, measures, "step", folder / f"atlas_{name}_step.png", title, f"time step / {unit}")
        title = f"{fluid['title'].capitalize()}: how wrong a result is for the time it takes (1 core)"
        every = measures if name == "energy" else EVERY
        _chart(fluid, every, "wall", folder / f"atlas_{name}_wall.png", title, "wall seconds for one unit of simulated time")
        if name != "energy":
            title = f"{fluid['title'].capitalize()}: other quantities"
            _chart(fluid, EVERY[2:], "step", folder / f"atlas_{name}_more.png", title, f"time step / {unit}")
    _costs(atlas, folder / "atlas_summary.png")


def series(entry: dict, measure: str, against: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """x, error and its standard error of one method."""
    x, y, e = [], [], []
    clock = entry["ms"].get("1", {})
    steps, ms = np.array([float(dt) for dt in clock]), np.array(list(clock.values()))
    for row in entry["runs"]:
        found = row["errors"]
        pair = max((found[k] for k in ("T_conf", "T_kin") if k in found), key=lambda p: abs(p[0]), default=None) if measure == "agree" else found.get(measure)  # fmt: skip
        if pair is None or (against == "wall" and not len(steps)):
            continue
        x.append(row["dt"] if against == "step" else 1e-3 * np.interp(row["dt"], steps, ms) / row["dt"])
        y.append(pair[0])
        e.append(pair[1] or 0.0)
    scale = 1.0 if measure == "drift" else 100.0
    return np.array(x), scale * np.array(y), scale * np.array(e)


def _apart(steps: list[float]) -> list[float]:
    """Those far enough from each other for their labels to be read."""
    kept = steps[:1]
    for step in steps[1:]:
        if step > max(1.12, (steps[-1] / steps[0]) ** (1 / 25)) * kept[-1]:
            kept.append(step)
    return kept


def _chart(fluid: dict, measures: tuple[str, ...], against: str, file: Path, title: str, label: str) -> None:
    # with charges there is no configurational temperature
    measures = tuple(m for m in measures if any(len(series(entry, m, against)[0]) for entry in fluid["methods"].values()))
    if not measures:
        return
    columns, rows = min(2, len(measures)), -(-len(measures) // 2)
    figure, grid = plt.subplots(rows, columns, figsize=(11 if columns > 1 else 8, 1.2 + 3.9 * rows), layout="constrained", squeeze=False)
    for axes in grid.flat[len(measures) :]:
        axes.set_axis_off()
    spare, shown = iter(SPARE), {}
    colours = {name: COLOURS.get(name) or next(spare, "gray") for name in fluid["methods"]}
    for axes, measure in zip(grid.flat, measures, strict=False):
        floor, bound = (1e-11, DRIFT) if measure == "drift" else (0.03, 100 * BOUND)
        for name, entry in fluid["methods"].items():
            x, y, e = series(entry, measure, against)
            if not len(x):
                continue
            ours, size = entry["kind"] == "ours", np.maximum(np.abs(y), floor)
            line, colour = "-" if ours else "--", colours[name]
            shown[name] = axes.errorbar(
                x, size, yerr=[np.minimum(e, size * 0.9), e], color=colour, linestyle=line, capsize=2, linewidth=1.4, label=name
            )
            for marker, which in (("^", y > 0), ("v", y < 0)) if measure != "g" else (("o", y >= 0),):
                axes.plot(x[which], size[which], marker, color=colour, markerfacecolor=colour if ours else "white", markersize=6)
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
    figure.legend(shown.values(), shown, loc="outside lower center", ncols=3, fontsize=9)
    figure.suptitle(f"{title}\nupward triangles: too large, downward: too small; open: other programs")
    figure.savefig(file, dpi=110)
    plt.close(figure)


def _costs(atlas: dict, file: Path) -> None:
    """Wall time for a unit of simulated time within the bounds, every method and measure, for the fluids that were timed."""
    timed = {name: f for name, f in atlas["fluids"].items() if any(entry["wall"].get("1") for entry in f["methods"].values())}
    if not timed:
        return
    columns = min(2, len(timed))
    lines = -(-len(timed) // columns)
    figure, grid = plt.subplots(lines, columns, figsize=(6.5 * columns, 4.6 * lines), layout="constrained", squeeze=False)
    for axes in grid.ravel()[len(timed) :]:
        axes.remove()
    for axes, (name, fluid) in zip(grid.ravel(), timed.items(), strict=False):
        measures = ("drift", "agree") if name == "energy" else EVERY
        rows = [(m, entry) for m, entry in fluid["methods"].items() if entry["wall"].get("1")][::-1]
        for number, measure in enumerate(measures):
            known = [(k, entry, entry["wall"]["1"][measure]) for k, (_, entry) in enumerate(rows) if entry["wall"]["1"].get(measure)]
            for k, entry, wall in known:
                style = {"color": f"C{number}", "marker": "o", "markersize": 5, "capsize": 2}
                style |= {} if entry["kind"] == "ours" else {"markerfacecolor": "white"}
                towards = {"<=": {"xuplims": True}, ">=": {"xlolims": True}}.get(wall["bound"], {})
                error = 0.25 * wall["seconds"] if towards else wall["sem"]
                axes.errorbar(wall["seconds"], k + 0.32 - 0.64 * number / (len(measures) - 1), xerr=error, **style, **towards)
            axes.plot([], [], "o", color=f"C{number}", label=_WORDS[measure])
        axes.set_yticks(range(len(rows)), [m for m, _ in rows], fontsize=8)
        axes.hlines(np.arange(len(rows) - 1) + 0.5, 0, 1, transform=axes.get_yaxis_transform(), color="black", linewidth=0.3)
        axes.set(xscale="log", xlabel="wall seconds for one unit of simulated time, 1 core")
        # a span of less than a decade or so gets names for its minor ticks, which run into each other
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.set_title(fluid["title"], fontsize=10)
        axes.legend(fontsize=7, ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.06), frameon=False)
        axes.grid(alpha=0.25, axis="x")
    figure.suptitle("What an accurate result costs: left is better; open: other programs; arrows: bounds")
    figure.savefig(file, dpi=110)
    plt.close(figure)
