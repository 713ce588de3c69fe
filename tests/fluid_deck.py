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
