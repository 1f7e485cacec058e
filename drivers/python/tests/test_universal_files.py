"""Universal files of test software: what pyuff writes is read, and what is written pyuff reads; into a fit."""

import numpy as np
import pytest

import nhbm
from nhbm import ModelError
from nhbm.command import main
from nhbm.universal_files import functions_of, write_uff

HERTZ = np.linspace(20.0, 60.0, 41)
OMEGA = 2 * np.pi * HERTZ
MASS, STIFFNESS, DAMPING = 2.0, 2.0 * (2 * np.pi * 40) ** 2, 12.0
RECEPTANCE = 1 / (STIFFNESS - MASS * OMEGA**2 + 1j * OMEGA * DAMPING)


def pyuff_file(path, values, kind, binary=0, even=1, units=None, unit="Hz", abscissa=HERTZ, response=(12, 3), reference=(3, -2)):
    pyuff = pytest.importorskip("pyuff", reason="pyuff is not installed (tests/doors)")
    file = pyuff.UFF(str(path))
    sets = []
    if units is not None:
        sets.append({"type": 164, "units_code": 9, "units_description": "own", "temp_mode": 1, "length": units[0],
                     "force": units[1], "temp": 1.0, "temp_offset": 0.0})  # fmt: skip
    sets.append({
        "type": 58, "binary": binary, "func_type": 4, "rsp_node": response[0], "rsp_dir": response[1], "ref_dir": reference[1],
        "ref_node": reference[0], "data": values, "x": abscissa, "id1": "measured", "rsp_ent_name": "NONE", "ref_ent_name": "NONE",
        "abscissa_spacing": even, "abscissa_spec_data_type": 18, "abscissa_axis_units_lab": unit, "ordinate_spec_data_type": kind,
        "orddenom_spec_data_type": 13, "ord_data_type": 6,
    })  # fmt: skip
    file.write_sets(sets, "add")  # "overwrite" loses binary functions (findings)


@pytest.mark.parametrize("binary", [0, 1])
@pytest.mark.parametrize("even", [0, 1])
@pytest.mark.parametrize("kind, order", [(8, 0), (11, 1), (12, 2)])
def test_receptance_mobility_and_accelerance(tmp_path, kind, order, binary, even):
    pyuff_file(tmp_path / "m.uff", RECEPTANCE * (1j * OMEGA) ** order, kind, binary, even)
    found = nhbm.read_uff(tmp_path / "m.uff", force=2.5)
    np.testing.assert_allclose(found["hertz"], HERTZ, rtol=1e-5)
    np.testing.assert_allclose(found["amplitude"], 2.5 * abs(RECEPTANCE), rtol=1e-5)
    np.testing.assert_allclose(found["phase"], np.angle(RECEPTANCE), rtol=1e-5)
    assert functions_of(tmp_path / "m.uff")[0].name == "12:+Z/3:-Y"


def test_units_are_those_of_the_file(tmp_path):
    """Accelerance in mm/s2/kN, over rad/s: factors divide."""
    pyuff_file(tmp_path / "m.uff", RECEPTANCE * -(OMEGA**2) * 1e3 * 1e3, 12, units=(1e3, 1e-3), unit="rad/s", abscissa=OMEGA)
    found = nhbm.read_uff(tmp_path / "m.uff", force=1.0)
    np.testing.assert_allclose(found["frequency"], OMEGA, rtol=1e-5)
    np.testing.assert_allclose(found["amplitude"], abs(RECEPTANCE), rtol=1e-5)


def test_what_is_missing_is_asked_for(tmp_path):
    pyuff_file(tmp_path / "m.uff", RECEPTANCE, 8)
    with pytest.raises(ModelError, match="give the amplitude of the force"):
        nhbm.read_uff(tmp_path / "m.uff")
    pyuff_file(tmp_path / "m.uff", 2 * RECEPTANCE, 8, response=(14, 1))
    with pytest.raises(ModelError, match=r"has 2 functions; give one of function=12:\+Z/3:-Y, 14:\+X/3:-Y"):
        nhbm.read_uff(tmp_path / "m.uff", force=1.0)
    np.testing.assert_allclose(nhbm.read_uff(tmp_path / "m.uff", 1.0, "14:+X/3:-Y")["amplitude"], 2 * abs(RECEPTANCE), rtol=1e-5)
    pyuff_file(tmp_path / "unknown.uff", RECEPTANCE, 0)
    with pytest.raises(ModelError, match="not told what was measured"):
        nhbm.read_uff(tmp_path / "unknown.uff", force=1.0)


def test_what_is_written_is_read(tmp_path):
    write_uff(tmp_path / "m.uff", HERTZ, RECEPTANCE, (12, "+Z"), True, "a curve")
    found = nhbm.read_uff(tmp_path / "m.uff", force=3.0)
    np.testing.assert_allclose(found["amplitude"], 3.0 * abs(RECEPTANCE), rtol=1e-9)
    pyuff = pytest.importorskip("pyuff", reason="pyuff is not installed (tests/doors)")
    theirs = pyuff.UFF(str(tmp_path / "m.uff")).read_sets()
    by_type = {one["type"]: one for one in theirs}
    np.testing.assert_allclose(by_type[58]["data"], RECEPTANCE, rtol=1e-9)
    np.testing.assert_allclose(by_type[58]["x"], HERTZ, rtol=1e-5)
    assert by_type[58]["rsp_node"] == 12 and by_type[58]["rsp_dir"] == 3 and by_type[164]["length"] == 1.0


def test_curve_to_fit(tmp_path, capsys):
    """A response curve goes out and, as a measurement, gives back the stiffness and the damping that made it."""
    model = nhbm.Model(nhbm.Matrices(MASS, STIFFNESS, DAMPING), tones={"hertz": [40.0]})
    model.load("x1", 1, cos=5.0)
    curve = model.curve("tones[0].hertz", 35.0, 45.0, order=1)
    curve.nhbm.to_uff(tmp_path / "curve.uff", "x1", force=5.0)
    model["structure.stiffness[0]"], model["structure.damping[0]"] = 1.03 * STIFFNESS, 1.3 * DAMPING
    (tmp_path / "model.nml").write_text(model.to_namelist())
    words = ["fit", str(tmp_path / "model.nml"), str(tmp_path / "curve.uff"), "--by", "structure%stiffness(1)", "--by",
             "structure%damping(1)", "--of", "x1 (1)", "--order", "1"]  # fmt: skip
    assert main(words) == 2
    assert "give the amplitude of the force" in capsys.readouterr().err
    assert main([*words, "--force", "5.0", "--write", str(tmp_path / "fitted.nml")]) == 0
    fitted = nhbm.Model.from_file(tmp_path / "fitted.nml")
    np.testing.assert_allclose(float(fitted["structure.stiffness[0]"]), STIFFNESS, rtol=1e-4)
    np.testing.assert_allclose(float(fitted["structure.damping[0]"]), DAMPING, rtol=1e-2)


@pytest.mark.parametrize("binary", [False, True])
def test_damaged_files_are_refused(tmp_path, binary):
    path = tmp_path / "m.uff"
    if binary:
        pyuff_file(path, RECEPTANCE, 8, 1)
    else:
        write_uff(path, HERTZ, RECEPTANCE, (12, "+Z"), True, "a curve")
    data = path.read_bytes()
    n = len(data)
    for content in (b"", data[: n // 2], data[n // 5 :], b"hello\n" * 50, data.replace(b"        41", b"        52"),
                    data[: n - 100] + b"\n    -1\n" if binary else data[:-80] + b"\n    -1\n"):  # fmt: skip
        path.write_bytes(content)
        with pytest.raises(ModelError, match="m.uff"):
            nhbm.read_uff(path, force=1.0)
