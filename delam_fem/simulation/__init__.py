"""The time loop and what it keeps."""
