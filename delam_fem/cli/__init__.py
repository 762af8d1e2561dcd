"""Define the command `delam-fem`."""

import gc
import os

from delam_fem.system.imports import ONE_THREAD, ignore_working_folder

NEW_OBJECTS = 50_000
"""New objects after which Python looks for garbage. Its own number, 700, costs a short run a fifth
of its time: most objects come from imports, and stay."""

ignore_working_folder()  # before anything imports Numba or matplotlib
gc.set_threshold(NEW_OBJECTS)
os.environ.update(ONE_THREAD | os.environ)  # before anything imports NumPy
