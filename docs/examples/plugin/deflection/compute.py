"""What the study computes and reports."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse.linalg import factorized

from deflection.study import UnderForce
from delam_fem.api import Case, Finding, FloatArray, Report, RunContext, Table, assemble


@dataclass(frozen=True)
class Deflection(Finding):
    """Deflections of the ends.

    Attributes:
        case: the case.
        ends: deflection of the end of each lamina, shape (n_laminae,) [m].
    """

    case: Case
    ends: FloatArray

    @property
    def report(self) -> Report:
        """The deflections as a table and a JSON file."""
        names = [lamina.name for lamina in self.case.lamina]
        rows = [(name, f"{1e3 * end:.4g}") for name, end in zip(names, self.ends, strict=True)]
        return Report(
            name="deflection",
            numbers={"lamina": names, "end_m": self.ends.tolist()},
            case=self.case,
            tables=[Table("deflection of the end", ("lamina", "[mm]"), rows)],
        )


def compute(case: Case, options: UnderForce, _: RunContext) -> Deflection:
    """Solve K u = F r once for each lamina, where r·u is the deflection of its end."""
    operators = assemble(case, needs_dolfinx=False).operators
    solve = factorized(operators.stiffness.tocsc())
    rows = operators.probes[: len(case.lamina)].toarray()
    ends = [float(row @ solve(options.force * row)) for row in rows]
    return Deflection(case, np.array(ends))
