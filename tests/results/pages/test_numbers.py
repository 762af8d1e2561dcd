from delam_fem.results.pages import report


def test_numbers_have_the_units_of_the_figures() -> None:
    summary = {
        "engine": "petsc", "tip_min": [-0.02256, 0.0027], "minimum_tip_gap": -2.774e-4,
        "thd": [0.0824, 0.198], "strobe_scatter": None, "impact_energy_gain": 2.5e-6,
        "wall_seconds": 3.0, "unread_keys": [], "warnings": ["elsewhere"], "new_entry": 7,
    }  # fmt: skip
    entries = {name: (value, meaning) for name, value, meaning in report.rows(summary, ["a", "b"])}
    values = {name: value for name, (value, _) in entries.items()}
    assert values == {
        "tip min": "a −22.56, b 2.7\u00a0mm", "minimum tip gap": "−0.2774\u00a0mm",
        "thd": "a 8.24, b 19.8\u00a0%", "strobe scatter": "–",
        "impact energy gain": "0.0025\u00a0mJ", "new entry": "7",
        "engine": "petsc", "wall seconds": "3\u00a0s", "unread keys": "none",
    }  # fmt: skip
    assert list(values)[-3:] == ["engine", "wall seconds", "unread keys"]
    assert "harmonics" in entries["thd"][1] and entries["new entry"][1] == ""


def test_entries_that_are_not_of_the_laminae_have_no_names() -> None:
    (row,) = report.rows({"unread_keys": ["contact.a", "contact.b"]}, ["thick", "thin"])
    assert row[1] == "contact.a, contact.b"
