"""What the package asks of the machine: files, caches, kernels, MPI, guarded imports."""
