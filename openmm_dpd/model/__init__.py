"""What the user means, as plain immutable data: nothing here knows OpenMM forces, kernels or programs."""
