"""docs/user/datasets.md has a row for each dataset of result files, with its type, shape and unit, and no other rows."""

import re
from pathlib import Path

import h5py
import pytest

from program import run

PAGES = Path(__file__).resolve().parents[2] / "docs" / "user"
TYPES = {"int32": "int32", "float64": "float64", "|S1": "char", "object": "string"}
MODEL = """
&structure type = 'matrices', n_dofs = 1, mass = 1.0, damping = 0.1, stiffness = 1.0 /
&law type = 'elastic_stop', dof = 'x1', stiffness = 0.5, gap = 0.1 /
"""
ONE_TONE = MODEL + "&load dof = 'x1', tuple = 1, cos = 0.1 /\n&tones frequency = 2.0 /\n"
TWO_TONES = MODEL + "&load dof = 'x1', tuple = 1, 0, cos = 0.1 /\n&tones frequency = 2.0, 2.6 /\n&harmonics order = 2 /\n"
INPUTS = {
    "given": TWO_TONES
    + "&output samples = 16, 16 /\n&error_estimate improvement_steps = 1 /\n"
    + "&sweep parameter = 'law(1)%gap', values = 0.1, 0.2 /\n",
    "curve": ONE_TONE + "&harmonics order = 3 /\n&curve parameter = 'tones%frequency', from = 2.0, to = 2.1, points = 3 /\n"
    + "&gradient by = 'law(1)%gap' /\n",
    "accuracy": ONE_TONE + "&accuracy tolerance = 1e-3, of = 'x1' /\n&gradient by = 'law(1)%gap', of = 'x1 (1)' /\n"
    + "&noise dof = 'x1', intensity = 1e-6 /\n&stability noise_frequency = 1.0 /\n",
}


def scales() -> str:
    return (PAGES / "schema.md").read_text().split("## Dimension scales\n")[1].split("\n#")[0]


def data() -> str:
    return (PAGES / "datasets.md").read_text()


def rows(text: str) -> dict[str, list[str]]:
    """Cells after the name of each row of the tables of a text; several names may share them."""
    found: dict[str, list[str]] = {}
    for line in text.splitlines():
        cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
        names = re.findall(r"`([^`]+)`", cells[0]) if cells else []
        forms = re.findall(r"\w+ \([^)]*\)", cells[1]) if names else []
        for k, name in enumerate(names):
            if cells[1] == "same":
                forms = [list(found.values())[-1][0]]
            found[name] = [forms[min(k, len(forms) - 1)], *cells[2:]]
    return found


def is_scale(dataset: h5py.Dataset) -> bool:
    return dataset.attrs.get("CLASS") == b"DIMENSION_SCALE"


@pytest.fixture(scope="module")
def datasets(tmp_path_factory):
    """Whether every dataset of several files is a scale, its type and shape, its unit, and the names of its numbers."""
    folder, found = tmp_path_factory.mktemp("schema"), {}
    for name, text in INPUTS.items():
        (folder / f"{name}.nml").write_text(text)
        done = run("solve", f"{name}.nml", cwd=folder)
        assert (folder / f"{name}.h5").exists(), done.stderr
        with h5py.File(folder / f"{name}.h5") as file:
            for key, dataset in file.items():
                if "parameter" in dataset.attrs and key != "law_1_gap":
                    continue
                dims = [key] if is_scale(dataset) else [dim[0].name[1:] for dim in dataset.dims]
                form = f"{TYPES[str(dataset.dtype)]} ({', '.join(dims)})"
                names = str(dataset.attrs.get("flag_meanings", "")).split()
                names = dict(zip(map(int, dataset.attrs.get("flag_values", ())), names))
                found[key] = (is_scale(dataset), form, dataset.attrs["units"], names)
    return found


def test_every_dataset_has_its_row(datasets):
    page = {True: rows(scales()), False: rows(data())}
    problems = []
    for key, (scale, form, units, _) in datasets.items():
        expected, told = page[scale].get(key, ["", ""])[:2]
        expected = expected.replace("tau_m", key).replace("..., ", "")
        if key == "law_1_gap":
            expected, told = expected.replace("string", "float64"), "m"
        if form != expected:
            problems.append(f"{key} is {form}, the page has {expected}")
        if not scale and told and units not in told.split(", ") and not told.startswith("of ") and (told, units) != ("m", "1"):
            problems.append(f"{key} is in {units}, the page has {told}")
    assert not problems, "\n".join(problems)


def test_every_row_has_a_dataset(datasets):
    assert {*rows(scales()), *rows(data())} - set(datasets) == set()


@pytest.mark.parametrize("key", ["curve_kind", "fallback", "integration_verdict", "reason", "stability_method", "stability_reason",
                                 "status"])
def test_names_of_numbers_are_on_the_page(key, datasets):
    meaning = rows(data())[key][2].partition("flag_meanings")[2]
    listed = {int(number): name for number, name in re.findall(r"(?<![\w.])(\d+) ([a-z]\w+)(?=[ ,;:(.]|$)", meaning)}
    names = datasets[key][3]
    assert {number: listed.get(number) for number in names} == names
