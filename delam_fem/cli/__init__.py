"""Define the command `delam-fem`."""

from delam_fem.system.imports import ignore_working_folder

ignore_working_folder()  # before anything imports Numba or matplotlib
