"""Contact laws: they read gaps and gap rates and decide which pairs jump."""
