"""Recipe of nhbm for Spack 1.0 or later, not run yet by anybody:

spack repo add packages/spack/spack_repo/nhbm && spack develop --path $PWD nhbm@=0.1.0 && spack install nhbm@=0.1.0
"""

from spack.package import depends_on, license, variant, version
from spack_repo.builtin.build_systems.cmake import CMakePackage


class Nhbm(CMakePackage):
    """Steady vibration of structures with contact and friction under several tones, by n-dimensional harmonic balance."""

    license("GPL-3.0-or-later")

    version("0.1.0")

    variant("cvode", default=True, description="Integrate through time with variable steps")

    depends_on("c", type="build")
    depends_on("fortran", type="build")
    depends_on("cmake@3.25:", type="build")
    depends_on("pkgconfig", type="build")
    depends_on("mpi")
    depends_on("hdf5+mpi+fortran+hl")
    depends_on("fftw@3")
    depends_on("lapack")
    depends_on("suite-sparse")
    depends_on("sundials@6:7", when="+cvode")
    for package in ("python@3.9:", "py-h5netcdf", "py-h5py", "py-matplotlib", "py-numpy", "py-scipy", "py-xarray"):
        depends_on(package, type="run")

    def cmake_args(self):
        return [self.define("HB_BUILD_TESTS", False), self.define_from_variant("HB_CVODE", "cvode")]
