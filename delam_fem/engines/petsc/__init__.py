"""The PETSc engine: it computes single steps and asks a supervisor after each step."""
