"""What moves a structure: its base or a force, and how it follows in time."""
