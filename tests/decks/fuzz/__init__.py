"""Random decks, run by LAMMPS and by openmm_dpd, and compared.

``python tests/decks/fuzz --seeds 1000:3000 [--area setup] [--keep DIR] [--shrink]`` runs any seeds: a seed is a deck, an area of
commands is a grammar in ``areas/``.  ``--shrink`` drops the lines that do not matter, ``--keep`` writes what both programs wrote.  What comes
of a deck is one of ``trial.OUTCOMES``; where the programs part on purpose is in ``reasons.py`` and in ``docs/decks/differences.md``, and grammars keep
away from it where they can.  A deck takes a tenth of a second or less.  With ``--resume`` no LAMMPS is asked: each deck is interrupted at
random moments, resumed, and all its files are compared with those of a run in one piece.

What it finds is proven on a version with faults that were known (commit 6bc482e), which it was not written for deck by deck:

================================================================================  ==========================================
matter                                                                            area and seeds that show it
================================================================================  ==========================================
two thermostats of different temperature, one of them transverse                  thermostats 25, 29
pairs missed in tilted boxes with long cutoffs on the Reference platform          pairs 5, 158, 620; meso 207
energy of coincident beads                                                        pairs 175, 227, 315
beads on faces of regions in units real and metal                                 setup 524
EDGE of regions in tilted boxes                                                   setup 157, 402
built-in thermo computes after thermo_modify temp                                 averages 265, 4310
ids after delete_atoms                                                            setup 85, 88
numbers of beads of type/ratio and ratio                                          setup 41, 91, 115
group subtract on a group that exists                                             setup 64, 86
vdisplace, swiggle, cwiggle with run ... start                                    runs 108, 148
sign(0), round of negative halves                                                 formulas 11, 27, 47
set x, y, z beyond the box                                                        setup 8, 22, 102
energy of beads under fix addforce                                                runs 8, 114, 136
rows of fix ave/time ... start                                                    averages 34, 124
titles of cella, cellb, cellc                                                     pairs 2, 6, 13
single beads without degrees of freedom                                           setup 133; averages 150
numbers such as 2_5 or with other digits than 0 to 9                              mistakes 17, 41, 71
fmax and fnorm with beads that nothing moves                                      flow 45
================================================================================  ==========================================
"""
