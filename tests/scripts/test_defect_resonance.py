"""The script of the local defect resonance, in a short form."""

import defect_resonance
import pytest


@pytest.mark.slow
def test_the_elastic_edge_lowers_the_defect_resonance() -> None:
    """As if the patch reached 0.5 to 0.8 h further: thin layers on thicker ones give way so."""
    rows = defect_resonance.main(["--cells", "8", "--depths", "20"])
    assert [row[0] for row in rows] == ["ellipse", "rectangle"]
    for *_, share, k in rows:
        assert share < 0.92
        assert 0.5 < k < 0.8
