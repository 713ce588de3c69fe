"""Tests of the package with every scene that the plugin can run on the device: a plugin of pytest, and the files that are listed here.

PYTHONPATH=plugin/tests pytest -q -p on_the_device -m "not slow" $(python plugin/tests/on_the_device.py)
"""

import pytest

#: Forces, constraints and barostats of others, every setter, reporters, restarts, errors.  Not here: what runs decks in processes of their own
#: (test_energy_decks.py does), what breaks kernels of the host at a line, and momentum to 1e-13, where forces are sums of 64-bit fixed point.
FILES = (
    "foreign_forces openmm_setters changes_between_steps mixed_system thermostat thermostat_systems membrane_barostat contexts new_contexts "
    "reporters restart sampling errors"
).split()

#: What is otherwise there by design.
DIFFERENT = {
    "test_minimizing": "OpenMM's minimiser crashes with PoCL",
    "test_positions_that_are_set_to_what_they_were_change_nothing": "the acceleration of mvv is computed anew wherever somebody sets positions",
    "test_bead_that_became_nan_is_named": "a device is asked when somebody reads a state",
    "test_bead_that_is_far_away_has_a_position": "as for one that became nan",
    "test_dihedral_in_line": "dihedrals are OpenMM's there, so that one in line is refused",
    "test_ctrl_c_is_a_keyboard_interrupt": "it interrupts a force of the host",
    "test_methods_of_system_context_and_integrator[setIntegrationForceGroups-whole]": "whole steps on the device refuse it, as programs do",
    "test_a_system_in_xml_stays_small": "it looks into a force of the host",
    "test_reports_within_a_run_are_those_between_runs": "reports are taken within runs of the host alone",
    "test_ctrl_c_while_rows_are_written_loses_none": "reports are taken within runs of the host alone",
    "test_a_run_that_fails_has_reported_the_steps_before": "it lets a kernel of the host fail",
}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Leave out what differs, and everything where there is no plugin."""
    from openmm_dpd.plan.forces.device_force import why_no_plugin

    for item in items:
        differs = (why for start, why in DIFFERENT.items() if item.name == start or item.name.startswith(start + "["))
        why = next(differs, None) or why_no_plugin("Reference")
        if why is not None:
            item.add_marker(pytest.mark.skip(why))


@pytest.fixture(autouse=True)
def on_device(monkeypatch, engine_of_the_host) -> None:
    """engine="auto" takes the device on every platform."""
    from openmm_dpd.plan import device

    monkeypatch.setattr(device, "is_gpu", lambda platform: platform is not None)


if __name__ == "__main__":
    print(*(f"tests/core/test_{name}.py" for name in FILES))
