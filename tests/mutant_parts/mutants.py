"""The mutants: one small wrong change each, and the unit suites that must notice it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Mutant:
    """A text that stands once in a file, and what takes its place."""

    name: str
    file: str
    old: str
    new: str
    suites: tuple[str, ...]  # each must fail
    wrong: str  # what the change makes wrong


def of(file: str, *mutants: tuple[str, str, str, str, str]) -> list[Mutant]:
    """Mutants of one file: name, suites, what is wrong, old text, new text."""
    return [Mutant(name, f"src/{file}", old, new, tuple(suites.split()), wrong) for name, suites, wrong, old, new in mutants]


MUTANTS = [
    *of(
        "extern/hb_blas.c",
        (
            "blas_threads",
            "test_hb_blas_threads",
            "BLAS keeps all its threads",
            "   openblas_set_num_threads(1);",
            "   (void)0;",
        ),
        (
            "blas_asked",
            "test_hb_blas_threads",
            "BLAS gets one thread against what the user asks for",
            "if (value != NULL && *value != '\\0') return;",
            "if (value != NULL && *value == '\\1') return;",
        ),
    ),
    *of(
        "extern/hb_checksum.c",
        (
            "checksum_tail",
            "test_hb_checksum",
            "the last bytes of a row do not count",
            "for (; n_bytes > 0; n_bytes--, b++) crc",
            "for (; n_bytes > 7; n_bytes--, b++) crc",
        ),
        (
            "checksum_byte",
            "test_hb_checksum",
            "one byte of eight does not count",
            "table[1][b[6]] ^",
            "table[1][0] ^",
        ),
        (
            "checksum_row",
            "test_hb_checksum",
            "rows go on with the checksum of the first",
            "checksums[first + i] = hb_add_to_checksum(checksums[first + i], buffer",
            "checksums[first + i] = hb_add_to_checksum(checksums[first], buffer",
        ),
    ),
    *of(
        "solve/hb_gmres.f90",
        (
            "gmres_once",
            "test_hb_gmres",
            "vectors are made orthogonal only once",
            "if (h(j + 1) < cancelled*length) then",
            "if (h(j + 1) < 0.0_wp) then",
        ),
        (
            "gmres_stale_residual",
            "test_hb_gmres",
            "a restart goes on with what is left of the last product",
            "call find_residual()                                         ! afresh",
            "norm = before*0.5_wp                                         ! afresh",
        ),
        (
            "gmres_rotation",
            "test_hb_gmres",
            "a rotation has the wrong sign",
            "h(i + 1) = self%cosine(i)*h(i + 1) - self%sine(i)*h(i)",
            "h(i + 1) = self%cosine(i)*h(i + 1) + self%sine(i)*h(i)",
        ),
        (
            "gmres_pace",
            "test_hb_gmres",
            "a slow pace is not told",
            "self%is_slow = log(norm/target) > pace*(slow_from - self%n_products)",
            "self%is_slow = log(norm/target) < pace*(slow_from - self%n_products)",
        ),
    ),
    *of(
        "solve/hb_tangent_krylov.f90",
        (
            "krylov_level",
            "test_hb_gmres",
            "the preconditioner never grows",
            "if (self%is_fresh) self%level = self%level + 1",
            "if (self%is_fresh) self%level = self%level + 0",
        ),
    ),
    *of(
        "solve/hb_krylov.f90",
        (
            "krylov_accuracy",
            "test_solvers",
            "steps never become more accurate",
            "accuracy = min(lowest_accuracy, max(0.9_wp*gain**2, abs(gain - tangent%residual)))",
            "accuracy = max(lowest_accuracy, max(0.9_wp*gain**2, abs(gain - tangent%residual)))",
        ),
    ),
    *of(
        "solve/hb_curve.f90",
        (
            "curve_no_kink",
            "test_hb_curve",
            "kinks are not looked at",
            "if (self%config%kink_step > 0.0_wp .and.",
            "if (self%config%kink_step < 0.0_wp .and.",
        ),
        (
            "curve_kink_sense",
            "test_hb_curve",
            "goes back at a kink",
            "self%direction = -next",
            "self%direction = next",
        ),
        (
            "curve_orientation",
            "test_hb_curve",
            "the sign of the determinant is ignored",
            "if (self%orientation*sign_now < 0.0_wp .and.",
            "if (self%orientation*sign_now < -2.0_wp .and.",
        ),
        (
            "curve_branch_points",
            "test_hb_curve",
            "branch points passed by are not counted",
            "self%n_branch_points = self%n_branch_points + 1",
            "self%n_branch_points = self%n_branch_points + 0",
        ),
        (
            "curve_steps",
            "test_hb_curve",
            "steps do not grow where it is easy",
            "self%config%growth*self%step)",
            "1.0_wp*self%step)",
        ),
        (
            "curve_bisection",
            "test_hb_curve",
            "an event is looked for in the wrong half",
            "if (value*value_low > 0.0_wp) then",
            "if (value*value_low < 0.0_wp) then",
        ),
        (
            "curve_tangent_sense",
            "test_hb_curve",
            "tangents point backwards",
            "tangent(size(tangent)) = 1.0_wp",
            "tangent(size(tangent)) = -1.0_wp",
        ),
    ),
    *of(
        "solve/hb_problem.f90",
        (
            "homotopy_slope",
            "test_hb_curve",
            "the slope along the way of a homotopy lacks a factor",
            "(derivative - r)/apart*growth*exp(",
            "(derivative - r)/apart*exp(",
        ),
        (
            "problem_work",
            "test_hb_solver",
            "factors cost nothing",
            "work = work + report%factorizations*self%tangent_work",
            "work = work + 0*report%factorizations*self%tangent_work",
        ),
        (
            "problem_norm",
            "test_solvers",
            "the residual is not scaled",
            "problem_norm = sqrt(sum((r/self%r_scale)**2))",
            "problem_norm = sqrt(sum(r**2))",
        ),
    ),
    *of(
        "solve/hb_homotopy.f90",
        (
            "homotopy_sense",
            "test_hb_curve",
            "sets out away from the problem asked for",
            "forward(n + 1, 1) = 1.0_wp",
            "forward(n + 1, 1) = -1.0_wp",
        ),
        (
            "homotopy_end",
            "test_hb_curve",
            "leaves the problem deformed",
            "call problem%set_parameters([-kind], [1.0_wp], is_possible)\n      report = curve%report",
            "report = curve%report",
        ),
        (
            "homotopy_budget",
            "test_hb_curve",
            "knows no limit of corrections",
            ">= config%homotopy_iterations)",
            ">= huge(1))",
        ),
    ),
    *of(
        "solve/hb_solver.f90",
        (
            "solver_no_homotopy",
            "test_hb_solver",
            "both homotopies are left out",
            "rescue%nonlinearity, rescue%load, rescue%several_guesses]",
            "rescue%both_other, rescue%both_other, rescue%several_guesses]",
        ),
        (
            "solver_unbounded",
            "test_hb_solver",
            "rescues may take any work",
            "limited%work_limit = 0.5_wp*(all_work - report%work)",
            "limited%work_limit = huge(1.0_wp)",
        ),
    ),
    *of(
        "solve/hb_newton.f90",
        (
            "newton_no_repeat",
            "test_solvers",
            "no tangent is used twice",
            "if (fraction >= 1.0_wp .and. report%residual <= fast*before) call repeat_tangent()",
            "if (fraction >= 2.0_wp .and. report%residual <= fast*before) call repeat_tangent()",
        ),
    ),
    *of(
        "solve/hb_line_search.f90",
        (
            "search_no_halving",
            "test_solvers",
            "steps are not halved",
            "fraction = 0.5_wp*fraction",
            "fraction = 1.0_wp*fraction",
        ),
        (
            "search_runaway",
            "test_solvers",
            "unknowns may run away",
            "runaway = 1.0e8_wp",
            "runaway = 1.0e12_wp",
        ),
    ),
    *of(
        "solve/hb_broyden.f90",
        (
            "broyden_update",
            "test_solvers",
            "updates have the wrong sign",
            "a = (s - a)/denominator",
            "a = (s + a)/denominator",
        ),
        (
            "broyden_fraction",
            "test_solvers",
            "updates take each step for a full one",
            "a = step/problem%x_scale + s/fraction",
            "a = step/problem%x_scale + s*(1.0_wp + 0.0_wp*fraction)",
        ),
    ),
    *of(
        "solve/hb_bordered.f90",
        (
            "bordered_schur",
            "test_hb_bordered",
            "the preconditioner adds what it should take away",
            "- matmul(transpose(self%forms(:n, :)), self%eliminated)",
            "+ matmul(transpose(self%forms(:n, :)), self%eliminated)",
        ),
        (
            "bordered_border",
            "test_hb_bordered",
            "products leave the parameters out",
            "product(:n) = product(:n) + matmul(self%border, x(n + 1:))",
            "product(:n) = product(:n) + 0.0_wp*matmul(self%border, x(n + 1:))",
        ),
        (
            "bordered_held",
            "test_hb_bordered",
            "products move held unknowns",
            "where (self%is_held) product(:n) = x(:n)*self%r_scale(:n)/self%x_scale(:n)",
            "where (self%is_held) product(:n) = product(:n)",
        ),
    ),
    *of(
        "balance/hb_balance_precondition.f90",
        (
            "precondition_rank",
            "test_hb_balance_precondition",
            "harmonics are coupled by their numbers, not by how strongly they are",
            "kept = strongest(coupling, most)",
            "kept = strongest([(real(possible, wp), possible=1, size(coupling))], most)",
        ),
        (
            "precondition_first",
            "test_hb_balance_precondition",
            "the first harmonics are coupled",
            "kept = strongest(coupling, most)",
            "kept = [(possible, possible=1, most)]",
        ),
        (
            "precondition_rate",
            "test_hb_balance_precondition",
            "slopes against rates have the wrong sign",
            "block(:, set%cos_at(h)) = block(:, set%cos_at(h)) - w*sine",
            "block(:, set%cos_at(h)) = block(:, set%cos_at(h)) + w*sine",
        ),
        (
            "precondition_reaction",
            "test_hb_balance_precondition",
            "slopes against reactions have the wrong sign",
            "block(:, set%cos_at(h)) = aimag(s)*sine - real(s)*cosine",
            "block(:, set%cos_at(h)) = aimag(s)*sine + real(s)*cosine",
        ),
        (
            "precondition_mean",
            "test_hb_balance_precondition",
            "mean slopes against rates have the wrong sign",
            "cmplx(df_dq(i, k), self%frequencies(h)*df_dv(i, k), wp)",
            "cmplx(df_dq(i, k), -self%frequencies(h)*df_dv(i, k), wp)",
        ),
    ),
    *of(
        "balance/hb_balance_tangent.f90",
        (
            "tangent_rate",
            "test_hb_balance",
            "slopes against rates have the wrong sign",
            "0.0_wp, -self%frequencies(h), cosine_column, sine_column)",
            "0.0_wp, self%frequencies(h), cosine_column, sine_column)",
        ),
        (
            "tangent_reaction",
            "test_hb_balance",
            "damping has the wrong sign in reactions",
            "-real(s), aimag(s), cosine_column",
            "-real(s), -aimag(s), cosine_column",
        ),
        (
            "tangent_linear",
            "test_hb_balance",
            "damping has the wrong sign",
            "jacobian(b, i, a, k) = jacobian(b, i, a, k) - aimag(s)",
            "jacobian(b, i, a, k) = jacobian(b, i, a, k) + aimag(s)",
        ),
        (
            "tangent_memory_line",
            "test_hb_friction",
            "what sticks answers a quarter of a turn late",
            "x(set%sin_at(h)) = weight*aimag(sums(h))",
            "x(set%sin_at(h)) = -weight*aimag(sums(h))",
        ),
    ),
    *of(
        "balance/hb_tangent_choice.f90",
        (
            "choice_rigid",
            "test_hb_tangent_choice",
            "rigid laws count as smooth ones",
            "if (law%is_multiplier) largest",
            "if (law%degree < -1) largest",
        ),
        (
            "choice_last",
            "test_hb_tangent_choice",
            "the last law of a scene decides",
            "largest_dense_tangent = max(largest_dense_tangent, with_kinks)",
            "largest_dense_tangent = with_kinks",
        ),
    ),
    *of(
        "balance/hb_certificate.f90",
        (
            "certificate_reach",
            "test_hb_certificate",
            "commensurability is looked for a third as far",
            "reach = largest_sum(min(tones%n_tones, size(largest_sum)))",
            "reach = largest_sum(min(tones%n_tones, size(largest_sum)))/3",
        ),
        (
            "certificate_truncation",
            "test_hb_certificate",
            "the harmonics left out do not count themselves",
            "sqrt(norm2(change(:size(u)))**2 + norm2(answer)**2)/size_of_motion",
            "norm2(change(:size(u)))/size_of_motion",
        ),
        (
            "certificate_answer",
            "test_hb_certificate",
            "what they change in the others is forgotten",
            "sqrt(norm2(change(:size(u)))**2 + norm2(answer)**2)/size_of_motion",
            "norm2(answer)/size_of_motion",
        ),
        (
            "certificate_aliasing",
            "test_hb_certificate",
            "aliasing is a third of what it is",
            "self%aliasing = norm2(alias(:size(u)))/size_of_motion",
            "self%aliasing = norm2(alias(:size(u)))/size_of_motion/3",
        ),
        (
            "certificate_grid",
            "test_hb_certificate",
            "the finer grid is that of the solution",
            "samples = max(samples_for(orders, 0), 4*n_samples)",
            "samples = max(samples_for(orders, 0), n_samples)",
        ),
        (
            "certificate_orders",
            "test_hb_certificate",
            "the wider set has two orders more, not twice as many",
            "widest = max(2*highest, highest + 2)",
            "widest = highest + 2",
        ),
        (
            "certificate_power",
            "test_hb_certificate",
            "damping takes twice the power",
            "self%power_damping + 0.5_wp*w**2*real(",
            "self%power_damping + w**2*real(",
        ),
    ),
    *of(
        "balance/hb_two_level.f90",
        (
            "two_level_least",
            "test_hb_two_level",
            "of all motions on the way the worst is taken",
            "if (norm2(step) < least) then",
            "if (norm2(step) > least .or. i == 0) then",
        ),
    ),
    *of(
        "balance/hb_energy.f90",
        (
            "energy_frequency",
            "test_hb_energy",
            "the derivative by a frequency is off by kinetic energy",
            "0.5_wp*balance%frequencies*real(sum(",
            "balance%frequencies*real(sum(",
        ),
    ),
    *of(
        "balance/hb_odd_symmetry.f90",
        (
            "odd_grid",
            "test_hb_odd_symmetry",
            "grids of odd sizes pass",
            "if (any(modulo(torus%n_samples, 2) /= 0)) reason",
            "if (any(modulo(torus%n_samples, 2) > 1)) reason",
        ),
        (
            "odd_load",
            "test_hb_odd_symmetry",
            "loads of even tuples pass",
            "if (any(abs(loads(:, h)) > 0.0_wp)) reason",
            "if (any(abs(loads(:, h)) < 0.0_wp)) reason",
        ),
    ),
    *of(
        "hypertime/hb_harmonics.f90",
        (
            "harmonics_sign",
            "test_hb_harmonics",
            "of a tuple and its negative both or none are taken",
            "canonical_sign = sign(1, tuple(first))",
            "canonical_sign = sign(1, tuple(size(tuple)))",
        ),
        (
            "harmonics_amplitude",
            "test_hb_harmonics",
            "complex amplitudes are conjugate",
            "amplitude = cmplx(u(self%cos_at(h)), -u(sine), wp)",
            "amplitude = cmplx(u(self%cos_at(h)), u(sine), wp)",
        ),
        (
            "harmonics_parity",
            "test_hb_harmonics",
            "the tuples of the other parity are kept",
            "modulo(sum(set%tuples, dim=1), 2) == parity)",
            "modulo(sum(set%tuples, dim=1), 2) /= parity)",
        ),
    ),
    *of(
        "hypertime/hb_torus.f90",
        (
            "torus_degree",
            "test_hb_torus",
            "polynomials get too few samples",
            "needed = (degree + 1)*highest(m) + 1",
            "needed = degree*highest(m) + 1",
        ),
        (
            "torus_half",
            "test_hb_torus",
            "a single tone of 4 n + 2 samples is halved",
            "modulo(self%n_samples(1), 4) == 0",
            "modulo(self%n_samples(1), 2) == 0",
        ),
        (
            "torus_order",
            "test_hb_torus",
            "the last tone runs fastest",
            "do m = 1, size(self%n_samples)\n            tau",
            "do m = size(self%n_samples), 1, -1\n            tau",
        ),
    ),
    *of(
        "hypertime/hb_transform.f90",
        (
            "transform_rate",
            "test_hb_transform",
            "rates have the wrong sign",
            "c(h) = frequencies(h)*cmplx(x(set%sin_at(h), channel), x(set%cos_at(h), channel), wp)",
            "c(h) = frequencies(h)*cmplx(x(set%sin_at(h), channel), -x(set%cos_at(h), channel), wp)",
        ),
        (
            "transform_mean",
            "test_hb_transform",
            "means are twice what they are",
            "x(1) = 0.5_wp*real(c)",
            "x(1) = real(c)",
        ),
        (
            "transform_product",
            "test_hb_transform",
            "products of sines have the wrong sign",
            "sine_column(row + 2*h) = -real(difference)",
            "sine_column(row + 2*h) = real(difference)",
        ),
        (
            "transform_quarter",
            "test_hb_balance",
            "added columns are turned the wrong way",
            "+ a*aimag(total) - b*real(difference)",
            "+ a*aimag(total) + b*real(difference)",
        ),
        (
            "transform_alias",
            "test_hb_transform",
            "half of what is packed is left out",
            "conjg(near*spectrum(table%at(i)) + far*conjg(spectrum(table%at(n + 1 - i))))",
            "conjg(near*spectrum(table%at(i)) + 0.0_wp*far*conjg(spectrum(table%at(n + 1 - i))))",
        ),
    ),
    *of(
        "hypertime/hb_packed_fft.f90",
        (
            "fft_factors",
            "test_hb_transform",
            "the packed half has the wrong sign",
            "far = 0.5_wp*(1.0_wp - conjg(turn))",
            "far = 0.5_wp*(1.0_wp + conjg(turn))",
        ),
    ),
    *of(
        "laws/hb_law_elastic_stop.f90",
        (
            "stop_slope",
            "test_hb_laws",
            "the slope forgets the gap",
            "df_dz(:, :, 1) = merge(self%stiffness, 0.0_wp, z > self%gap)",
            "df_dz(:, :, 1) = merge(self%stiffness, 0.0_wp, z > 0.0_wp*self%gap)",
        ),
        (
            "stop_second",
            "test_hb_laws",
            "the second stop has the gap of the first",
            "merge(self%stiffness, 0.0_wp, z < -self%gap)",
            "merge(self%stiffness, 0.0_wp, z < self%gap)",
        ),
        (
            "stop_energy",
            "test_hb_energy",
            "stores twice the energy",
            "energy = 0.5_wp*self%stiffness*max(",
            "energy = self%stiffness*max(",
        ),
    ),
    *of(
        "laws/hb_law_rigid_wall.f90",
        (
            "wall_slope",
            "test_hb_laws",
            "the slope lacks the augmentation",
            "df_dz(:, :, 1) = eps*df_dp(:, :, 1)",
            "df_dz(:, :, 1) = df_dp(:, :, 1)",
        ),
        (
            "wall_tension",
            "test_hb_laws",
            "a wall that pulls is not told",
            "defects%tension = max(-minval(p), 0.0_wp)",
            "defects%tension = max(-maxval(p), 0.0_wp)",
        ),
        (
            "wall_odd",
            "test_hb_law_odd",
            "a single wall counts as odd",
            "rigid_wall_is_odd = self%two_sided",
            "rigid_wall_is_odd = .true.",
        ),
    ),
    *of(
        "laws/hb_law_coulomb_rigid.f90",
        (
            "coulomb_slip",
            "test_hb_friction_laws",
            "slip the wrong way counts as right",
            "defects%slip = maxval(self%limit*abs(v) - ",
            "defects%slip = maxval(self%limit*v - ",
        ),
    ),
    *of(
        "laws/hb_law_jenkins.f90",
        (
            "jenkins_slope",
            "test_hb_friction_laws",
            "the slope against the slider has the wrong sign",
            "df_ds(:, 1, 1) = -self%stiffness",
            "df_ds(:, 1, 1) = self%stiffness",
        ),
        (
            "jenkins_normal",
            "test_hb_friction_laws",
            "a contact that is open counts as closed",
            "merge(self%normal_stiffness, 0.0_wp, self%preload + self%normal_stiffness*z(:, 2) > 0.0_wp)",
            "self%normal_stiffness",
        ),
        (
            "jenkins_window",
            "test_hb_friction_laws",
            "a growing normal load moves both bounds the same way",
            "merge(-1.0_wp, 1.0_wp, pusher == pushed_by%lower)*slope*weights",
            "merge(1.0_wp, 1.0_wp, pusher == pushed_by%lower)*slope*weights",
        ),
    ),
    *of(
        "laws/hb_slider.f90",
        (
            "slider_turn",
            "test_hb_friction_laws",
            "turning points between samples are forgotten",
            "w = max(w, dot_product(turning_point(bound), bound))",
            "w = max(w, 0.0_wp*bound(1) + w)",
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
    *of(
        "march/hb_birkhoff.f90",
        (
            "birkhoff_half",
            "test_hb_birkhoff",
            "amplitudes are half of what they are",
            "coefficients(h) = 2.0_wp*coefficients(h)",
            "coefficients(h) = 1.0_wp*coefficients(h)",
        ),
    ),
    *of(
        "march/hb_march_verdict.f90",
        (
            "verdict_limit",
            "test_hb_march_verdict",
            "the limit is ten times as large",
            "safety = 5.0_wp",
            "safety = 50.0_wp",
        ),
        (
            "verdict_growth",
            "test_hb_march_verdict",
            "growth is not looked at first",
            "if (gain >= log(grown) .and. rise >= log(growing)) then",
            "if (gain >= 1.0e3_wp*log(grown) .and. rise >= log(growing)) then",
        ),
    ),
    *of(
        "study/hb_schedule.f90",
        (
            "schedule_stride",
            "test_hb_schedule",
            "some counters are never visited",
            "do while (common_divisor(self%stride, self%n_counters) > 1)",
            "do while (common_divisor(self%stride, self%n_counters) > huge(1))",
        ),
        (
            "schedule_line",
            "test_hb_schedule",
            "the last chain of a line runs into the next one",
            "min(place + self%chain, self%line)",
            "(place + self%chain)",
        ),
        (
            "schedule_time",
            "test_hb_schedule",
            "blocks of slow points are long",
            "if (n*way%seconds > self%block_seconds)",
            "if (n*way%seconds < self%block_seconds)",
        ),
    ),
]
