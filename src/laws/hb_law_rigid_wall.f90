!> Rigid wall, z <= g, by the reaction that equilibrium requires: no stiffness of the wall is needed.
!>
!> With p the reaction that equilibrium requires, lambda = max(0, p + eps (z - g)). At a solution p and lambda agree
!> in the retained harmonics, so that lambda >= 0, z <= g and lambda (z - g) = 0 hold up to the truncation of the
!> series, for any eps > 0. Two-sided also -max(0, -p - eps (z + g)). Source: docs/why/theory.md, section 5.3;
!> augmented Lagrangian form of unilateral contact, Alart and Curnier, Comput. Methods Appl. Mech. Engrg. 92 (1991)
!> 353-375.
module hb_law_rigid_wall
   use hb_kinds, only: wp
   use hb_law, only: defects_t, hold_t, law_t
   use hb_numbers, only: number_t, numbers_t
   use hb_problems, only: problems_t
   implicit none
   private
   public :: rigid_wall_t

   type, extends(law_t) :: rigid_wall_t
      real(wp) :: gap = 0.0_wp                                        !! g [m]; negative: preloaded at rest
      real(wp) :: augmentation = 0.0_wp                               !! eps [N/m]; 0: the static stiffness of the structure
      logical :: two_sided = .false.
      real(wp) :: restitution = -1.0_wp !! ratio of the speeds after and before an impact; < 0: not given
      logical :: has_restitution = .false.                            !! it is a number of the law
   contains
      procedure :: declare_numbers => rigid_wall_declare_numbers
      procedure :: has_valid_numbers => rigid_wall_has_valid_numbers
      procedure :: check => rigid_wall_check
      procedure :: derive => rigid_wall_derive
      procedure :: number_slope => rigid_wall_number_slope
      procedure :: evaluate => rigid_wall_evaluate
      procedure :: prepare => rigid_wall_prepare
      procedure :: correct => rigid_wall_correct
      procedure :: defects => rigid_wall_defects
      procedure :: hold => rigid_wall_hold
   end type rigid_wall_t

contains

   subroutine rigid_wall_declare_numbers(self, numbers)
      class(rigid_wall_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      call numbers%note_given("restitution", self%has_restitution)
      call numbers%add("gap", self%gap)
      call numbers%add("augmentation", self%augmentation)
      if (self%has_restitution) call numbers%add("restitution", self%restitution)
      call numbers%add("two_sided", self%two_sided)
   end subroutine rigid_wall_declare_numbers

   logical function rigid_wall_has_valid_numbers(self) result(are_valid)
      class(rigid_wall_t), intent(in) :: self

      are_valid = .not. (self%two_sided .and. self%gap < 0.0_wp)
   end function rigid_wall_has_valid_numbers

   subroutine rigid_wall_check(self, problems)
      class(rigid_wall_t), intent(in) :: self
      class(problems_t), intent(inout) :: problems

      if (.not. self%has_valid_numbers()) call problems%add("gap", "a two-sided rigid wall needs a gap of 0 or more")
   end subroutine rigid_wall_check

   pure subroutine rigid_wall_derive(self)
      class(rigid_wall_t), intent(inout) :: self

      self%is_multiplier = .true.
      self%has_potential = .true.
      self%has_convex_free_region = .true.
      self%is_odd = self%two_sided
      self%length_scale = abs(self%gap)
   end subroutine rigid_wall_derive

   subroutine rigid_wall_evaluate(self, z, v, p, f, df_dz, df_dv, df_dp)
      class(rigid_wall_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: f(:, :)
      real(wp), intent(out), contiguous, optional :: df_dz(:, :, :), df_dv(:, :, :), df_dp(:, :, :)

      associate (eps => self%augmentation, g => self%gap)
         f = max(p + eps*(z - g), 0.0_wp)
         if (self%two_sided) f = f + min(p + eps*(z + g), 0.0_wp)
         if (.not. (present(df_dz) .and. present(df_dp))) return
         df_dp(:, :, 1) = merge(1.0_wp, 0.0_wp, p + eps*(z - g) > 0.0_wp)
         if (self%two_sided) df_dp(:, :, 1) = df_dp(:, :, 1) + merge(1.0_wp, 0.0_wp, p + eps*(z + g) < 0.0_wp)
         df_dz(:, :, 1) = eps*df_dp(:, :, 1)
      end associate
   end subroutine rigid_wall_evaluate

   subroutine rigid_wall_number_slope(self, number, z, v, p, slope, is_known)
      class(rigid_wall_t), intent(in) :: self
      type(number_t), intent(in) :: number
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: slope(:, :)
      logical, intent(out) :: is_known
      real(wp) :: eps, g

      is_known = .true.
      eps = self%augmentation
      g = self%gap
      select case (number%key)
      case ("gap")
         slope = merge(-eps, 0.0_wp, p + eps*(z - g) > 0.0_wp)
         if (self%two_sided) slope = slope + merge(eps, 0.0_wp, p + eps*(z + g) < 0.0_wp)
      case ("augmentation")
         slope = merge(z - g, 0.0_wp, p + eps*(z - g) > 0.0_wp)
         if (self%two_sided) slope = slope + merge(z + g, 0.0_wp, p + eps*(z + g) < 0.0_wp)
      case ("restitution"); slope = 0.0_wp                                       ! only impacts in time depend on it
      case default
         is_known = .false.
      end select
   end subroutine rigid_wall_number_slope

   !> Sets eps to the static stiffness of the structure unless given by the user: the contact equations are then
   !> scaled like the linear ones.
   subroutine rigid_wall_prepare(self, static_stiffness)
      class(rigid_wall_t), intent(inout) :: self
      real(wp), intent(in) :: static_stiffness

      if (self%augmentation <= 0.0_wp) self%augmentation = static_stiffness
   end subroutine rigid_wall_prepare

   !> Correction of the paper's figure 6: moves points behind the wall onto it.
   pure subroutine rigid_wall_correct(self, z, corrected)
      class(rigid_wall_t), intent(in) :: self
      real(wp), intent(in) :: z(:, :)
      real(wp), intent(out) :: corrected(:, :)

      corrected = min(z, self%gap)
      if (self%two_sided) corrected = max(corrected, -self%gap)
   end subroutine rigid_wall_correct

   pure function rigid_wall_defects(self, z, v, p) result(defects)
      class(rigid_wall_t), intent(in) :: self
      real(wp), intent(in) :: z(:, :), v(:, :), p(:, :)
      type(defects_t) :: defects

      defects%penetration = max(maxval(z) - self%gap, 0.0_wp)
      defects%complementarity = maxval(max(p, 0.0_wp)*abs(z - self%gap))
      if (self%two_sided) then                                        ! forces to either side are admissible
         defects%penetration = max(defects%penetration, -minval(z) - self%gap)
         defects%complementarity = max(defects%complementarity, maxval(max(-p, 0.0_wp)*abs(z + self%gap)))
      else
         defects%tension = max(-minval(p), 0.0_wp)
      end if
   end function rigid_wall_defects

   function rigid_wall_hold(self) result(hold)
      class(rigid_wall_t), intent(in) :: self
      type(hold_t) :: hold

      hold%is_wall = .true.
      hold%gap = self%gap
      hold%two_sided = self%two_sided
      hold%restitution = self%restitution
   end function rigid_wall_hold
end module hb_law_rigid_wall
