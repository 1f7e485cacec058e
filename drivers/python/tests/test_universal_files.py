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


def text_file(path, *, kind=4, types=(18, 12, 13), units=("Hz", "m/s^2", "N"), values=RECEPTANCE * -(OMEGA**2), factors=None):
    """Dataset 58 with labels of units, as test software writes it, and 164 where there are factors of length and force."""
    lines = []
    if factors:
        numbers = "".join(f"{x:25.16E}" for x in (*factors, 1.0))
        lines = ["    -1", "   164", f"{9:10d}{'own':<20}{2:10d}", numbers, f"{0.0:25.16E}", "    -1"]
    ends = f"{'NONE':<10}{12:10d}{3:4d} {'NONE':<10}{3:10d}{3:4d}"
    lines += ["    -1", "    58", *["NONE"] * 5, f"{kind:5d}{1:10d}{0:5d}{0:10d} {ends}",
              f"{6:10d}{len(values):10d}{0:10d}{0.0:13.5E}{0.0:13.5E}{0.0:13.5E}"]  # fmt: skip
    lines += [f"{number:10d}{0:5d}{0:5d}{0:5d} {'NONE':<20} {unit:<20}" for number, unit in zip((*types, 0), (*units, "NONE"))]
    lines += [f"{hertz:13.5E}{value.real:20.12E}{value.imag:20.12E}" for hertz, value in zip(HERTZ, values)]
    path.write_text("\n".join([*lines, "    -1"]) + "\n", encoding="utf-8")


@pytest.mark.parametrize("unit, factor, factors", [
    ("m/s^2", 1.0, None), ("m/s²", 1.0, None), ("(1/N)*(m/s²)", 1.0, None), ("m/sec**2", 1.0, None), ("NONE", 1.0, None),
    ("mm/s2", 1e3, (1e3, 1.0)), ("in/s^2", 1 / 0.0254, (1 / 0.0254, 1.0)), ("MM/S^2", 1e3, (1e3, 1.0)),
])  # fmt: skip
def test_labels_of_units_agree_with_the_types(tmp_path, unit, factor, factors):
    text_file(tmp_path / "m.uff", units=("Hz", unit, "NONE"), values=RECEPTANCE * -(OMEGA**2) * factor, factors=factors)
    np.testing.assert_allclose(nhbm.read_uff(tmp_path / "m.uff", force=1.0)["amplitude"], abs(RECEPTANCE), rtol=1e-9)


@pytest.mark.parametrize("units, unit, factor, order", [
    (("Hz", "g", "N"), "g/N", 1 / 9.80665, 2), (("Hz", "g/lbf", "NONE"), "g/lbf", 4.4482216152605 / 9.80665, 2),
    (("Hz", "mm/s^2", "N"), "mm/s^2/N", 1e3, 2), (("Hz", "m/s", "N"), "m/s/N", 1.0, 1), (("Hz", "µm", "N"), "um/N", 1e6, 0),
    (("Hz", "m/s^2", "kN"), "m/s^2/kN", 1e3, 2), (("Hz", "dB", "NONE"), "m/s^2/N", 1.0, 2),
    (("Hz", "V", "V"), "g/N", 1 / 9.80665, 2),
])  # fmt: skip
def test_labels_that_disagree_with_the_types_need_a_unit(tmp_path, units, unit, factor, order):
    """Values in g, for instance, beside types and a dataset 164 by which they are in m/s2."""
    text_file(tmp_path / "m.uff", units=units, values=RECEPTANCE * (1j * OMEGA) ** order * factor)
    with pytest.raises(ModelError, match="by its label, and by its types and dataset 164 another unit: give unit="):
        nhbm.read_uff(tmp_path / "m.uff", force=1.0)
    found = nhbm.read_uff(tmp_path / "m.uff", force=1.0, unit=unit)
    np.testing.assert_allclose(found["amplitude"], abs(RECEPTANCE), rtol=1e-9)
    np.testing.assert_allclose(found["phase"], np.angle(RECEPTANCE), atol=1e-9)


def test_what_a_function_is_must_be_told(tmp_path):
    path = tmp_path / "m.uff"
    for change, why in (
        ({"types": (18, 1, 0), "units": ("Hz", "(1/N)*(m/s²)", "NONE")}, "is not told what was measured; its label is '.1/N.*m/s"),
        ({"types": (18, 12, 0), "units": ("Hz", "NONE", "NONE")}, "does not tell what its reference is: give unit="),
        ({"types": (18, 12, 12)}, "its reference is of the type 12, not a force"),
        ({"kind": 9, "types": (18, 12, 0)}, "is a function of the type 9, not a frequency response"),
        ({"kind": 6}, "is a function of the type 6"),
        ({"units": ("RPM", "m/s^2", "N")}, "is over 'RPM', not over Hz or rad/s"),
        ({"units": ("kHz", "m/s^2", "N")}, "is over 'kHz'"),
    ):
        text_file(path, **change)
        with pytest.raises(ModelError, match=why):
            nhbm.read_uff(path, force=1.0)
    text_file(path, types=(18, 1, 0), units=("Hz", "(1/N)*(m/s²)", "NONE"))
    np.testing.assert_allclose(nhbm.read_uff(path, 1.0, unit="m/s^2/N")["amplitude"], abs(RECEPTANCE), rtol=1e-9)
    with pytest.raises(ModelError, match="'furlong' is not the unit of a motion"):
        nhbm.read_uff(path, 1.0, unit="furlong")


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
    with pytest.raises(ModelError, match="load .* has the amplitude 5 N, and force = 0.5 N"):
        curve.nhbm.to_uff(tmp_path / "curve.uff", "x1", force=0.5)
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
