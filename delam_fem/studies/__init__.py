"""Studies of cases: sweeps, refinement, orbits, branches, detection, identification, modes."""
