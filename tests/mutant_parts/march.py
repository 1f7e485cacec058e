"""Mutants of src/march."""

from mutant_parts.mutant import of

MUTANTS = [
    *of(
        "hypertime/hb_birkhoff.f90",
        (
            "birkhoff_half",
            "test_hb_birkhoff",
            "amplitudes are half of what they are",
            "coefficients(h) = 2.0_wp*coefficients(h)",
            "coefficients(h) = 1.0_wp*coefficients(h)",
        ),
    ),
    *of(
        "timedomain/hb_line_fit.f90",
        (
            "line_fit_seen",
            "test_hb_line_fit",
            "a fit sees all samples",
            "self%window = [bump_weights(n_seen), (0.0_wp, k=n_seen + 1, n_samples)]",
            "self%window = bump_weights(n_samples)",
        ),
        (
            "line_fit_importance",
            "test_hb_line_fit",
            "all lines are alike",
            "self%importance = importance/maxval(importance)",
            "self%importance = 1.0_wp + 0.0_wp*importance",
        ),
        (
            "line_fit_conjugate",
            "test_hb_line_fit",
            "directions are not conjugate",
            "direction = left + after/before*direction",
            "direction = left",
        ),
        (
            "line_fit_fold",
            "test_hb_line_fit",
            "lines near zero are not folded back",
            "sums(h) = sums(h) + self%kernel(k, h)*conjg(spectrum(1 - place))",
            "sums(h) = sums(h) + self%kernel(k, h)*spectrum(1 - place)",
        ),
    ),
    *of(
        "timedomain/hb_march_cvode.f90",
        (
            "cvode_creeping",
            "test_hb_march",
            "what friction holds keeps the speed that it had",
            "if (size(equations%active) > 0) call stop_active(",
            "if (size(equations%active) > huge(1)) call stop_active(",
        ),
    ),
    *of(
        "timedomain/hb_march_starts.f90",
        (
            "starts_apart",
            "test_hb_march_starts",
            "motions of which one coordinate differs are the same",
            "distance = maxval([(norm2(abs(a(:, k) - b(:, k)))/own(k)",
            "distance = minval([(norm2(abs(a(:, k) - b(:, k)))/own(k)",
        ),
        (
            "starts_sphere",
            "test_hb_march_starts",
            "all starts have one direction",
            "angle = two_pi*golden*number",
            "angle = two_pi*golden",
        ),
    ),
    *of(
        "timedomain/hb_march_verdict.f90",
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
        (
            "verdict_wanders",
            "test_hb_march_verdict",
            "a few periods in which a march is by chance nearer than before count as decay",
            "if (is_last) stretch = max(tail, n/4)",
            "if (is_last) stretch = tail",
        ),
    ),
    *of(
        "timedomain/hb_recurrence.f90",
        (
            "recurrence_before",
            "test_hb_recurrence",
            "a record is compared with itself after a shift, not before it as well",
            "0.5_wp*(x(:n - 2*shift, k) + x(2*shift + 1:, k))",
            "x(2*shift + 1:, k)",
        ),
        (
            "recurrence_odd",
            "test_hb_recurrence",
            "whole turns may be even in all tones",
            "merge(part, 0, btest(class, m - 1))",
            "merge(0, 0, btest(class, m - 1))",
        ),
        (
            "recurrence_part",
            "test_hb_recurrence",
            "motions of several turns are sought in one",
            "call find_return(turns, part, class, n/3, shift, missing(class))",
            "call find_return(turns, 1, class, n/3, shift, missing(class))",
        ),
        (
            "recurrence_several",
            "test_hb_recurrence",
            "a motion of several turns is one of the tones",
            "if (share > allowed .and. part > 1) then",
            "if (share > 1.0e3_wp*allowed .and. part > 1) then",
        ),
        (
            "recurrence_disorder",
            "test_hb_recurrence",
            "a motion that never repeats is one of the tones",
            "largest(1) <= max(allowed, clearly*share)) then",
            "largest(1) <= max(1.0e3_wp*allowed, clearly*share)) then",
        ),
        (
            "recurrence_within",
            "test_hb_recurrence",
            "what returns badly after one turn of the tones tells that a motion takes several",
            "defect(:, 1)*(within/max(within, missing(:, 1)))**2",
            "defect(:, 1)",
        ),
        (
            "recurrence_none",
            "test_hb_recurrence",
            "a motion that repeats in some turns and not in others has no order",
            "all(defect(:, 1) >= mostly*share .or. .not. returns(:, 1))",
            "largest(1) >= mostly*share",
        ),
    ),
]
