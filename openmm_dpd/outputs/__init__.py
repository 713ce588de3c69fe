"""What is looked at elsewhere: GSD for OVITO and freud, extended XYZ for OVITO and ASE, PDB."""

from .gsd_file import GSDReporter, write_gsd
from .pdb_file import write_pdb
from .xyz_file import XYZReporter, write_xyz

__all__ = ["GSDReporter", "XYZReporter", "write_gsd", "write_pdb", "write_xyz"]
