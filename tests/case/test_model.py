"""The section `model` of a case."""

import pytest

from delam_fem.api import CaseError, load_case, preset, save_case


def test_beams_are_the_default_and_are_not_written() -> None:
    assert preset("default").model.kind == "beam"
    assert "[model]" not in preset("default").to_toml()


def test_what_a_kind_does_not_read_is_named() -> None:
    case = preset("default", {"model.kind": "plane-stress", "model.strips": 2, "model.layers": 2})
    assert case.unread[-1:] == ("model.strips",)
    assert 'kind = "plane-stress"' in case.to_toml()
    assert type(case).from_toml(case.to_toml()) == case


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (
            {"model.kind": "modes"},
            'time.mass: expected "massless" with model.kind = "modes" and no file',
        ),
        ({"model.file": "a.nc"}, "model.file: expected only with kind = \"modes\", given 'beam'"),
        ({"model.poisson": 0.5}, "model.poisson: expected a number of at least 0 and below 0.5"),
        ({"model.degree": 1}, "model.degree: expected 2 or 3, given 1"),
        ({"model.kind": "shell"}, "model.kind: expected 'beam', 'plane-stress'"),
        (
            {"damping.rayleigh": "no"},
            "damping.rayleigh: expected 'two-mode', 'stiffness', 'mass' or",
        ),
    ],
)
def test_bad_models_are_refused(given: dict[str, object], words: str) -> None:
    with pytest.raises(CaseError, match=words.replace("(", "\\(").replace(".", "\\.")):
        preset("default", given)


def test_the_file_goes_with_the_case(tmp_path) -> None:
    (tmp_path / "modes.h5").write_bytes(b"modes")
    overrides = {"model.kind": "modes", "model.file": str(tmp_path / "modes.h5")}
    folder = tmp_path / "copy"
    path = save_case(preset("default", overrides), folder)
    assert (folder / "modes.h5").read_bytes() == b"modes"
    assert load_case(path).model.file == folder / "modes.h5"
