"""What all tests share: no display, one thread, the same random inputs every time."""

import os

import hypothesis

for name, value in {
    "MPLBACKEND": "Agg",
    "OMP_NUM_THREADS": "1",  # small matrices: more threads only wait for each other
    "PYVISTA_OFF_SCREEN": "true",
}.items():
    os.environ.setdefault(name, value)

hypothesis.settings.register_profile("fixed", derandomize=True, deadline=None)
hypothesis.settings.load_profile("fixed")
