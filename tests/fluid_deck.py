"""Small decks, for tests of what surrounds a run."""

FLUID = """# a small two-type fluid
units lj
atom_style atomic
comm_modify vel yes
region box block 0 4 0 4 0 4 units box
create_box 2 box
create_atoms 1 random 100 4243 box
create_atoms 2 random 92 4244 box
mass 1 1.0
mass 2 2.0
pair_style dpd 1.0 1.0 34387
pair_coeff 1 1 25.0 4.5
pair_coeff 1 2 30.0 4.5
pair_coeff 2 2 25.0 4.5
velocity all create 1.0 87287
fix move all nve
timestep 0.01
thermo 10
variable twice equal 2*temp
thermo_style custom step temp press pe v_twice c_thermo_temp
run 50
run 30
"""

#: One type, and the run still to come.
ONE_TYPE = """units lj
atom_style atomic
comm_modify vel yes
region box block 0 4 0 4 0 4 units box
create_box 1 box
create_atoms 1 random 192 4243 box
mass 1 1.0
pair_style dpd 1.0 1.0 34387
pair_coeff 1 1 25.0 4.5
velocity all create 1.0 87287
fix move all nve
"""

#: Ions among other beads, in a region named box; the first of them is to be bonded to the 16th, the second to the 17th.
IONS = """create_box 2 box bond/types 1 extra/bond/per/atom 2 extra/special/per/atom 6
create_atoms 1 random 60 71 NULL overlap 0.05 maxtry 50
mass * 1.0
set atom 1*30 type 2
set atom 1*15 charge 1.0
set atom 16*30 charge -1.0
set atom 1 x 1.0 y 1.0 z 1.0
set atom 16 x 1.4 y 1.0 z 1.2
set atom 2 x 7.9 y 5.0 z 4.0
dielectric 0.5
kspace_style ewald 1.0e-8
bond_style zero nocoeff
"""
