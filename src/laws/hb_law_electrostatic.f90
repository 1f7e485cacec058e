!> Electrostatic force of a plate at z = d on a body that it attracts, f = -c V**2/(d - z)**2, at a voltage with any number
!> of parts that vary with the phases of tones, V = V_0 + sum of V_c cos(j.tau) + V_s sin(j.tau). At d the body is pulled in,
!> and the force is undefined. Source: M. I. Younis, MEMS Linear and Nonlinear Statics and Dynamics, Springer 2011,
!> chapter 3; docs/why/theory.md, section 5.1. Sign: f stands beside K q on the left-hand side.
module hb_law_electrostatic
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use hb_kinds, only: wp
   use hb_law, only: law_t
   use hb_numbers, only: number_t, numbers_t
   use hb_problems, only: problems_t
   use hb_text, only: to_text
   implicit none
   private
   public :: electrostatic_t

   type, extends(law_t) :: electrostatic_t
      real(wp) :: coefficient = 0.0_wp                                !! c [N m**2/V**2], half of permittivity times area
      real(wp) :: gap = 0.0_wp                                        !! d [m]
      real(wp) :: voltage = 0.0_wp                                    !! V_0 [V]
      real(wp), allocatable :: cosines(:), sines(:)                   !! V_c, V_s [V] of each tuple, (n_tuples)
      real(wp), allocatable, private :: cosine(:, :), sine(:, :)      ! of the phases, (n_samples, n_tuples)
   contains
      procedure :: declare_numbers => electrostatic_declare_numbers
      procedure :: has_valid_numbers => electrostatic_has_valid_numbers
      procedure :: check => electrostatic_check
      procedure :: derive => electrostatic_derive
      procedure :: number_slope => electrostatic_number_slope
      procedure :: set_phases => electrostatic_set_phases
      procedure :: evaluate => electrostatic_evaluate
      procedure :: potential => electrostatic_potential
      procedure :: explain => electrostatic_explain
   end type electrostatic_t

contains

   subroutine electrostatic_declare_numbers(self, numbers)
      class(electrostatic_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      call numbers%add("tuple", self%modulation)
      call numbers%add("coefficient", self%coefficient)
      call numbers%add("gap", self%gap)
      call numbers%add("voltage", self%voltage)
      call numbers%add("voltage_cos", self%cosines)
      call numbers%add("voltage_sin", self%sines)
   end subroutine electrostatic_declare_numbers

   logical function electrostatic_has_valid_numbers(self) result(are_valid)
      class(electrostatic_t), intent(in) :: self

      are_valid = allocated(self%modulation) .or. n_tuples(self) == 0
   end function electrostatic_has_valid_numbers

   !> Number of tuples, which is that of their voltages.
   pure integer function n_tuples(self)
      class(electrostatic_t), intent(in) :: self

      n_tuples = merge(1, 0, allocated(self%modulation))
      if (allocated(self%cosines)) n_tuples = max(n_tuples, size(self%cosines))
      if (allocated(self%sines)) n_tuples = max(n_tuples, size(self%sines))
   end function n_tuples

   subroutine electrostatic_check(self, problems)
      class(electrostatic_t), intent(in) :: self
      class(problems_t), intent(inout) :: problems
      integer :: i, n

      n = n_tuples(self)
      if (.not. allocated(self%modulation)) then
         if (n > 0) call problems%add("tuple", "give the tuple with which 'voltage_cos' and 'voltage_sin' vary")
      else if (modulo(size(self%modulation), n) /= 0) then
         call problems%add("tuple", "has "//to_text(size(self%modulation))//" entries for "//to_text(n)// &
                           " voltages: give a tuple for each, one after another, all of the same length")
      else if (any([(all(self%modulation((i - 1)*self%n_phases + 1:i*self%n_phases) == 0), i=1, n)])) then
         call problems%add("tuple", "all zero: a constant voltage belongs to 'voltage'")
      end if
      if (any([size(self%cosines), size(self%sines)] /= n)) &
         call problems%add("voltage_sin", "give as many values as of 'voltage_cos', one for each tuple")
   end subroutine electrostatic_check

   pure subroutine electrostatic_derive(self)
      class(electrostatic_t), intent(inout) :: self

      self%length_scale = self%gap/3                                   ! static pull-in
      self%has_potential = .not. allocated(self%modulation)
      if (.not. allocated(self%cosines)) allocate (self%cosines(n_tuples(self)), source=0.0_wp)
      if (.not. allocated(self%sines)) allocate (self%sines(n_tuples(self)), source=0.0_wp)
      if (allocated(self%modulation)) self%n_phases = size(self%modulation)/n_tuples(self)
   end subroutine electrostatic_derive

   pure subroutine electrostatic_set_phases(self, phases)
      class(electrostatic_t), intent(inout) :: self
      real(wp), intent(in) :: phases(:, :)
      real(wp) :: phase(size(phases, 2), size(self%cosines)), tuples(self%n_phases, size(self%cosines))

      tuples = reshape(real(self%modulation, wp), shape(tuples))
      phase = matmul(transpose(phases(:self%n_phases, :)), tuples)
      self%cosine = cos(phase)
      self%sine = sin(phase)
   end subroutine electrostatic_set_phases

   subroutine electrostatic_evaluate(self, z, v, p, f, df_dz, df_dv, df_dp)
      class(electrostatic_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: f(:, :)
      real(wp), intent(out), contiguous, optional :: df_dz(:, :, :), df_dv(:, :, :), df_dp(:, :, :)
      real(wp) :: distance(size(z, 1)), voltage(size(z, 1))

      call find_state(self, z, voltage, distance)
      f(:, 1) = -self%coefficient*(voltage/distance)**2
      if (present(df_dz)) df_dz(:, 1, 1) = 2.0_wp*f(:, 1)/distance
   end subroutine electrostatic_evaluate

   !> Voltage and distance of the plates at each sample; NaN where they touch.
   pure subroutine find_state(self, z, voltage, distance)
      class(electrostatic_t), intent(in) :: self
      real(wp), intent(in) :: z(:, :)
      real(wp), intent(out) :: voltage(:), distance(:)                !! [V], [m], (n_samples)
      integer :: k

      voltage = self%voltage
      do k = 1, size(self%cosines)
         voltage = voltage + (self%cosines(k)*self%cosine(:, k) + self%sines(k)*self%sine(:, k))
      end do
      distance = self%gap - z(:, 1)
      where (.not. distance > 0.0_wp) distance = ieee_value(1.0_wp, ieee_quiet_nan)
   end subroutine find_state

   subroutine electrostatic_number_slope(self, number, z, v, p, slope, is_known)
      class(electrostatic_t), intent(in) :: self
      type(number_t), intent(in) :: number
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: slope(:, :)
      logical, intent(out) :: is_known
      real(wp) :: distance(size(z, 1)), voltage(size(z, 1))

      is_known = .true.
      call find_state(self, z, voltage, distance)
      select case (number%key)
      case ("coefficient"); slope(:, 1) = -(voltage/distance)**2
      case ("gap"); slope(:, 1) = 2.0_wp*self%coefficient*voltage**2/distance**3
      case ("voltage"); slope(:, 1) = -2.0_wp*self%coefficient*voltage/distance**2
      case ("voltage_cos"); slope(:, 1) = -2.0_wp*self%coefficient*voltage/distance**2*self%cosine(:, max(1, number%element(1)))
      case ("voltage_sin"); slope(:, 1) = -2.0_wp*self%coefficient*voltage/distance**2*self%sine(:, max(1, number%element(1)))
      case default
         is_known = .false.
      end select
   end subroutine electrostatic_number_slope

   !> -c V**2/(d - z), from that of z = 0 on.
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
      text = "pull-in: the body reaches the plate at "//to_text(count(.not. z(:, 1) < self%gap))//" of "// &
             to_text(size(z, 1))//" samples"
   end subroutine electrostatic_explain
end module hb_law_electrostatic
