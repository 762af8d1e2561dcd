"""The PETSc engine: it computes single steps and asks a supervisor after each step."""

from delam_fem.system.mpi import start_petsc

start_petsc()
