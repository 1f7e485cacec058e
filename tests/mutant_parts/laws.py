"""Mutants of src/laws."""

from mutant_parts.mutant import of

MUTANTS = [
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
            "self%is_odd = two_sided",
            "self%is_odd = .true.",
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
]
