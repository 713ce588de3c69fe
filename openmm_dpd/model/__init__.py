"""The input as plain immutable data, without OpenMM forces, kernels or programs."""
