"""Studies of cases: sweeps, ladders, orbits, branches, detection, identification, modes."""
