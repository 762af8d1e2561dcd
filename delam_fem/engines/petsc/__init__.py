"""Steps in PETSc, a supervisor asked after each."""
