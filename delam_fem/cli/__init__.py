"""Define the command `delam-fem`."""

import os

from delam_fem.system.imports import ONE_THREAD, ignore_working_folder, keep_garbage

ignore_working_folder()  # before anything imports Numba or matplotlib
keep_garbage()
os.environ.update(ONE_THREAD | os.environ)  # before anything imports NumPy
