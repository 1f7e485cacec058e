!> Electrostatic force of a plate at z = d on a body that it attracts, f = -c V**2/(d - z)**2, with a voltage of which
!> a part may vary with the phase of tones, V = V_0 + V_c cos(j.tau) + V_s sin(j.tau). At d the body is pulled in, and
!> the force is undefined. Source: M. I. Younis, MEMS Linear and Nonlinear Statics and Dynamics, Springer 2011,
!> chapter 3; docs/why/theory.md, section 5.1. Sign: f stands beside K q on the left-hand side.
module hb_law_electrostatic
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use hb_kinds, only: wp
   use hb_law, only: law_t, read_location
   use hb_properties, only: properties_t
   use hb_structure, only: structure_t
   use hb_text, only: to_text
   implicit none
   private
   public :: electrostatic_t

   type, extends(law_t) :: electrostatic_t
      real(wp) :: coefficient = 0.0_wp                                !! c [N m**2/V**2], half of permittivity times area
      real(wp) :: gap = 0.0_wp                                        !! d [m]
      real(wp) :: voltage = 0.0_wp                                    !! V_0 [V]
      real(wp) :: wave(2) = 0.0_wp                                    !! V_c, V_s [V]
      real(wp), allocatable, private :: changing(:)                   ! their sum at the following samples [V]
   contains
      procedure :: read => electrostatic_read
      procedure :: set_phases => electrostatic_set_phases
      procedure :: evaluate => electrostatic_evaluate
      procedure :: potential => electrostatic_potential
      procedure :: explain => electrostatic_explain
   end type electrostatic_t

contains

   !> Reads a `&law type = 'electrostatic'` group.
   subroutine electrostatic_read(self, group, structure)
      class(electrostatic_t), intent(inout) :: self
      type(properties_t), intent(inout) :: group
      type(structure_t), intent(in) :: structure

      call group%get("coefficient", self%coefficient)
      call group%get("gap", self%gap)
      call group%get("voltage", self%voltage)
      call group%get("tuple", self%modulation)
      call group%get("voltage_cos", self%wave(1))
      call group%get("voltage_sin", self%wave(2))
      self%length_scale = self%gap/3                                   ! static pull-in
      self%has_potential = .not. allocated(self%modulation)
      call read_location(self, group, structure)
      if (allocated(self%modulation)) then
         self%n_phases = size(self%modulation)
         if (all(self%modulation == 0)) call group%problem("tuple", "all zero: a constant voltage belongs to 'voltage'")
      else if (any(abs(self%wave) > 0.0_wp)) then
         call group%problem("tuple", "give the tuple with which 'voltage_cos' and 'voltage_sin' vary")
      end if
   end subroutine electrostatic_read

   pure subroutine electrostatic_set_phases(self, phases)
      class(electrostatic_t), intent(inout) :: self
      real(wp), intent(in) :: phases(:, :)
      real(wp) :: modulation(self%n_phases), phase(size(phases, 2))

      modulation = real(self%modulation, wp)
      phase = matmul(modulation, phases(:self%n_phases, :))
      self%changing = self%wave(1)*cos(phase) + self%wave(2)*sin(phase)
   end subroutine electrostatic_set_phases

   subroutine electrostatic_evaluate(self, z, v, p, f, df_dz, df_dv, df_dp)
      class(electrostatic_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: f(:, :)
      real(wp), intent(out), contiguous, optional :: df_dz(:, :, :), df_dv(:, :, :), df_dp(:, :, :)
      real(wp) :: distance(size(z, 1)), voltage(size(z, 1))

      voltage = self%voltage
      if (allocated(self%changing)) voltage = voltage + self%changing
      distance = self%gap - z(:, 1)
      where (.not. distance > 0.0_wp) distance = ieee_value(1.0_wp, ieee_quiet_nan)
      f(:, 1) = -self%coefficient*(voltage/distance)**2
      if (present(df_dz)) df_dz(:, 1, 1) = 2.0_wp*f(:, 1)/distance
   end subroutine electrostatic_evaluate

   !> -c V**2/(d - z), from z = 0 on.
   subroutine electrostatic_potential(self, z, energy, gradient)
      class(electrostatic_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :)
      real(wp), intent(out) :: energy(:), gradient(:, :)
      real(wp) :: no_reaction(size(z, 1), 0)

      call self%evaluate(z, no_reaction, no_reaction, gradient)
      energy = gradient(:, 1)*(self%gap - z(:, 1))*z(:, 1)/self%gap
   end subroutine electrostatic_potential

   subroutine electrostatic_explain(self, z, v, text, is_fatal)
      class(electrostatic_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), v(:, :)
      character(:), allocatable, intent(out) :: text
      logical, intent(out) :: is_fatal

      is_fatal = .false.
      text = "the gap is closed at "//to_text(count(.not. z(:, 1) < self%gap))//" of "//to_text(size(z, 1))// &
             " samples: the body is pulled in by the plate"
   end subroutine electrostatic_explain
end module hb_law_electrostatic
