"""Contact laws: gaps and gap rates in, decisions out."""
