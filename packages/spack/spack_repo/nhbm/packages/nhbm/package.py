"""Recipe of nhbm for Spack, not run yet by anybody: spack repo add packages/spack && spack develop --path . nhbm@main && spack install nhbm@main."""

from spack.package import CMakePackage, depends_on, license, variant, version


class Nhbm(CMakePackage):
    """Steady vibration of structures with contact and friction under several tones, by n-dimensional harmonic balance."""

    license("GPL-3.0-or-later")

    version("main", branch="main")

    variant("cvode", default=True, description="Integrate through time with variable steps")

    depends_on("c", type="build")
    depends_on("fortran", type="build")
    depends_on("cmake@3.25:", type="build")
    depends_on("pkgconfig", type="build")
    depends_on("mpi")
    depends_on("hdf5+mpi+fortran+hl")
    depends_on("fftw-api@3")
    depends_on("lapack")
    depends_on("suite-sparse")
    depends_on("sundials@6", when="+cvode")

    def cmake_args(self):
        return [self.define("HB_BUILD_TESTS", False), self.define_from_variant("HB_CVODE", "cvode")]
