"""Mutants of src/stability."""

from mutant_parts.mutant import of

MUTANTS = [
    *of(
        "stability/hb_variation.f90",
        (
            "variation_least_work",
            "test_hb_monodromy",
            "what any transfer takes at least is above what some take",
            "work = per_multiplication(huge(1))*(2.0_wp*n_dofs)**3",
            "work = 1.0e5_wp*(2.0_wp*n_dofs)**3",
        ),
    ),
    *of(
        "stability/hb_variation_pieces.f90",
        (
            "events_end",
            "test_hb_monodromy",
            "false position keeps the wrong end",
            "if (value > 0.0_wp .eqv. self%value_low > 0.0_wp) then",
            "if (value > 0.0_wp .neqv. self%value_low > 0.0_wp) then",
        ),
    ),
    *of(
        "solve/hb_solver_types.f90",
        (
            "work_in_nanoseconds",
            "test_hb_stability",
            "a unit of work is thought to be a nanosecond",
            "nanoseconds_of_work = 0.1_wp",
            "nanoseconds_of_work = 10.0_wp",
        ),
    ),
    *of(
        "stability/hb_bifurcation.f90",
        (
            "bifurcation_doubling",
            "test_curve_bifurcations",
            "the period is thought to double where a multiplier is 1",
            "factor = factor*(1.0_wp + m)/max(1.0_wp, abs(m))",
            "factor = factor*(1.0_wp - m)/max(1.0_wp, abs(m))",
        ),
        (
            "bifurcation_pair",
            "test_curve_bifurcations",
            "two real multipliers that are each other's inverse are taken for a torus, and a torus for them",
            "is_torus = angle_of_pair(multipliers) > 0.0_wp",
            "is_torus = angle_of_pair(multipliers) <= 0.0_wp",
        ),
    ),
    *of(
        "stability/hb_grazing.f90",
        (
            "grazing_no_refinement",
            "test_hb_grazing",
            "the extreme is that of the grid",
            "      do round = 1, n_rounds",
            "      do round = 1, 0",
        ),
        (
            "grazing_largest_alone",
            "test_hb_grazing",
            "the smallest value is that at the largest",
            "call refine(laws(i), motion, s, phases, values, -1.0_wp, extremes(1, n))",
            "call refine(laws(i), motion, s, phases, values, 1.0_wp, extremes(1, n))",
        ),
    ),
    *of(
        "stability/hb_monodromy.f90",
        (
            "monodromy_no_end",
            "test_hb_monodromy",
            "steps are doubled although that helps no more",
            "if (self%estimate <= good .and.",
            "if (self%estimate < 0.0_wp .and.",
        ),
        (
            "monodromy_no_rounding",
            "test_hb_monodromy",
            "pieces without change are taken to be exact",
            "estimate = estimate + epsilon(1.0_wp)*",
            "estimate = 0.0_wp*",
        ),
    ),
    *of(
        "stability/hb_motion_series.f90",
        (
            "series_signs",
            "test_hb_motion_series",
            "tuples with negative entries turn the wrong way",
            "s = cosine(:, abs(j), m)*s + sign(1, j)*sine(:, abs(j), m)*c",
            "s = cosine(:, abs(j), m)*s + sine(:, abs(j), m)*c",
        ),
    ),
    *of(
        "stability/hb_period_map.f90",
        (
            "period_map_still",
            "test_hb_period_map",
            "places that friction holds for ever stay among the multipliers",
            "if (norm2(matmul(place, matrix) - self%sense*place) > neutral) cycle",
            "if (norm2(matmul(place, matrix) - self%sense*place) > 0.0_wp) cycle",
        ),
        (
            "period_map_half",
            "test_hb_period_map",
            "half a period of an odd motion counts as a whole one",
            "         self%matrix = matmul(self%matrix, self%matrix)",
            "         continue",
        ),
    ),
    *of(
        "stability/hb_state_map.f90",
        (
            "state_map_distance",
            "test_hb_period_map",
            "differences are taken for those of half the distance",
            "changes(:, k) = (above - below)/(2.0_wp*distance)",
            "changes(:, k) = (above - below)/distance",
        ),
        (
            "state_map_restitution",
            "test_hb_marched_laps",
            "blows take all of the speed",
            "self%config%restitution = restitution",
            "self%config%restitution = 0.0_wp",
        ),
    ),
    *of(
        "stability/hb_marched_laps.f90",
        (
            "marched_laps_left",
            "test_hb_marched_laps",
            "a march that leaves the motion tells its exponents",
            "is_done = maxval(abs(after(:n) - there(:n))) <= same_motion",
            "is_done = maxval(abs(after(:n) - there(:n))) < huge(1.0_wp)",
        ),
        (
            "marched_laps_still",
            "test_hb_marched_laps",
            "places that friction holds for ever stay among the disturbances",
            "is_still = .not. rigid%is_wall",
            "is_still = rigid%is_wall",
        ),
        (
            "marched_laps_distance",
            "test_hb_marched_laps",
            "disturbances are so small that rounding is left of them",
            "distance = 1.0e-5_wp",
            "distance = 1.0e-12_wp",
        ),
    ),
    *of(
        "stability/hb_linear_laps.f90",
        (
            "linear_laps_shifts",
            "test_hb_exponents",
            "what shifts a phase of the motion's own is not taken out",
            "      call remove_shifts(self, x)",
            "      continue",
        ),
    ),
    *of(
        "stability/hb_exponents.f90",
        (
            "exponents_hasty",
            "test_hb_exponents",
            "a few laps suffice whatever their spread",
            "clear_early = 10.0_wp",
            "clear_early = 0.0_wp",
        ),
    ),
    *of(
        "stability/hb_floquet.f90",
        (
            "stability_circle",
            "test_hb_stability",
            "multipliers inside of the unit circle are counted as unstable",
            "self%n_unstable = count(abs(multipliers) > 1.0_wp + margin)",
            "self%n_unstable = count(abs(multipliers) < 1.0_wp + margin)",
        ),
        (
            "stability_work_spent",
            "test_hb_stability",
            "stability of a motion that was dear to find may not be dear",
            "work > max(config%patience*work_allowed, config%work_spent)",
            "work > config%patience*work_allowed",
        ),
        (
            "stability_own_phase",
            "test_hb_stability",
            "the shift of the motion's own phase is left among the multipliers",
            "         call deflate(monodromy%matrix, shift)",
            "         continue",
        ),
    ),
    *of(
        "stability/hb_stability.f90",
        (
            "stability_better_motion",
            "test_hb_stability",
            "what a better motion says of the multipliers counts for nothing",
            "if (self%verdict /= better%verdict) self%verdict = verdict%unknown",
            "if (.false.) self%verdict = verdict%unknown",
        ),
        (
            "stability_neighbours",
            "test_hb_stability",
            "pairs may turn until they reach the unit circle, although others are near",
            "room = max(room, minval(abs(m - others)))",
            "room = max(room, 1.0_wp)",
        ),
    ),
    *of(
        "stability/hb_variation_pieces.f90",
        (
            "variation_no_switching",
            "test_hb_monodromy",
            "time is not cut where laws switch",
            "if (self%laws(i)%law%n_switches > 0) then",
            "if (self%laws(i)%law%n_switches < 0) then",
        ),
        (
            "variation_settle",
            "test_hb_monodromy",
            "sliders are not followed round the period before it counts",
            "      do lap = 1, most_laps",
            "      do lap = 1, 0",
        ),
    ),
    *of(
        "stability/hb_variation_steps.f90",
        (
            "variation_weights",
            "test_hb_monodromy",
            "a half step of the integrator has a wrong weight",
            "far = -1.0_wp/12.0_wp",
            "far = 1.0_wp/12.0_wp",
        ),
        (
            "variation_one_look",
            "test_hb_monodromy",
            "slopes of pieces without change are those at their start, where a contact has just opened",
            "[0.5_wp*(piece%start + piece%finish)]",
            "[piece%start]",
        ),
        (
            "variation_sliders",
            "test_hb_monodromy",
            "sliders that slip do not move with their bounds",
            "      if (self%n_states > 0) call move_sliders(self, piece, x)",
            "      if (self%n_states < 0) call move_sliders(self, piece, x)",
        ),
    ),
]
