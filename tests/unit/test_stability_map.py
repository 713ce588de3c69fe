"""The script of the stability map: which points it measures again, and what of the table it leaves alone."""

import copy

import pytest
import stability

from openmm_dpd.simulation.advice.stability_table import StabilityTable


def smooth() -> dict:
    """Steps that go as 1/omega, known to a tenth."""
    points = [stability.BASE | {"gamma": g, "a": a, "schemes": {}} for g in (0.5, 4.5, 40.5, 450.0) for a in (6.0, 25.0, 50.0, 100.0)]
    for p in points:
        dt = 0.2 * p["a"] ** -0.5
        levels = {name: [k * dt, 0.1 * k * dt, ""] for name, k in (("1", 1), ("5", 2), ("10", 3))}
        entry = {"blow": [4 * dt, 0.0, ""], "sign": {"conf": 1, "kin": 1}, "conf": levels, "kin": levels}
        p["schemes"] = {"middle": copy.deepcopy(entry), "bababo": copy.deepcopy(entry)}
    return {"loose": 4.0, "base": stability.BASE, "cost": {"middle": 1.2, "bababo": 1.4}, "points": points}


def entry(data: dict, gamma: float, a: float, scheme: str) -> dict:
    return next(p for p in data["points"] if (p["gamma"], p["a"]) == (gamma, a))["schemes"][scheme]


def test_nothing_of_a_smooth_table_is_noisy():
    assert stability.noisy(StabilityTable(smooth())) == []


@pytest.mark.parametrize("change", ["three times too long", "three times too short", "badly known"])
@pytest.mark.parametrize("kind", ["conf", "kin"])
def test_a_point_off_its_neighbours_or_badly_known_is_noisy(change, kind):
    data = smooth()
    step = entry(data, 4.5, 25.0, "bababo")[kind]["1"]
    step[0] *= {"three times too long": 3, "three times too short": 1 / 3}.get(change, 1)
    step[1] *= 4 if change == "badly known" else 1
    assert stability.noisy(StabilityTable(data)) == [("bababo", stability.BASE)]


def test_what_was_not_measured_again_stays():
    """Errors of (dt/0.1)^2 % at one point: the step of 1 % is 0.1 there, and nothing else changes."""
    before = smooth()
    ladder = [[dt, [dt**2, 0.001], [dt**2, 0.001]] for dt in (0.05, 0.07, 0.1, 0.14, 0.2, 0.25)] + [[0.5, None, None]]

    class Measured:
        results = {"job": {"point": stability.BASE, "scheme": "middle", "loose": 1.0, "ladder": ladder, "levels": {"blow": [0.4, 0.01, ""], "sign": {"conf": 1, "kin": 1}}}}  # fmt: skip

    after = stability.tabulate(Measured(), before["cost"], before)
    assert entry(after, 4.5, 25.0, "middle")["conf"]["1"][0] == pytest.approx(0.1, rel=0.1)
    assert entry(after, 4.5, 25.0, "middle")["blow"] == [0.4, 0.01, ""]
    assert entry(after, 4.5, 25.0, "bababo") == entry(before, 4.5, 25.0, "bababo")
    others = [p for p in before["points"] if (p["gamma"], p["a"]) != (4.5, 25.0)]
    assert [p for p in after["points"] if (p["gamma"], p["a"]) != (4.5, 25.0)] == sorted(others, key=lambda p: (p["gamma"], p["a"]))
