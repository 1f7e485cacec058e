"""tests/campaigns/curves: what it reads from a file alone, of a curve with each kind of event, and where one is missing."""

import shutil

import h5py
import numpy as np
import pytest
from curve_parts import shown

from program import read, solve

STOP = """
&structure type='chain', n_masses=1, ends='free', mass=1.0, coupling_stiffness=0.0, ground_stiffness=1.0, damping_mass=0.05 /
&tones frequency=0.7 /
&harmonics order=9 /
&load dof='x1', tuple=1, cos=0.1 /
&law type='elastic_stop', dof='x1', stiffness=2.0, gap=1.0 /
&curve parameter='tones%frequency', from=0.7, to=1.6, peak_of='x1 (1)', amplitude_of='x1 (1)', amplitudes=0.5, values=0.85 /
"""


@pytest.fixture(scope="module")
def curve(tmp_path_factory):
    return solve(STOP, tmp_path_factory.mktemp("shown"))


def events_of(path):
    with h5py.File(path) as file:
        return [event for curve in shown.curves_of(file) for event in shown.events_of(curve)]


def test_all_events_of_a_curve_are_shown_and_located(curve):
    kind, is_stable = read(curve, "curve_kind", "is_stable")
    events = events_of(curve)
    assert {event.report for event in events} == {"located"}
    for number, name in ((shown.FOLD, "fold"), (shown.PEAK, "peak"), (shown.AMPLITUDE, "amplitude"), (shown.GRAZING, "graze"),
                         (shown.VALUE, "value")):
        assert sum(event.kind.startswith(name) for event in events) == np.count_nonzero(kind == number) > 0
    assert (is_stable == -1).any() and any(event.kind == "bifurcation" for event in events)


@pytest.mark.parametrize(("number", "name"), [(shown.FOLD, "fold"), (shown.PEAK, "peak"), (shown.AMPLITUDE, "amplitude"),
                                              (shown.GRAZING, "graze"), (shown.VALUE, "value")])
def test_an_event_that_is_not_in_the_table_is_silent(curve, tmp_path, number, name):
    """A row that the file calls a step is as good as none; so is the only row between two signs."""
    path = shutil.copy(curve, tmp_path / "without.h5")
    with h5py.File(path, "r+") as file:
        kind = file["curve_kind"][...]
        row = int(np.flatnonzero(kind == number)[0])
        kind[row] = shown.REGULAR
        file["curve_kind"][...] = kind
    silent = [event for event in events_of(path) if event.report == "silent"]
    assert [event.kind.split()[0] for event in silent] == [name]
    assert abs(silent[0].row - row) <= 1


def test_an_event_that_the_next_row_names_is_not_silent(curve, tmp_path):
    path = shutil.copy(curve, tmp_path / "named.h5")
    with h5py.File(path, "r+") as file:
        kind, reason = file["curve_kind"][...], file["reason"][...]
        row = int(np.flatnonzero(kind == shown.GRAZING)[0])
        kind[row], reason[row + 1] = shown.REGULAR, shown.UNLOCATED
        file["curve_kind"][...], file["reason"][...] = kind, reason
    assert [event.report for event in events_of(path) if event.report != "located"] == ["named"]


def test_a_curve_that_ends_at_its_start_is_silent(curve, tmp_path):
    path = shutil.copy(curve, tmp_path / "ended.h5")
    with h5py.File(path, "r+") as file:
        kind, status = file["curve_kind"][...], file["status"][...]
        kind[1], status[2:] = shown.END, shown.UNUSED
        file["curve_kind"][...], file["status"][...] = kind, status
        unknowns, n = file["curve_unknowns"][...], file["curve_n_unknowns"][...]
        unknowns[1, n[1] - 1] = unknowns[0, n[0] - 1]
        file["curve_unknowns"][...] = unknowns
    assert [(event.kind, event.report) for event in events_of(path)] == [("end at the start", "silent")]


WAVY = """
&structure type='chain', n_masses=2, mass=1.275574191557656,1.0463513670474132, damping_stiffness=0.023296353147526507,
   coupling_stiffness=1.0357073605386111,0.6209355768197516,2.228916221295792 /
&tones frequency=0.6822525978238109 /
&accuracy tolerance=0.001 /
&law type='annular_clearance', dofs='x1','x2', stiffness=4.752115343185023, clearance=0.16524023402553834 /
&load dof='x2', tuple=1, cos=-0.9185559552815095, sin=-0.36869551236231624 /
&curve parameter='tones%frequency', from=0.423082676557475, to=2.432725390205481, points=290, peak_of='x2 (1)' /
"""


@pytest.mark.long
def test_a_fold_behind_one_that_is_removed_is_not_silent(tmp_path):
    """Three folds on one step: the first is smaller than the errors, and the curve turns back at the third."""
    assert "silent" not in {event.report for event in events_of(solve(WAVY, tmp_path))}
