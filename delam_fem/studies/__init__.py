"""Many runs: sweeps, ladders, modes."""
