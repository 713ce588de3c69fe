"""Reporters that report within runs, that go on with a file, that say why a column is nan, and that notice a wrong temperature."""

import copy
import gc
import io
import logging
import signal

import numpy as np
import openmm
import pytest
from cases import raises
from scenes import beads

import openmm_dpd as dpd
from openmm_dpd.base.errors import ParameterError
from openmm_dpd.kernels.engine import PairEngine
from openmm_dpd.measure import StressReporter
from openmm_dpd.runtime.tape import Tape
from openmm_dpd.simulation.built import DPDSimulation

N, EDGE = 375, 5.0


def scene(kT=1.0, box=(EDGE, EDGE, EDGE), **options) -> dpd.Scene:
    return beads(N, edge=EDGE, kT=kT, box=box, **options)


def build(dt=0.02, scheme="middle", **options):
    return dpd.build(scene(**options), dt=dt, scheme=scheme, platform="CPU", seed=1)


def start(built):
    return built.simulation(properties={"Threads": "1"})


def said(caplog) -> list[str]:
    return [record.getMessage() for record in caplog.records if "compiling" not in record.getMessage()]


# -- within a run ----------------------------------------------------------------------------------------------------------------
UNLIKE = {
    "masses": {"A": 1.0, "B": 1.5},
    "types": ["A", "B", "B"] * (N // 3),
    "pairs": {pair: dpd.DPD(A=25 + 10 * k, gamma=4.5) for k, pair in enumerate((("A", "A"), ("A", "B"), ("B", "B")))},
}


def reported(scheme: str, every: int, calls: list[int], threads: int = 1) -> list:
    """Rows of a DPDReporter and of a StressReporter, alone and, every eight steps, beside another reporter; and the last positions."""
    found: list = []
    for which in range(3):
        dpd.set_threads(threads)
        built = dpd.build(
            dpd.Scene(**UNLIKE, positions=scene().positions, kT=1.0, box=[EDGE] * 3), dt=0.03, scheme=scheme, platform="CPU", seed=1
        )
        simulation, out = start(built), io.StringIO()
        columns = ("step", "time", "kT", "kT_conf", "total_energy", "pressure", "pressure_conservative", "momentum", "conserved_energy")
        stress = StressReporter(every, built)
        simulation.reporters += [[dpd.DPDReporter(out, every, built, columns)], [stress], [stress, dpd.DPDReporter(out, 8, built)]][which]
        for steps in calls:
            simulation.step(steps)
        x = simulation.context.getState(positions=True).getPositions(asNumpy=True)._value
        found += [out.getvalue(), stress.regular, stress.friction, stress.instantaneous if which else 0.0, stress.edges, x]
    return found


@pytest.mark.parametrize("scheme", ["mvv", "bababo"])
def test_reports_within_a_run_are_those_between_runs(scheme, monkeypatch):
    """The same bits, whatever the number of threads, and of the trajectory; the steps that are reported are played, too."""
    real, played = Tape.play, [0]

    def play(*arguments):
        done = real(*arguments)
        played[0] += done[0] * (arguments[-1] is not None)
        return done

    monkeypatch.setattr(Tape, "play", play)
    for every in (1, 3):
        expected, played[0] = reported(scheme, every, [1] * 50), 0
        for threads in (1, 2):
            for new, old in zip(reported(scheme, every, [37, 13], threads), expected, strict=True):
                assert np.array_equal(new, old)
        assert played[0] > 60
    dpd.set_threads(1)


@pytest.mark.parametrize("change", ["kT", "barostat", "copy", "other", "report", "steps"])
def test_what_changes_before_a_run_is_reported_as_step_by_step(change):
    """A loaded state with another temperature, a barostat that begins to act, a copy of the integrator or a System of the same beads that
    the reporter was not made for, and reporters with a method of their own."""
    found = []
    for calls in ([30], [1] * 30):
        built, twin, steps = build(scheme="mvv"), build(kT=2.0, scheme="mvv"), list[int]()
        built.system.addForce(openmm.MonteCarloBarostat(20.0, 120, 0))
        integrator, first = built.integrator, DPDSimulation(twin.plan, twin.topology, twin.system, twin.integrator)
        if change == "copy":
            integrator, first = copy.copy(integrator), start(built)
        simulation = DPDSimulation(built.plan, built.topology, built.system, integrator, openmm.Platform.getPlatform("CPU"))
        for each in (first, simulation):
            each.context.setPositions(built.positions)
            each.context.setVelocitiesToTemperature(120, 1)
            each.step(20)
        out = io.StringIO()
        stress = StressReporter(1, twin if change == "other" else built)
        row = dpd.DPDReporter(out, 1, stress.built, ("step", "kT_conf", "volume", "pressure"))
        if change == "report":
            row.report = lambda *its, report=row.report, steps=steps: steps.append(its[0].currentStep) or report(*its)
        elif change == "steps":
            row.describeNextReport = lambda simulation: {"steps": 7 - simulation.currentStep % 7, "include": []}
        elif change == "kT":
            simulation.context.setState(first.context.getState(positions=True, velocities=True, parameters=True, integratorParameters=True))
        elif change == "barostat":
            simulation.system.getForces()[-1].setFrequency(3)
        for reporter in (stress, row) if change in ("kT", "other") else (row,):
            simulation.reporters[:] = [reporter]
            for n in calls:
                simulation.step(n)
        found.append([out.getvalue(), steps, stress.regular.tolist(), stress.kT if len(stress.regular) else None])
    assert found[0] == found[1] and len(found[0][0].splitlines()) > 4


def test_ctrl_c_while_rows_are_written_loses_none():
    class Pressed(io.StringIO):
        def write(self, text):
            if text == "27\n":
                signal.raise_signal(signal.SIGINT)
            return super().write(text)

    built = build()
    simulation, out = start(built), Pressed()
    simulation.reporters.append(dpd.DPDReporter(out, 1, built, ["step"]))
    simulation.step(20)
    with pytest.raises(KeyboardInterrupt):
        simulation.step(20)
    assert out.getvalue().split() == ["step", *map(str, range(1, simulation.currentStep))] and simulation.currentStep == 40


def test_a_subclass_is_called_for_each_of_its_reports():
    """One that reports something else too, and one that chooses its steps."""

    class Twice(dpd.DPDReporter):
        def report(self, simulation, state):
            steps.append(simulation.currentStep)
            super().report(simulation, state)

    class Late(dpd.DPDReporter):
        def describeNextReport(self, simulation):
            return {"steps": max(1, 25 - simulation.currentStep), "include": []}

    for kind, expected in ((Twice, range(1, 31)), (Late, range(25, 31))):
        built, steps, out = build(), list[int](), io.StringIO()
        simulation = start(built)
        simulation.reporters.append(kind(out, 1, built, ["step"]))
        simulation.step(30)
        assert out.getvalue().split() == ["step", *map(str, expected)] and steps in ([], [*expected])


def test_a_run_that_fails_has_reported_the_steps_before(monkeypatch):
    """Each of them once: those that are taken back are reported when they are done again."""
    built = build()
    simulation, out = start(built), io.StringIO()
    simulation.reporters.append(dpd.DPDReporter(out, 1, built, ["step"]))
    simulation.step(20)
    real, calls = PairEngine.swept, [0]

    def swept(*arguments, **more):
        calls[0] += 1
        if calls[0] == 4:
            raise dpd.RunError("too tired")
        return real(*arguments, **more)

    monkeypatch.setattr(PairEngine, "swept", swept)
    with pytest.raises(openmm.OpenMMException, match="too tired"):
        simulation.step(60)
    monkeypatch.undo()
    simulation.step(80 - simulation.currentStep)
    assert out.getvalue().split() == ["step", *map(str, range(1, 81))]


# -- the temperature -------------------------------------------------------------------------------------------------------------
def test_a_temperature_that_is_off_is_said_once(caplog):
    """Velocity Verlet at 0.1 goes on, a third too hot."""
    built = build(dt=0.1, scheme="mvv")
    simulation = start(built)
    simulation.reporters.append(dpd.DPDReporter(io.StringIO(), 10, built))
    simulation.step(190)
    assert not said(caplog)
    simulation.step(700)
    (text,) = said(caplog)
    assert text.startswith("step 200: the kinetic temperature of the last 10 rows is 1.") and "above the set 1 kJ/mol" in text
    assert caplog.records[0].name == "openmm_dpd" and caplog.records[0].levelno == logging.WARNING


def test_equilibrium_a_quench_and_a_changed_temperature_say_nothing(caplog):
    """Also with a row for every step, and from a start ten times too hot; a changed temperature is compared with the rows since."""
    for options, every in (({}, 1), ({}, 20), ({"velocities": np.random.default_rng(3).normal(size=(N, 3)) * 10**0.5}, 5)):
        built = build(dt=0.04, **options)
        simulation = start(built)
        simulation.reporters.append(dpd.DPDReporter(io.StringIO(), every, built))
        simulation.step(41 * every)
    built = build(dt=0.04)
    simulation = start(built)
    simulation.reporters.append(dpd.DPDReporter(io.StringIO(), 10, built))
    simulation.step(300)
    dpd.set_kT(simulation.context, 1.5)
    simulation.step(200)
    assert not said(caplog)


def test_columns_that_will_be_nan_are_named_with_the_reason(caplog):
    charged = scene(charges=[1.0, -1.0] + [0.0] * (N - 2), electrostatics=dpd.SlaterCharges(lamda=0.2, bjerrum_length=1.0, cutoff=2.0))
    built = dpd.build(charged, dt=0.02, platform="CPU", seed=1)
    dpd.DPDReporter(io.StringIO(), 10, built)
    assert said(caplog) == ["columns of DPDReporter that will be nan: kT_conf (the interaction of charges has no Laplacian here)"]
    caplog.clear()
    dpd.DPDReporter(io.StringIO(), 10, built, ["kT", "pressure"])
    dpd.DPDReporter(io.StringIO(), 10, build())
    assert not said(caplog)
    dpd.DPDReporter(io.StringIO(), 10, build(box=None), ["pressure", "volume", "theta", "conductive_energy"])
    reasons = ["pressure, volume (there is no box)", "theta (the beads have no internal energies)"]
    reasons += ["conductive_energy (the beads have no conductive energies)"]
    assert [text.partition("nan: ")[2] for text in said(caplog)] == reasons


def test_a_wrong_argument_is_named_and_nothing_follows(tmp_path):
    """An exception in __del__, which Python only prints, is an error under pytest."""
    wrong = r"^DPDReporter needs as built the result of openmm_dpd.build.*create_mixed_system\(\), not a Scene$"
    raises(ParameterError, wrong, lambda: dpd.DPDReporter(tmp_path / "x", 10, scene()))
    raises(TypeError, ".", dpd.DPDReporter, tmp_path / "x", 10)
    gc.collect()


# -- going on with a file --------------------------------------------------------------------------------------------------------
def test_rows_go_on_after_those_that_are_there(tmp_path):
    path, columns = tmp_path / "rows.csv", ("step", "kT")
    built = build()
    simulation = start(built)

    def steps(file, **options):
        simulation.reporters[:] = [dpd.DPDReporter(file, 2, built, columns, **options)]
        simulation.step(4)
        simulation.reporters.clear()
        return [line.split(",")[0] for line in path.read_text().splitlines()]

    assert steps(path, append=True) == ["step", "2", "4"]  # not there yet
    assert steps(str(path), append=True) == ["step", "2", "4", "6", "8"]
    with open(path, "a") as file:
        assert steps(file)[-3:] == ["8", "10", "12"]
    with open(path, "r+") as file:
        file.seek(0, io.SEEK_END)
        assert steps(file, append=True)[-3:] == ["12", "14", "16"]
    before = path.read_text()
    with open(path, "a") as opened:
        for file in (path, opened):
            message = "cannot append to .*rows.csv: its header is 'step,kT', but the columns are 'step,time'"
            raises(ParameterError, message, dpd.DPDReporter, file, 2, built, ("step", "time"), append=True)
    assert path.read_text() == before
    assert steps(path) == ["step", "18", "20"]  # without append
    path.write_text("")
    with open(path, "a") as file:
        assert steps(file) == ["step", "22", "24"]
    for opened in (False, True):  # a row that was cut
        path.write_text("".join(path.read_text().splitlines(keepends=True)[:3]) + "26,0.9")
        with open(path, "a") as file:
            assert steps(file if opened else path, append=True)[:3] == ["step", "22", "24"]
        assert "0.9" not in [line.split(",")[1] for line in path.read_text().splitlines()] and len(path.read_text().splitlines()) == 5
    path.write_text("step,kT")
    assert steps(path, append=True) == ["step", "34", "36"]


def test_frames_go_on_after_those_that_are_there(tmp_path):
    path = tmp_path / "fields.npz"
    x = np.random.default_rng(1).random((81, 3)) * 3

    def energies(n=81):
        internal = dpd.InternalEnergy({"W": dpd.ConstantHeatCapacity(10.0)}, 1.0)
        pairs = {("W", "W"): dpd.EnergyDPD(A=25, sigma=3.0, kappa=1.0)}
        made = dpd.Scene({"W": 1.0}, ["W"] * n, x[:n], pairs, kT=1.0, box=[3.0] * 3, internal=internal)
        return dpd.build(made, dt=0.01, platform="CPU", seed=1)

    built = energies()
    simulation = start(built)
    for _ in range(2):
        simulation.reporters[:] = [dpd.FieldReporter(path, 2, built, append=True)]
        simulation.step(6)
    found = dpd.load_fields(path)
    assert found["step"].tolist() == [2, 4, 6, 8, 10, 12] and found["theta"].shape == (6, 81)
    np.testing.assert_array_equal(found["u_mech"][-1], dpd.read_fields(simulation.context, built.plan)["u_mech"])

    other = energies(80)
    fewer = start(other)
    fewer.reporters.append(dpd.FieldReporter(path, 2, other, append=True))
    other = r"cannot append to .*fields.npz: its frames hold .*theta \[81\].*, and this one .*theta \[80\]"
    raises(ParameterError, other, lambda: fewer.step(2))
    liquid = dpd.Scene({"W": 1.0}, ["W"] * 81, x, {("W", "W"): dpd.MDPD(A=-40, B=25, gamma=4.5)}, kT=1.0, box=[3.0] * 3)
    drops = dpd.build(liquid, dt=0.01, platform="CPU", seed=1)
    drop = start(drops)
    drop.reporters.append(dpd.FieldReporter(path, 2, drops, append=True))
    raises(ParameterError, r"its frames hold step, theta \[81\], .*, and this one density \[81\], step, time", lambda: drop.step(2))
    assert len(dpd.load_fields(path)["step"]) == 6

    path.write_bytes(path.read_bytes()[:-50])
    with pytest.raises(ParameterError, match="cannot append to .*fields.npz: it is no archive of frames, or its writing was cut short"):
        dpd.FieldReporter(path, 2, built, append=True)
    simulation.reporters[:] = [dpd.FieldReporter(path, 2, built)]
    simulation.step(2)
    assert dpd.load_fields(path)["step"].tolist() == [14]
