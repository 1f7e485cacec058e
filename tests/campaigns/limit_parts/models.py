"""Models that keep the program busy, each in another loop."""

from __future__ import annotations

import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]

NO_BALANCE = "&solver max_iterations=0 homotopy_iterations=0 max_fallback_work=1e6 /\n"
TWO_TONES = "&tones frequency=1.3, 1.9003 /\n&load dof='x1', tuple=1,0, cos=0.5 /\n&load dof='x1', tuple=0,1, cos=0.5 /\n"
STOP = "&law type='elastic_stop', dof='x1', stiffness=100.0, gap=0.2 /\n"


def oscillator(damping: float = 0.02, n_masses: int = 1) -> str:
    return (
        f"&structure type='chain', n_masses={n_masses}, ends='fixed', mass=1.0, coupling_stiffness=0.5, damping_mass={damping} /\n"
    )


MODELS = {
    "solver, 3 tones": oscillator()
    + "&tones frequency=1.0, 1.41, 1.73 /\n&harmonics order=7 /\n&load dof='x1', tuple=1,0,0, cos=1 /\n"
    "&load dof='x1', tuple=0,1,0, cos=1 /\n&load dof='x1', tuple=0,0,1, cos=1 /\n" + STOP,
    "adaptive, 2 tones": oscillator(n_masses=2) + TWO_TONES + STOP + "&accuracy tolerance=1e-6 max_work=1e6 /\n",
    "error_estimate": oscillator(n_masses=4) + TWO_TONES + STOP + "&harmonics order=15 /\n&error_estimate improvement_steps=50 /\n",
    "time integration, cvode": oscillator(1e-4) + TWO_TONES + "&harmonics order=3 /\n" + STOP + NO_BALANCE,
    "time integration, steps": oscillator(1e-4, 40)
    + TWO_TONES
    + "&harmonics order=3 /\n&integration method='generalized_alpha' /\n"
    + STOP
    + NO_BALANCE,
    "time integration to 1e-20": oscillator(0.1) + TWO_TONES + STOP + "&accuracy tolerance=1e-20 /\n" + NO_BALANCE,
    "starts": oscillator(1e-3)
    + "&tones frequency=1.3 /\n&load dof='x1', tuple=1, cos=0.5 /\n&integration starts=100 /\n"
    + STOP
    + NO_BALANCE,
    "recoverable law": "&structure type='chain', n_masses=1, ends='free', mass=1.0, coupling_stiffness=0.0, ground_stiffness=1.0, "
    "damping_mass=0.02 /\n&tones frequency=0.6 /\n&load dof='x1', tuple=1, cos=0.008 /\n"
    "&law type='user', library='./electro.so', name='electro', dof='x1', parameters=0.3, 1.0 /\n",
    "recoverable law, curve": "&structure type='chain', n_masses=1, ends='free', mass=1.0, coupling_stiffness=0.0, "
    "ground_stiffness=1.0, damping_mass=0.02 /\n&tones frequency=0.6 /\n&load dof='x1', tuple=1, cos=0.008 /\n"
    "&law type='user', library='./electro.so', name='electro', dof='x1', parameters=0.3, 1.0 /\n"
    "&curve parameter='tones%frequency', from=0.6, to=1.2, peak_of='x1 (1)' /\n",
    "unknown tone": "&structure type='matrices', n_dofs=2, mass=1.0,1.0, stiffness=1.0,4.0, damping=0.02,0.04 /\n"
    "&tones frequency=0.998,0.0, unknown=.false.,.true. /\n&accuracy tolerance=1e-3 /\n&load dof='x1', tuple=1,0, cos=0.02 /\n"
    "&law type='polynomial_coupled', dofs='x1','x2', coefficients=1.0,0.5, acts_on='x1','x2', "
    "displacement_exponents=1,1, 2,0 /\n",
    "unknown tone by integration": "&structure type='matrices', n_dofs=2, mass=1.0,1.0, stiffness=1.0,4.0, damping=-0.002,0.004 /\n"
    "&tones unknown=.true. /\n&harmonics order=25 /\n&solver first_guess='integration' /\n"
    "&law type='polynomial', dof='x1', damping=0.0,0.0,1e-4 /\n",
    "exponents": oscillator(n_masses=12) + TWO_TONES + "&harmonics order=5 /\n&stability method='integration' /\n"
    "&law type='cubic_spring', dof='x1', stiffness=0.5 /\n",
    "exponents of walls": oscillator(0.1, 2) + TWO_TONES + "&harmonics order=5 /\n&stability method='integration' /\n"
    "&law type='jenkins_2d', dof='x1', second_dofs='x2', stiffness=1.0, limit=0.2 /\n",
    "sliders": oscillator(n_masses=3) + TWO_TONES + "&harmonics order=15 /\n"
    "&law type='jenkins', dof='x1', stiffness=5.0, limit=0.1 /\n&law type='jenkins', dof='x2', stiffness=5.0, limit=0.1 /\n",
    "sliders in a plane": "&structure type='matrices', n_dofs=2, mass=1.73646588456, 1.60713871564, "
    "damping=0.0373382123727, 0.000995290776734, 0.000995290776734, 0.0277005059864, "
    "stiffness=1.91282242288, 0.120743833625, 0.120743833625, 0.938519849265 /\n"
    "&tones frequency=1.08566030714, 1.35960020488 /\n&accuracy tolerance=1e-2 /\n"
    "&load dof='x1', tuple=1,0, cos=0.742785312186, sin=-0.264302495068 /\n"
    "&load dof='x2', tuple=0,1, cos=-0.29806674424, sin=0.0429676824647 /\n"
    "&law type='jenkins_2d', dof='x1', second_dofs='x2', stiffness=9.53755198532, limit=0.882585812616 /\n",
    "normal mode": oscillator(0.0, 2) + "&tones unknown=.true. /\n&harmonics order=60 /\n"
    "&normal_mode dof='x1', amplitude=3.0 /\n" + STOP.replace("gap=0.2", "gap=0.2, two_sided=.true."),
    "curve": oscillator(1e-3, 20) + "&tones frequency=0.05 /\n&harmonics order=15 /\n&load dof='x10', tuple=1, cos=0.02 /\n"
    "&law type='elastic_stop', dof='x20', gap=0.1, stiffness=50.0 /\n"
    "&curve parameter='tones%frequency', from=0.05, to=2.2, points=4000, peak_of='x20 (1)' /\n",
    "chain of points": oscillator(n_masses=2) + TWO_TONES.replace("1.3,", "1.3,") + STOP
    + "&sweep parameter='law(1)%gap', from=0.2, to=0.5, n=2000 /\n&harmonics order=5 /\n",
}


def build_laws(folder: Path) -> None:
    """A law that returns `recoverable` at all displacements beyond a limit."""
    source = folder / "electro.c"
    source.write_text(
        """#include "nhbm_user_law.h"
int electro_info(nhbm_law_info_t *info)
{
   info->api_version = NHBM_USER_LAW_API;
   info->n_coordinates = 1;
   info->n_parameters = 2;
   info->length_scale = 0.3;
   return 0;
}
int electro_evaluate(int n, int nc, int stride, const double *z, const double *v, int np, const double *p, double *f, double *df,
                     double *dv)
{
   (void)nc, (void)stride, (void)v, (void)np, (void)dv;
   for (int i = 0; i < n; i++) {
      double d = p[1] - z[i];
      if (d <= 0.0) return 1;
      f[i] = -p[0] / (d * d);
      if (df) df[i] = -2.0 * p[0] / (d * d * d);
   }
   return 0;
}
"""
    )
    library = folder / "electro.so"
    words = ["cc", "-O2", "-shared", "-fPIC", "-I", str(ROOT / "src/laws"), "-o", str(library), str(source)]
    subprocess.run(words, check=True)
