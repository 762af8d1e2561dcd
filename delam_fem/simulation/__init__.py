"""Run the time loop and record the motion."""
