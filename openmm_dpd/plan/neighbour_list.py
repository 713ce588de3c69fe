"""Whether the neighbour list of OpenMM's Reference platform finds every pair of a box.

It sorts particles into voxels of half a cutoff or a little more, and looks two voxels far, at one image of each voxel.  In a tilted box the
rows of voxels shift where an image begins.  So the list is right if no row is met by two images, which takes an edge of three cutoffs, and
if no shift leads further than one box to the side.  Otherwise it can miss pairs; the forces of single pairs are right all the same, and
without a list (a CustomNonbondedForce with an interaction group) so are their sums.
"""

import numpy as np

#: Room for a barostat: boxes are judged as if they were smaller by this factor.
_SHRINKS = 1.1


def may_miss_pairs(box: np.ndarray | None, cutoff: float) -> bool:
    """Whether the Reference platform's list can miss pairs at this cutoff in a box of reduced vectors (rows)."""
    if box is None:
        return False
    (a, _, _), (bx, b, _), (cx, cy, c) = box.tolist()
    reach = _SHRINKS * cutoff
    two_images = (bx != 0 and b < 3 * reach) or ((cx != 0 or cy != 0) and c < 3 * reach)
    # two voxels are at most 1.5 cutoffs
    return two_images or abs(bx) + abs(cx) > a - 1.5 * reach or abs(cy) > b - 1.5 * reach


def listed(platform: str | None, box: np.ndarray | None, cutoff: float) -> bool:
    """Whether OpenMM's pair forces with this cutoff can take their pairs from a neighbour list; they go through all pairs otherwise."""
    return platform != "Reference" or not may_miss_pairs(box, cutoff)
