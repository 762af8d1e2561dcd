"""One dataset, its numbers, pictures and pages."""
