"""What two beads exchange in one update of energy-conserving DPD: see :mod:`.energy` for the equations."""

import numpy as np

from ..runtime import helper, inlined, merged
from .elementary import exp, power
from .eos import CONSTANT, RESERVOIR, curvature, entropy_change, in_range, inverse_temperature, log_ratio
from .exchange import alike, all_of, part_of
from .layer import EXACT
from .sweeps import decay, relaxed


@helper
def _shared_temperature(bi, bj, ci, cj, ki, kj, start, nodes, pieces):
    """Theta of a pair from bi = u_i + K/2 and bj = u_j + K/2, which motion and friction conserve: near K = Theta/2, its mean."""
    rest = 2.0 / (inverse_temperature(bi, ci, ki, start, nodes, pieces) + inverse_temperature(bj, cj, kj, start, nodes, pieces))
    si, sj = bi - 0.25 * rest, bj - 0.25 * rest
    if in_range(si, ci, ki, start, nodes) and in_range(sj, cj, kj, start, nodes):
        return 2.0 / (inverse_temperature(si, ci, ki, start, nodes, pieces) + inverse_temperature(sj, cj, kj, start, nodes, pieces))
    return rest


@helper
def _balance(total, ci, cj, ki, kj, start, nodes, pieces):
    """The share of bead i at which two beads that hold ``total`` have one temperature (40 bisections; any function of total would do)."""
    if ki == CONSTANT and kj == CONSTANT:
        return total * ci / (ci + cj)
    if ki == CONSTANT and kj == RESERVOIR:
        return ci * cj
    if kj == CONSTANT and ki == RESERVOIR:
        return total - ci * cj
    # a reservoir takes what is left: only the other bead limits the share
    low, high = -np.inf, np.inf
    if ki != RESERVOIR:
        low = 0.0 if ki == CONSTANT else nodes[start[ki]]
        high = np.inf if ki == CONSTANT else nodes[start[ki + 1] - 1]
    if kj != RESERVOIR:
        low = max(low, -np.inf if kj == CONSTANT else total - nodes[start[kj + 1] - 1])
        high = min(high, total if kj == CONSTANT else total - nodes[start[kj]])
    for _ in range(40):
        middle = 0.5 * (low + high)
        here = inverse_temperature(middle, ci, ki, start, nodes, pieces)
        if here < inverse_temperature(total - middle, cj, kj, start, nodes, pieces):
            high = middle
        else:
            low = middle
    return 0.5 * (low + high)


@inlined
def passes(exponent, drawn):
    """Metropolis test; exp(x) >= 1 + x decides nearly always, and the processor predicts that branch better than the sign of x."""
    return drawn < 1.0 + exponent or (exponent < 0.0 and drawn < exp(exponent))


# Beads of constant heat capacity are the usual case. What follows is the same as for any other, with short chains of divisions: each pair
# waits for the energies that the pair before it left.


@inlined
def moved_constants(ev, im, ui, uj, ci, cj, strength, dt, xi):
    """(Relative velocity after an exact update before its test, energy that each bead gets, 1/Theta)."""
    quarter = 0.25 / im
    bi, bj = ui + quarter * ev * ev, uj + quarter * ev * ev
    rest = 0.5 * bi * bj / (ci * bj + cj * bi)
    rest = rest if (bi - rest > 0.0) & (bj - rest > 0.0) else 0.0
    si, sj = bi - rest, bj - rest
    above, below = 2.0 * si * sj, ci * sj + cj * si
    theta, inverse = above / below, below / above
    new = relaxed(ev, decay(EXACT, 0.5 * strength * im * dt * inverse), theta * im, xi)
    return new, quarter * (ev - new) * (ev + new), inverse


@inlined
def conducted_by_constants(ui, uj, exchange, xi, ci, cj):
    """(Energy that goes to bead i in one exact update of the heat before its test, what that adds to the change of entropy), with
    ``exchange`` = (e, W_i, W_j, s/theta) of :mod:`.exchange`."""
    e, wi, wj, moving = exchange
    scale = 1.0 / (ci + cj)
    unit = all_of(e, cj * scale, ci * scale, wi, wj)
    share = (ui + uj) * (ci * scale)
    variance = share * (ui + uj - share) * scale
    precision = 1.0 / variance
    every = unit * precision
    lost = part_of(e * precision, every, decay(EXACT, every), alike(ci, cj), moving * ((ui + uj) * scale))
    old = ui - share
    new = relaxed(old, lost, variance, xi)
    return new - old, 0.5 * (new - old) * (new + old) * precision


@merged
def motion_of_constants(ev, im, ui, uj, ci, cj, strength, dt, xi, drawn):
    """(Relative velocity after an exact update, energy that each bead gets); the old velocity and 0 if the move is rejected."""
    new, gain, inverse = moved_constants(ev, im, ui, uj, ci, cj, strength, dt, xi)
    if not (ui + gain > 0.0 and uj + gain > 0.0):
        return ev, 0.0
    entropy = _entropy_of_constants(ui, uj, ui + gain, uj + gain, ci, cj)
    return (new, gain) if passes(entropy - 2.0 * gain * inverse, drawn) else (ev, 0.0)


@merged
def conduction_of_constants(ui, uj, exchange, xi, drawn, ci, cj):
    """Energy that goes to bead i in one exact update of the heat."""
    change, exponent = conducted_by_constants(ui, uj, exchange, xi, ci, cj)
    if not (ui + change > 0.0 and uj - change > 0.0):
        return 0.0
    return change if passes(_entropy_of_constants(ui, uj, ui + change, uj - change, ci, cj) + exponent, drawn) else 0.0


@inlined
def _entropy_of_constants(ui, uj, new_i, new_j, ci, cj):
    """Change of the entropy of two beads; one logarithm if they are alike."""
    return ci * log_ratio(new_i * new_j, ui * uj) if ci == cj else ci * log_ratio(new_i, ui) + cj * log_ratio(new_j, uj)


@helper
def _exact_motion(ev, im, ui, uj, strength, dt, xi, drawn, states, curves):
    """(Relative velocity after an exact update, energy that each bead gets); the old velocity and 0 if the move is rejected."""
    ci, cj, ki, kj = states
    start, nodes, pieces = curves
    kinetic = 0.5 * ev * ev / im
    theta = _shared_temperature(ui + 0.5 * kinetic, uj + 0.5 * kinetic, ci, cj, ki, kj, start, nodes, pieces)
    lost = decay(EXACT, 0.5 * strength / theta * im * dt)
    new = ev * (1.0 - lost) + np.sqrt(lost * (2.0 - lost) * theta * im) * xi
    gain = 0.25 * (ev - new) * (ev + new) / im
    if not (in_range(ui + gain, ci, ki, start, nodes) and in_range(uj + gain, cj, kj, start, nodes)):
        return ev, 0.0
    exponent = (
        entropy_change(ui, ui + gain, ci, ki, start, nodes, pieces)
        + entropy_change(uj, uj + gain, cj, kj, start, nodes, pieces)
        - 2.0 * gain / theta
    )
    return (new, gain) if passes(exponent, drawn) else (ev, 0.0)


@helper
def _exact_conduction(ui, uj, exchange, xi, drawn, states, curves):
    """Energy that goes to bead i in one exact update of the heat."""
    ci, cj, ki, kj = states
    start, nodes, pieces = curves
    total = ui + uj
    share = _balance(total, ci, cj, ki, kj, start, nodes, pieces)
    bi, bj = curvature(share, ci, ki, start, nodes, pieces), curvature(total - share, cj, kj, start, nodes, pieces)
    # a flat piece of a table has no curvature; any positive number that depends on the total alone is legal
    slope = inverse_temperature(share, ci, ki, start, nodes, pieces)
    more = max(0.5e-6 * slope * slope - 0.5 * (bi + bj), 0.0)
    variance = 1.0 / (bi + bj + 2.0 * more)
    bi, bj, (e, wi, wj, moving) = bi + more, bj + more, exchange
    every = all_of(e, bi, bj, wi, wj)
    lost = part_of(e * (bi + bj), every, decay(EXACT, every), alike(bi, bj), moving / slope)
    old = ui - share
    new = relaxed(old, lost, variance, xi)
    change = new - old
    if not (in_range(ui + change, ci, ki, start, nodes) and in_range(uj - change, cj, kj, start, nodes)):
        return 0.0
    exponent = (
        entropy_change(ui, ui + change, ci, ki, start, nodes, pieces)
        + entropy_change(uj, uj - change, cj, kj, start, nodes, pieces)
        + 0.5 * (new * new - old * old) / variance
    )
    return change if passes(exponent, drawn) else 0.0


@merged
def any_motion(ev, im, ui, uj, strength, dt, xi, drawn, states, curves):
    """(Relative velocity after an exact update, energy that each bead gets) for beads with any equation of state."""
    ci, cj, ki, kj = states
    if ki == CONSTANT and kj == CONSTANT:
        return motion_of_constants(ev, im, ui, uj, ci, cj, strength, dt, xi, drawn)
    return _exact_motion(ev, im, ui, uj, strength, dt, xi, drawn, states, curves)


@merged
def any_conduction(ui, uj, exchange, xi, drawn, states, curves):
    """Energy that goes to bead i in one exact update of the heat, for beads with any equation of state."""
    ci, cj, ki, kj = states
    if ki == CONSTANT and kj == CONSTANT:
        return conduction_of_constants(ui, uj, exchange, xi, drawn, ci, cj)
    return _exact_conduction(ui, uj, exchange, xi, drawn, states, curves)


# Beads of eDPD, whose temperatures are what is kept; a is 1/C, 0 for a bead that does not move.


@inlined
def gained(ti, new, energy, a):
    """Change of the entropy of a bead that gets an energy, and has another temperature then unless that stays."""
    return log_ratio(new, ti) / a if a > 0.0 else energy / ti


@merged
def exchanged(lost, mean, ti, tj, ai, aj, xi, drawn):
    """Energy that goes to bead i in an update that takes the part ``lost`` of a difference away; ``mean``: the temperature it keeps."""
    both = ai + aj
    bent, old, variance = (ai - aj) / mean, (ti - tj) / both, mean * mean / both
    root = power((ti + tj - mean) / mean, 1.0 / 3.0) if bent != 0.0 else 1.0
    z = 3.0 * old / (1.0 + root + root * root)
    new = relaxed(z, lost, variance, xi)
    y = bent * new / 3.0
    flow = new * (1.0 + y + y * y / 3.0) - old
    ni, nj = ti + ai * flow, tj - aj * flow
    if not (1.0 + y > 0.0 and ni > 0.0 and nj > 0.0):
        return 0.0
    exponent = gained(ti, ni, flow, ai) + gained(tj, nj, -flow, aj) + 0.5 * (new - z) * (new + z) / variance
    if bent != 0.0:
        exponent += 2.0 * log_ratio(1.0 + y, root)
    return flow if passes(exponent, drawn) else 0.0
