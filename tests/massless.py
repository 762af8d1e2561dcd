"""Cases in modes, with contact points that have no mass."""

import delam_fem as df
from delam_fem.api import Case


def massless(modes: int = 12, refine: int = 64, **overrides: object) -> Case:
    """Return the preset "default" in modes; in names of overrides `__` stands for a dot."""
    keys = {
        "model.kind": "modes",
        "model.modes": modes,
        "time.mass": "massless",
        "time.refine": refine,
        "contact.law": "newton",
        "contact.restitution": 0.0,
    }
    return df.preset("default", keys | {k.replace("__", "."): v for k, v in overrides.items()})
