"""The model file: what is written is read, and what is wrong is named."""

import dataclasses
import re
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
import scipy.sparse as sp

from nhbm import ModelError, Structure, structure
from nhbm.structure import Recovery


def same(a, b):
    for name, matrix in a.matrices().items():
        assert abs(matrix - b.matrices()[name]).max() == 0.0
    assert a.labels == b.labels and a.units == b.units and a.dof_direction == b.dof_direction
    for name in ("node_numbers", "coordinates", "dof_node", "cell_types", "cell_starts", "cell_nodes"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    assert list(a.sets) == list(b.sets) and list(a.loads) == list(b.loads)
    for name in a.sets:
        np.testing.assert_array_equal(a.sets[name], b.sets[name])
    for name in a.loads:
        np.testing.assert_array_equal(a.loads[name], b.loads[name])
    assert (a.unit_system, a.source) == (b.unit_system, b.source)


def test_file_keeps_everything(chain, tmp_path):
    chain.write(tmp_path / "chain.h5")
    same(chain, Structure.read(tmp_path / "chain.h5"))


def with_recovery(chain):
    matrix = np.cos(np.arange(60.0 * 12)).reshape(60, 12)[:, ::-1]  # not contiguous
    return dataclasses.replace(chain, recovery=Recovery(matrix, np.zeros(60, dtype=int), ["z"] * 60))


@pytest.mark.parametrize("largest_image", [0, 10**9])
def test_file_keeps_all_motion_of_a_reduced_model(chain, tmp_path, monkeypatch, largest_image):
    monkeypatch.setattr(structure, "LARGEST_IMAGE", largest_image)
    monkeypatch.setattr(structure, "ROWS", 7)
    model = with_recovery(chain)
    for _ in range(2):  # a file that is there is replaced
        model.write(tmp_path / "small.h5")
        read = Structure.read(tmp_path / "small.h5")
        same(model, read)
        np.testing.assert_array_equal(read.recovery.matrix, model.recovery.matrix)


def test_large_file_on_a_full_disk(chain, tmp_path, monkeypatch):
    monkeypatch.setattr(structure, "LARGEST_IMAGE", 0)
    monkeypatch.setattr(structure.shutil, "disk_usage", lambda path: SimpleNamespace(free=100))
    with pytest.raises(ModelError, match="cannot be written: No space left on device"):
        with_recovery(chain).write(tmp_path / "small.h5")
    assert not list(tmp_path.iterdir())


def test_names_of_sets(chain):
    assert chain.dofs_of("contact.z") == [4, 1]
    assert chain.dofs_of("contact") == [4, 1]
    assert chain.dofs_of("n3.z") == [2]
    with pytest.raises(ModelError, match="node 5 of set 'contact' has no degree of freedom 'x'"):
        chain.dofs_of("contact.x")
    for wrong, like in (("contcat.z", "contact.z"), ("Contact", "contact"), ("n3z", "n3.z")):
        with pytest.raises(ModelError, match=f"no set '{wrong}'; sets: contact; did you mean '{like}'\\?"):
            chain.dofs_of(wrong)


@pytest.mark.parametrize(
    "change, message",
    [
        ({"mass": sp.identity(3)}, "matrix 'mass' is 3 x 3, there are 12 labels"),
        ({"labels": ["a"] * 12}, "degrees of freedom 1 and 2 both have the label 'a'"),
        ({"labels": ["1"] + [f"n{i}" for i in range(11)]}, "label 1 is '1', it must begin with a letter"),
        ({"sets": {"far": np.array([12])}}, "set 'far' names a node that there is not"),
        ({"sets": {"twin": np.array([1, 1])}}, "set 'twin' names a node twice"),
        ({"loads": {"odd": (np.array([1]), np.array([1.0, 2.0]))}}, "load 'odd' has 1 degrees of freedom and 2 values"),
        ({"units": ["m"]}, "there are 1 units for 12 degrees of freedom"),
    ],
)
def test_bad_parts_are_named(chain, change, message):
    with pytest.raises(ModelError, match=message):
        dataclasses.replace(chain, **change)


def test_entry_that_is_no_number_is_named(chain):
    stiffness = chain.stiffness.copy()
    stiffness[3, 4] = np.nan
    with pytest.raises(ModelError, match="'stiffness': the entry between n4.z and n5.z is not a finite number"):
        dataclasses.replace(chain, stiffness=stiffness)


@pytest.mark.parametrize(
    "damage, message",
    [
        (lambda f: f.attrs.__delitem__("format"), "is not a model file"),
        (lambda f: f.attrs.__setitem__("schema_version", 7), "has schema version 7"),
        (lambda f: f.__delitem__("mass"), "has no matrix 'mass'"),
        (lambda f: f.__delitem__("mass/indices"), "has no 'mass/indices'"),
        (lambda f: f["stiffness/indices"].__setitem__(3, 99), "matrix 'stiffness'"),
        (lambda f: f.__delitem__("units"), "has no 'units'"),
    ],
)
def test_damaged_files_are_refused(chain, tmp_path, damage, message):
    path = tmp_path / "chain.h5"
    chain.write(path)
    with h5py.File(path, "r+") as file:
        damage(file)
    with pytest.raises(ModelError, match=message):
        Structure.read(path)


@pytest.mark.parametrize("mark", [b"TREE", b"SNOD", b"HEAP"])
def test_parts_of_hdf5_that_are_damaged(chain, tmp_path, mark):
    path = tmp_path / "chain.h5"
    chain.write(path)
    path.write_bytes(path.read_bytes().replace(mark, b"XXXX"))
    with pytest.raises(ModelError, match=re.escape(f"file '{path}'")) as raised:
        Structure.read(path)
    assert "\n" not in str(raised.value)


def test_labels_that_are_a_group(chain, tmp_path):
    path = tmp_path / "chain.h5"
    chain.write(path)
    with h5py.File(path, "r+") as file:
        del file["labels"]
        file.create_group("labels")
    with pytest.raises(ModelError, match=re.escape(f"file '{path}' is damaged: ")):
        Structure.read(path)


def test_file_that_is_cut_off(chain, tmp_path):
    path = tmp_path / "chain.h5"
    chain.write(path)
    path.write_bytes(path.read_bytes()[:3000])
    with pytest.raises(ModelError, match="cannot be read as HDF5"):
        Structure.read(path)
