"""Tests of the package with every scene that the plugin can run on the device: OPENMM_DPD_TEST_ENGINE=device, and the files that are listed here.

OPENMM_DPD_TEST_ENGINE=device pytest -q -m "not slow" $(python tests/on_the_device.py)
"""

import os

from openmm_dpd.plan import device
from openmm_dpd.plan.forces.device_force import why_no_plugin

ASKED = os.environ.get("OPENMM_DPD_TEST_ENGINE") == "device"

#: Forces, constraints and barostats of others, every setter, reporters, restarts, errors.
FILES = (
    "foreign_forces openmm_setters changes_between_steps mixed_system thermostat thermostat_systems membrane_barostat contexts new_contexts "
    "reporters restart sampling errors"
).split()

#: What is otherwise there by design.
DIFFERENT = {
    "test_minimizing": "OpenMM's minimiser crashes with PoCL",
    "test_positions_that_are_set_to_what_they_were_change_nothing": "the acceleration of mvv is computed anew wherever somebody sets positions",
    "test_bead_that_became_nan_is_named": "a device is asked when somebody reads a state",
    "test_ctrl_c_is_a_keyboard_interrupt": "it interrupts a force of the host",
    "test_methods_of_system_context_and_integrator[setIntegrationForceGroups-whole]": "whole steps on the device refuse it, as programs do",
    "test_a_system_in_xml_stays_small": "it looks into a force of the host",
}


def why_skipped(name: str) -> str | None:
    """Why a test is not run on the device, or None."""
    return next((why for start, why in DIFFERENT.items() if name == start or name.startswith(start + "[")), None) or why_no_plugin(
        "Reference"
    )


def take(monkeypatch) -> None:
    """Let engine="auto" take the device on every platform."""
    monkeypatch.setattr(device, "is_gpu", lambda platform: platform is not None)


if __name__ == "__main__":
    print(*(f"tests/integration/test_{name}.py" for name in FILES))
