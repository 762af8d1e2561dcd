"""Studies as plugins: what one is, what it finds, and how it is found."""
