"""The tables of docs/atlas.md, between marks that say where each begins and ends; everything in them comes from the JSON files."""

from __future__ import annotations

import re
from pathlib import Path

from .summary import EVERY, step_of

MEASURES = {"T_conf": "T_conf", "U": "potential energy", "T_kin": "T_kin", "P": "pressure", "g": "g(r)", "D": "diffusion", "drift": "drift", "agree": "temperatures agree", "both": "both"}  # fmt: skip


def blocks(atlas: dict) -> dict[str, str]:
    """{name of the block: its text}."""
    found = {"machine": _machine(atlas), "targets": _targets(atlas), "reference": _references(atlas)}
    for name, fluid in atlas["fluids"].items():
        found[f"limits-{name}"] = _limits(name, fluid)
        found[f"figures-{name}"] = _pictures(atlas, name)
        found[f"errors-{name}"] = _errors(name, fluid)
    timed = any(entry["wall"] for fluid in atlas["fluids"].values() for entry in fluid["methods"].values())
    found["figures-summary"] = "![cost at 1 %](figures/atlas_summary.png)" if timed else ""
    return found


def _pictures(atlas: dict, name: str) -> str:
    """Links to the pictures there are."""
    timed = any(entry["ms"].get("1") for entry in atlas["fluids"][name]["methods"].values())
    kinds = (
        {"step": "error and step"}
        | ({"wall": "error and cost"} if timed else {})
        | ({"more": "other quantities"} if name != "energy" else {})
    )
    return "\n".join(f"![{words}](figures/atlas_{name}_{kind}.png)" for kind, words in kinds.items())


def summary_text(atlas: dict) -> str:
    """Everything as text, for the terminal."""
    return "\n\n".join(text for name, text in blocks(atlas).items() if not name.startswith(("errors", "figures")))


def update(file: Path, *sources: dict, texts: dict[str, str] | None = None) -> None:
    """Put blocks into a page, between ``<!-- begin NAME -->`` and ``<!-- end NAME -->``."""
    page = file.read_text()
    for name, text in ({k: v for atlas in sources for k, v in blocks(atlas).items()} | (texts or {})).items():
        page = replaced(page, name, text)
    file.write_text(page)


def replaced(page: str, name: str, text: str) -> str:
    """The page with one block exchanged; unchanged if it has no such block."""
    return re.sub(
        rf"(<!-- begin {name} -->\n).*?(<!-- end {name} -->)", lambda m: f"{m.group(1)}\n{text}\n\n{m.group(2)}", page, flags=re.DOTALL
    )


def block_of(page: str, name: str) -> str | None:
    """The text of a block of a page."""
    found = re.search(rf"<!-- begin {name} -->\n(.*?)<!-- end {name} -->", page, flags=re.DOTALL)
    return found.group(1).strip() if found else None


def table(header: list[str], rows: list[list[str]]) -> str:
    """A Markdown table."""
    lines = ["| " + " | ".join(header) + " |", "|" + " --- |" * len(header)]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows])


def step_text(limit: dict | None) -> str:
    """A step with its error in the last digits, or the bound that is known."""
    if not limit:
        return "-"
    dt, sem, sign = step_of(limit)
    return {">=": f"> {dt:.3g}", "<=": f"< {dt:.3g}"}.get(sign, f"{dt:.3g} ± {sem:.1g}")


def _machine(atlas: dict) -> str:
    m, s = atlas["machine"], atlas["settings"]
    quick = " **These are the numbers of a quick run with large errors.**" if atlas["quick"] else ""
    return (
        f"{atlas['date']}: {m['processor']}, {m['cores']} cores; Python {m['python']}, OpenMM {m['openmm']}, LAMMPS {m['lammps']}, "
        f"numba {m['numba']}. Accuracy: {s['beads']} beads, {s['time']:g} units of time for each run. "
        f"Times: {s['clock'][0]} beads, best of {s['clock'][2]} rounds.{quick}"
    )


def _targets(atlas: dict) -> str:
    rows = []
    for t in atlas["targets"]:
        mine = t["ratios"][t["scheme"]]
        cells = [f"{word_of(r['bound'])}{r['ratio']:.3g}{error_text(r['sem'])} ({MEASURES[m]})" for m, r in mine.items()]
        title = atlas["fluids"][t["fluid"]]["title"]
        rows.append(
            [title, t["peer"], str(t["cores"]), f"{t['aim']:g}", f"`{t['scheme']}`", "; ".join(cells), "yes" if t["reached"] else "no"]
        )
    if not rows:
        return "Nothing was timed yet."
    return table(["fluid", "compared with", "cores", "goal", "scheme", "speed-up", "reached"], rows)


def error_text(sem: float) -> str:
    """± and an error, in one digit below 10."""
    return f" ± {sem:.1g}" if 0.0 < sem < 9.5 else f" ± {sem:.0f}" if sem else ""


def cores_text(number: int | str) -> str:
    return "1 core" if int(number) == 1 else f"{number} cores"


def word_of(bound: str) -> str:
    return {">=": "> ", "<=": "< ", "?": "about "}.get(bound, "")


def _references(atlas: dict) -> str:
    rows = []
    for fluid in atlas["fluids"].values():
        if fluid["reference"]:
            cells = [f"{v[0]:.4g} ± {v[1]:.1g}" if v else "-" for v in (fluid["reference"].get(k) for k in ("U", "P", "D"))]
            rows.append([fluid["title"], *cells, f"{fluid['dU_dkT'][0]:.3g} ± {fluid['dU_dkT'][1]:.1g}" if fluid["dU_dkT"] else "-"])
    return table(["fluid", "U/N", "pressure", "diffusion", "dU/dkT per bead"], rows)


def _limits(name: str, fluid: dict) -> str:
    measures = ("drift", "agree", "both") if name == "energy" else EVERY
    main = measures[:2]
    cores = sorted({c for entry in fluid["methods"].values() for c in entry["wall"]})
    header = [
        "method",
        *(f"dt, {MEASURES[m]}" for m in measures),
        *(f"s per time, {cores_text(c)}, {MEASURES[m]}" for c in cores for m in main),
    ]
    rows = []
    for method, entry in fluid["methods"].items():
        walls = [entry["wall"].get(c, {}).get(m) for c in cores for m in main]
        cells = [f"{word_of(w['bound'])}{w['seconds']:.3g}" if w else "-" for w in walls]
        rows.append([f"`{method}`" if entry["kind"] == "ours" else method, *(step_text(entry["limits"].get(m)) for m in measures), *cells])
    return table(header, rows)


def _errors(name: str, fluid: dict) -> str:
    measures = ("T_conf", "T_kin", "drift") if name == "energy" else ("T_conf", "T_kin", "U", "P", "g", "D")
    rows = []
    for method, entry in fluid["methods"].items():
        for run in entry["runs"]:
            cells = [_error_text(run["errors"].get(m), m) for m in measures]
            rows.append([method, f"{run['dt']:g}", *(["fails"] + ["-"] * (len(measures) - 1) if "failed" in run else cells)])
    return table(["method", "dt", *(MEASURES[m] for m in measures)], rows)


def _error_text(pair: list | None, measure: str) -> str:
    if pair is None:
        return "-"
    if measure == "drift":
        return f"{pair[0]:+.1e} ± {pair[1]:.0e}"
    return f"{100 * pair[0]:+.2f} ± {100 * (pair[1] or 0):.2f} %"
