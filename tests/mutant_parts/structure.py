"""Mutants of src/structure."""

from mutant_parts.mutant import of

MUTANTS = [
    *of(
        "structure/hb_amplitudes.f90",
        (
            "amplitudes_order",
            "test_hb_amplitudes",
            "a harmonic that comes later stands behind those that it is before",
            "k = count(self%harmonics < h) + 1",
            "k = size(self%harmonics) + 1",
        ),
        (
            "amplitudes_at",
            "test_hb_amplitudes",
            "loads of the first tuples stand for those of the unknown ones",
            "numbers(places) = [(i, i=1, size(places))]",
            "numbers(:size(places)) = [(i, i=1, size(places))]",
        ),
        (
            "amplitudes_replaced",
            "test_hb_amplitudes",
            "loads that went are kept",
            "numbers(places) = 0",
            "",
        ),
    ),
    *of(
        "structure/hb_dynamic_stiffness.f90",
        (
            "stiffness_load_slope",
            "test_hb_dynamic_stiffness",
            "loads that grow with the frequency have no slope",
            "if (.not. by_drive) k = findloc(parts%load_slopes%harmonics, h, dim=1)",
            "if (by_drive) k = findloc(parts%load_slopes%harmonics, h, dim=1)",
        ),
        (
            "stiffness_slope_of_rest",
            "test_hb_dynamic_stiffness",
            "slopes of the interior are those of the coordinates' block",
            "call find_slope(parts%rr)",
            "call find_slope(parts%rl)",
        ),
    ),
    *of(
        "structure/hb_narrow_band.f90",
        (
            "narrow_band_exchange",
            "test_hb_narrow_band",
            "rows that were exchanged are taken to reach no further",
            "last = max(last, min(n, k + n_upper + p))",
            "last = max(last, min(n, k + n_upper))",
        ),
        (
            "narrow_band_sides",
            "test_hb_narrow_band",
            "right-hand sides are not exchanged",
            "b(pivots(k), j) = b(k, j)",
            "continue",
        ),
    ),
    *of(
        "structure/hb_arrow_factors.f90",
        (
            "arrow_adjoint",
            "test_hb_arrow_factors",
            "the Schur complement of the adjoint is that of the matrix",
            "call zgetrs(form, b, k, self%a, b, self%pivots, y, b, info)",
            'call zgetrs("N", b, k, self%a, b, self%pivots, y, b, info)',
        ),
        (
            "arrow_pivot",
            "test_hb_arrow_factors",
            "a diagonal that vanishes is divided by",
            "is_done = all(abs(self%d) > smallest)",
            "is_done = all(abs(self%d) > 0.0_wp)",
        ),
    ),
    *of(
        "structure/hb_coordinates.f90",
        (
            "coordinates_pivots",
            "test_hb_coordinates",
            "the stiffest degrees of freedom make room",
            "call find_pivots(shape, sqrt(softness(structure, dofs)), column_at)",
            "call find_pivots(shape, 1.0_wp/softness(structure, dofs), column_at)",
        ),
        (
            "coordinates_forces",
            "test_hb_coordinates",
            "loads on pivots are lost for the interior",
            "turned(r, :) = forces(r, :) + matmul(transpose(self%of_others), forces(p, :))",
            "turned(r, :) = forces(r, :)",
        ),
        (
            "coordinates_recovery",
            "test_hb_coordinates test_hb_scene_coordinates",
            "the motion of pivots forgets that of the interior",
            "y(p, :) = matmul(self%of_z, y(p, :)) + matmul(self%of_others, y(r, :))",
            "y(p, :) = matmul(self%of_z, y(p, :))",
        ),
    ),
    *of(
        "structure/hb_mean_energy.f90",
        (
            "energy_of_mean",
            "test_hb_mean_energy",
            "a constant part counts as a harmonic",
            "if (abs(frequencies(h)) <= 0.0_wp) strain = 2.0_wp*strain",
            "if (abs(frequencies(h)) < 0.0_wp) strain = 2.0_wp*strain",
        ),
        (
            "energy_loss",
            "test_hb_mean_energy",
            "the loss factor is twice as large",
            "factor = loss/(2.0_wp*self%turning)",
            "factor = loss/self%turning",
        ),
    ),
    *of(
        "structure/hb_modes.f90",
        (
            "modes_growth",
            "test_hb_modes",
            "growth rates are in units of their own",
            "self%growth = rate*alpha_r(found)/beta(found)",
            "self%growth = alpha_r(found)/beta(found)",
        ),
        (
            "modes_order",
            "test_hb_modes",
            "modes are not sorted",
            "if (self%frequency(k - 1) <= self%frequency(k)) exit",
            "if (self%frequency(k - 1) <= huge(1.0_wp)) exit",
        ),
    ),
]
