"""`python -m delam_fem` is the command `delam-fem`, also under `mpiexec … -m mpi4py.futures -m`."""

from delam_fem.cli.app import app

if __name__ == "__main__":
    app(prog_name="delam-fem")
