"""Garbage collection, off while many objects are made that stay."""

import gc

from openmm_dpd.base.garbage import nothing_collected


def test_what_was_made_in_the_block_counts_as_old_behind_it():
    """Else the next object would have all of them looked at once more."""
    looked: list[dict] = []

    def look(phase, info) -> None:
        looked.append(info)

    frozen, collecting = gc.get_freeze_count(), gc.isenabled()
    gc.unfreeze()  # those of the tests before
    gc.collect()
    gc.enable()
    gc.callbacks.append(look)
    try:
        with nothing_collected():
            inside, made = gc.isenabled(), [[] for _ in range(10 * gc.get_threshold()[0])]
        assert not inside and gc.isenabled() and made and not gc.get_freeze_count()
        assert not looked, "collected at once"
        gc.freeze()
        with nothing_collected():
            pass
        assert gc.get_freeze_count() > len(made), "somebody's frozen objects were thawed"
    finally:
        gc.callbacks.remove(look)
        if not collecting:
            gc.disable()
        if not frozen:
            gc.unfreeze()
