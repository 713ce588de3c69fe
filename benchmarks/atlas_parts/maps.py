"""Pictures and tables of the stability map."""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402

from .page import table as markdown  # noqa: E402

NAMES = {"rho": "density", "mass": "mass ratio", "s": "exponent of the noise weight", "cv": "heat capacity of a bead / k_B"}
KINDS = {"conf": "configurational temperature", "kin": "kinetic temperature"}
COLOURS = {
    "mvv": "tab:gray",
    "shardlow": "tab:purple",
    "middle": "tab:blue",
    "aboba": "tab:green",
    "bababo": "tab:cyan",
    "basa": "royalblue",
    "bababs": "darkcyan",
    "bab3": "magenta",
    "native": "tab:orange",
}


def draw(table: dict, folder: Path) -> None:
    """Maps of the plane friction times repulsion, and lines of everything else."""
    folder.mkdir(parents=True, exist_ok=True)
    for kind, words in KINDS.items():
        _planes(
            table,
            folder / f"stability_{kind}.png",
            lambda e, k=kind: e[k]["1"] or e["kin"]["1"],
            f"longest step with the {words} within 1 %",
        )
    _planes(table, folder / "stability_blow.png", lambda e: e["blow"], "step at which a run blows up")
    _lines(table, folder / "stability_lines.png")


def _base(table: dict, point: dict, but: str = "") -> bool:
    return all(point[name] == table["base"][name] for name in NAMES if name != but)


def plane(table: dict, scheme: str, take) -> tuple[list, list, np.ndarray, dict]:
    """Frictions, repulsions, the step that ``take`` finds at each point (NaN where the table has nothing), and as a text with its error."""
    points = [p for p in table["points"] if _base(table, p) and scheme in p["schemes"]]
    gammas, repulsions = (sorted({p[name] for p in points}) for name in ("gamma", "a"))
    values, texts = np.full((len(repulsions), len(gammas)), np.nan), {}
    for p in points:
        place, (dt, sem, kind) = (repulsions.index(p["a"]), gammas.index(p["gamma"])), take(p["schemes"][scheme])
        values[place], texts[place] = dt, f"{kind}{dt:.2g}" if kind else f"{dt:.2g}\n±{sem:.1g}"
    return gammas, repulsions, values, texts


def _planes(table: dict, file: Path, take, title: str) -> None:
    schemes = list(table["cost"])
    rows = -(-len(schemes) // 3)
    figure, grid = plt.subplots(rows, 3, figsize=(12.5, 3.8 * rows), layout="constrained", squeeze=False)
    image = None
    for axes in grid.flat[len(schemes) :]:
        axes.set_axis_off()
    for axes, scheme in zip(grid.flat, schemes, strict=False):
        gammas, repulsions, values, texts = plane(table, scheme, take)
        if not gammas:
            continue
        image = axes.imshow(np.log10(values), origin="lower", aspect="auto", cmap="viridis", vmin=-2.3, vmax=0)
        for (row, column), text in texts.items():
            color = "white" if values[row, column] < 0.15 else "black"
            axes.text(column, row, text, ha="center", va="center", fontsize=7, color=color)
        axes.set_xticks(range(len(gammas)), [f"{g:g}" for g in gammas], fontsize=8)
        axes.set_yticks(range(len(repulsions)), [f"{a:g}" for a in repulsions], fontsize=8)
        axes.set(title=scheme, xlabel="friction", ylabel="repulsion")
    figure.suptitle(f"{title} (reduced units, density 3; brighter: longer steps)", fontsize=10)
    if image is not None:
        figure.savefig(file, dpi=110)
    plt.close(figure)


def _lines(table: dict, file: Path) -> None:
    figure, grid = plt.subplots(2, len(NAMES), figsize=(3.6 * len(NAMES), 6.4), layout="constrained", squeeze=False)
    for column, (name, words) in enumerate(NAMES.items()):
        for row, gamma in enumerate((4.5, 40.5)):
            axes = grid[row, column]
            ticks: set[float] = set()
            for scheme, colour in COLOURS.items():
                rows = line(table, scheme, name, gamma)
                if rows:
                    ticks |= {value for value, _ in rows}
                    x, y, e = np.array([(v, entry["conf"]["1"][0], entry["conf"]["1"][1]) for v, entry in rows]).T
                    axes.errorbar(x, y, yerr=e, marker="o", markersize=4, capsize=2, color=colour, label=scheme)
                    axes.plot(x, [entry["blow"][0] for _, entry in rows], linestyle=":", color=colour)
            if not ticks:
                axes.set_axis_off()
                continue
            axes.set(xscale="log", yscale="log", xlabel=words, title=f"friction {gamma:g}")
            axes.set_xticks(sorted(ticks), [f"{value:g}" for value in sorted(ticks)])
            axes.yaxis.set_major_formatter("{x:g}")
            axes.minorticks_off()
            axes.set_yticks([dt for dt in (0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0) if axes.get_ylim()[0] < dt < axes.get_ylim()[1]])
            axes.grid(alpha=0.25)
        grid[0, column].set_ylabel("step" if column == 0 else "")
    handles, labels = grid[0, 0].get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside lower center", ncols=4)
    figure.suptitle("Step with the configurational temperature within 1 % (points), and step that blows up (dotted)", fontsize=10)
    figure.savefig(file, dpi=110)
    plt.close(figure)


def line(table: dict, scheme: str, name: str, gamma: float) -> list[tuple[float, dict]]:
    """(value, entry) along a line of the table, the base fluid included, where there is a configurational temperature."""
    points = [
        p for p in table["points"] if _base(table, p, name) and p["gamma"] == gamma and p["a"] == table["base"]["a"] and p[name] is not None
    ]
    return sorted(
        ((p[name], p["schemes"][scheme]) for p in points if scheme in p["schemes"] and p["schemes"][scheme]["conf"]["1"]),
        key=lambda r: r[0],
    )


def blocks(table: dict) -> dict[str, str]:
    """Blocks of the page: what was run, and the plane as a table."""
    m = table["machine"]
    about = f"{table['date']}, {m['processor']}; {len(table['points'])} points; steps with standard errors."
    found = {"stability-about": about}
    for kind in KINDS:
        rows = []
        for p in table["points"]:
            if _base(table, p):
                cells = [_cell(p["schemes"].get(s, {}).get(kind, {}).get("1")) for s in table["cost"]]
                rows.append([f"{p['gamma']:g}", f"{p['a']:g}", *cells])
        found[f"stability-{kind}"] = markdown(["friction", "repulsion", *(f"`{s}`" for s in table["cost"])], rows)
    rows = [
        [f"{p['gamma']:g}", f"{p['a']:g}", *(_cell(p["schemes"].get(s, {}).get("blow")) for s in table["cost"])]
        for p in table["points"]
        if _base(table, p)
    ]
    found["stability-blow"] = markdown(["friction", "repulsion", *(f"`{s}`" for s in table["cost"])], rows)
    return found


def _cell(entry: list | None) -> str:
    if entry is None:
        return "-"
    dt, sem, kind = entry
    return f"{kind} {dt:.2g}" if kind else f"{dt:.2g} ± {sem:.1g}"
