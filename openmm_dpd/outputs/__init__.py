"""Files for other programs: GSD for OVITO and freud, extended XYZ for OVITO and ASE, PDB."""

from ..io.snapshot import write_pdb as write_pdb
from .gsd_file import GSDReporter as GSDReporter, write_gsd as write_gsd
from .xyz_file import XYZReporter as XYZReporter, write_xyz as write_xyz
