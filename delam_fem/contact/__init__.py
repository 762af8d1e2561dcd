"""Contact laws: they decide from gaps and gap rates which pairs are hit and which pairs rest."""
