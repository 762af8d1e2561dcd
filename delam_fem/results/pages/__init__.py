"""Write HTML pages."""
