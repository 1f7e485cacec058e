"""Mutants of src/study."""

from mutant_parts.mutant import of

MUTANTS = [
    *of(
        "timedomain/hb_coexisting_motions.f90",
        (
            "coexisting_told",
            "test_hb_marched_motion",
            "of several motions the first is the answer, without a word",
            "settled%status == outcome%marched) settled%status = outcome%several",
            "settled%status == outcome%marched) continue",
        ),
        (
            "coexisting_subharmonic",
            "test_hb_marched_motion",
            "motions of several periods do not count beside others",
            "if (each(i)%status == outcome%pending) cycle",
            "if (each(i)%status /= outcome%marched) each(i)%status = 0\n         if (each(i)%status == 0) cycle",
        ),
    ),
    *of(
        "study/hb_results_copy.f90",
        (
            "copy_checksums",
            "test_hb_results_file",
            "rows of fewer places keep the checksums of more",
            "call of_rows%write(merge(sums, 0, stored /= 0), error, first)",
            "continue",
        ),
    ),
    *of(
        "timedomain/hb_marched_motion.f90",
        (
            "marched_unseen",
            "test_hb_marched_motion",
            "only what a fit has not seen tells its error",
            "do part = 1, parts",
            "do part = parts, parts",
        ),
        (
            "marched_candidates",
            "test_hb_marched_motion",
            "candidates that are too few for a motion leave it without an answer",
            "if (settled%spread <= allowed .or. (finds_lines .and. has_forgotten)) settled",
            "if (settled%spread <= allowed) settled",
        ),
        (
            "marched_noise",
            "test_hb_marched_motion",
            "what little a fit leaves is noise",
            "finds_lines .and. left_out <= largest_spread)",
            "finds_lines .and. left_out <= 0.0_wp)",
        ),
        (
            "marched_transient",
            "test_hb_marched_motion",
            "what is left of the start is a motion of several periods",
            "else if (has_forgotten .and. part > 1) then",
            "else if (part > 1) then",
        ),
        (
            "marched_implicit",
            "test_hb_marched_motion",
            "no implicit method goes on where cvode has had its work",
            "if (.not. settled%is_out_of_work .or.",
            "if (settled%is_out_of_work .or.",
        ),
        (
            "marched_again",
            "test_hb_marched_motion",
            "what repeats after several periods for a while is taken for a motion of these",
            "settled%status == status_before .and. &",
            ".true. .and. &",
        ),
        (
            "marched_steps",
            "test_hb_marched_motion",
            "the error of implicit steps is not in the spread",
            "settled%spread = hypot(settled%spread, change)",
            "continue",
        ),
        (
            "marched_budget",
            "test_hb_marched_motion",
            "a march has no budget of work",
            "config%most_looks = int(min(scene%march",
            "config%most_looks = int(min(1.0e9_wp*scene%march",
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
            "if (n*cursor%seconds > self%block_seconds)",
            "if (n*cursor%seconds < self%block_seconds)",
        ),
    ),
]
