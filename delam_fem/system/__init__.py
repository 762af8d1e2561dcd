"""What the package asks of the machine: files, compiled code, MPI, guarded imports."""
