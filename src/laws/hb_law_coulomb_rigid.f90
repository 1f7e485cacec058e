!> Rigid Coulomb friction, exactly: |f| <= S, and f = S sgn(v) while it slides, by the friction force that equilibrium
!> requires.
!>
!> With p the reaction that equilibrium requires, f = min(max(p + eps v, -S), S). At a solution p and f agree in the
!> retained harmonics, so that either |f| < S and v = 0 (stick), or f = S sgn(v) (slip), up to the truncation of the
!> series, for any eps > 0. Source: docs/why/theory.md, section 5.5; augmented Lagrangian form of friction, Alart and
!> Curnier, Comput. Methods Appl. Mech. Engrg. 92 (1991) 353-375. Sign: f stands beside K q on the left-hand side.
module hb_law_coulomb_rigid
   use hb_kinds, only: wp
   use hb_law, only: defects_t, hold_t, law_t
   use hb_numbers, only: number_t, numbers_t
   implicit none
   private
   public :: coulomb_rigid_t

   type, extends(law_t) :: coulomb_rigid_t
      real(wp) :: limit = 0.0_wp                                      !! S = mu N [N]
      real(wp) :: augmentation = 0.0_wp                               !! eps [N s/m]; 0: the impedance of the structure
   contains
      procedure :: declare_numbers => coulomb_rigid_declare_numbers
      procedure :: derive => coulomb_rigid_derive
      procedure :: number_slope => coulomb_rigid_number_slope
      procedure :: evaluate => coulomb_rigid_evaluate
      procedure :: prepare_rate => coulomb_rigid_prepare_rate
      procedure :: defects => coulomb_rigid_defects
      procedure :: hold => coulomb_rigid_hold
   end type coulomb_rigid_t

contains

   subroutine coulomb_rigid_declare_numbers(self, numbers)
      class(coulomb_rigid_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      call numbers%add("limit", self%limit)
      call numbers%add("augmentation", self%augmentation)
   end subroutine coulomb_rigid_declare_numbers

   pure subroutine coulomb_rigid_derive(self)
      class(coulomb_rigid_t), intent(inout) :: self

      self%is_multiplier = .true.
      self%needs_velocity = .true.
      self%has_potential = .true.
      self%is_odd = .true.
   end subroutine coulomb_rigid_derive

   subroutine coulomb_rigid_evaluate(self, z, v, p, f, df_dz, df_dv, df_dp)
      class(coulomb_rigid_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: f(:, :)
      real(wp), intent(out), contiguous, optional :: df_dz(:, :, :), df_dv(:, :, :), df_dp(:, :, :)

      f = min(max(p + self%augmentation*v, -self%limit), self%limit)
      if (present(df_dz)) df_dz = 0.0_wp
      if (.not. (present(df_dv) .and. present(df_dp))) return
      df_dp(:, :, 1) = merge(1.0_wp, 0.0_wp, abs(p + self%augmentation*v) < self%limit)
      df_dv(:, :, 1) = self%augmentation*df_dp(:, :, 1)
   end subroutine coulomb_rigid_evaluate

   subroutine coulomb_rigid_number_slope(self, number, z, v, p, slope, is_known)
      class(coulomb_rigid_t), intent(in) :: self
      type(number_t), intent(in) :: number
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: slope(:, :)
      logical, intent(out) :: is_known

      is_known = .true.
      select case (number%key)
      case ("limit"); slope = merge(sign(1.0_wp, p + self%augmentation*v), 0.0_wp, abs(p + self%augmentation*v) >= self%limit)
      case ("augmentation"); slope = merge(v, 0.0_wp, abs(p + self%augmentation*v) < self%limit)
      case default
         is_known = .false.
      end select
   end subroutine coulomb_rigid_number_slope

   !> Sets eps to the impedance of the structure unless given by the user: the equations of sticking are then scaled
   !> like the linear ones.
   subroutine coulomb_rigid_prepare_rate(self, impedance, frequency)
      class(coulomb_rigid_t), intent(inout) :: self
      real(wp), intent(in) :: impedance, frequency

      if (self%augmentation <= 0.0_wp) self%augmentation = impedance
   end subroutine coulomb_rigid_prepare_rate

   !> Exact friction dissipates S |v|; the reaction, limited to S, dissipates less where it slips in the wrong
   !> direction or too early.
   pure function coulomb_rigid_defects(self, z, v, p) result(defects)
      class(coulomb_rigid_t), intent(in) :: self
      real(wp), intent(in) :: z(:, :), v(:, :), p(:, :)
      type(defects_t) :: defects

      defects%slip = maxval(self%limit*abs(v) - min(max(p, -self%limit), self%limit)*v)
   end function coulomb_rigid_defects

   function coulomb_rigid_hold(self) result(hold)
      class(coulomb_rigid_t), intent(in) :: self
      type(hold_t) :: hold

      hold%limit = self%limit
   end function coulomb_rigid_hold
end module hb_law_coulomb_rigid
