#!/usr/bin/env python3
"""Writes random_contact_beam.nml and random_contact_mass.nml beside itself: 200 random two-tone contact problems each.

    python3 inputs/hard/random_contact.py

The seed is fixed, so that the files are the same each time: stops of 1 to 1e6 times the stiffness of the structure, half of the
problems with a second stop on the other side, gaps from pressed on to out of reach, tones over two decades or one.
"""

from pathlib import Path

import numpy as np

N = 200
SEED = 20061

BEAM = """\
! 200 random problems of contact, the paper's beam: loads of 100 N, stops of 84e3 to 84e9 N/m, half of them on both sides, gaps of
! -0.5 to 2.4 mm (the linear motion has 2.4 mm), tones of 0.5 to 50 rad/s (the first mode has 148 rad/s).
! Written by random_contact.py.
!
! Hard, because Newton's method cycles among the pieces of a piecewise linear system, because one sample that touches changes the
! tangent by up to a million times the beam, and because order 5 is far too low where stiff stops make the motion bounce. Whether the
! equations of the points that do not converge have a solution at all is not known. docs/why/hard.md lists them. Four of the drawn
! pairs of tones are nearly commensurate, which `nhbm check` tells.
!
! label: long
! expect: solved > 165
!
&structure
   type = 'beam'
   length = 1.0                 ! [m]
   bending_stiffness = 1750.0   ! [N m2]
   mass_per_length = 7.8        ! [kg/m]
   n_elements = 4
   damping_diagonal = 1.0       ! [N s/m]
/
&tones frequency = 1.0, 1.6 /
&harmonics order = 5 /
&load dof = 'v3', tuple = 1, 0, cos = 100.0 /
&load dof = 'v3', tuple = 0, 1, cos = 100.0 /
&law type = 'elastic_stop', dof = 'v3', stiffness = 1.0, gap = 1.0 /
&law type = 'elastic_stop', dofs = 'v3', weights = -1.0, stiffness = 1.0, gap = 1.0 /
&output title = 'Random contact problems of a beam' /
"""

MASS = """\
! 200 random problems of contact, one mass of 1 kg on 1 N/m with a damping ratio of 0.1: loads of 0.4 N, stops of 1 to 1e6 N/m, half
! of them on both sides, gaps of -0.3 to 1 m, tones of 0.3 to 9 rad/s round the resonance.
! Written by random_contact.py.
!
! Hard, because the motion is that of an impact oscillator near its resonance. About every fourth of these problems has no single
! two-tone motion: integrated from three initial states the motions are still apart after 360 s (docs/why/hard.md, with the list of
! the points that do not converge). Three of the drawn pairs of tones are nearly commensurate, which `nhbm check` tells.
!
! label: long
! expect: solved > 95
!
&structure type = 'matrices', n_dofs = 1, mass = 1.0, damping = 0.2, stiffness = 1.0 /
&tones frequency = 1.0, 1.6 /
&harmonics order = 5 /
&load dof = 'x1', tuple = 1, 0, cos = 0.4 /
&load dof = 'x1', tuple = 0, 1, cos = 0.4 /
&law type = 'elastic_stop', dof = 'x1', stiffness = 1.0, gap = 1.0 /
&law type = 'elastic_stop', dofs = 'x1', weights = -1.0, stiffness = 1.0, gap = 1.0 /
&output title = 'Random contact problems of one mass' /
"""


def sweep(parameter: str, values) -> str:
    rows = (", ".join(f"{value:.6g}" for value in values[i : i + 10]) for i in range(0, N, 10))
    return f"&sweep parameter = '{parameter}', axis = 1, values =\n   " + ",\n   ".join(rows) + " /\n"


def problems(head: str, stiffness: float, gaps, slowest: float, fastest: float, ratios) -> str:
    """The input with one zipped sweep: ranges of gaps, of the first tone, of the ratio of both tones."""
    random = np.random.default_rng(SEED)
    first = stiffness * 10 ** random.uniform(0, 6, N)
    has_second = random.random(N) < 0.5
    second = np.where(has_second, stiffness * 10 ** random.uniform(0, 6, N), 0.0)
    gap = random.uniform(*gaps, N)
    tone = 10 ** random.uniform(np.log10(slowest), np.log10(fastest), N)
    return head + "".join(
        (
            sweep("law(1)%stiffness", first),
            sweep("law(2)%stiffness", second),
            sweep("law(1)%gap", gap),
            sweep("law(2)%gap", abs(gap)),
            sweep("tones%frequency(1)", tone),
            sweep("tones%frequency(2)", tone * random.uniform(*ratios, N)),
        )
    )


def main():
    folder = Path(__file__).parent
    beam = problems(BEAM, 84.0e3, (-0.5e-3, 2.4e-3), 0.5, 50.0, (1.05, 2.9))
    mass = problems(MASS, 1.0, (-0.3, 1.0), 0.3, 3.0, (1.1, 2.9))
    (folder / "random_contact_beam.nml").write_text(beam)
    (folder / "random_contact_mass.nml").write_text(mass)


if __name__ == "__main__":
    main()
