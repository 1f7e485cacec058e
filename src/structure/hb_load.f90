!> A load, or a term of a first guess: cosine and sine amplitudes of one tuple at some degrees of freedom and a phase by which it
!> leads. A force, or the motion of a base; both may grow with a power of the frequency.
module hb_load
   use hb_amplitudes, only: amplitudes_t, new_amplitudes
   use hb_error, only: error_t
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: two_pi, wp
   use hb_load_course, only: load_course_t, timed_load_t
   use hb_numbers, only: number_t, numbered_t, numbers_t
   use hb_structure, only: structure_t
   implicit none
   private
   public :: load_kind, load_t, timed_loads

   !> In the order of the words of an input.
   type :: load_kind_t
      integer :: force = 1
      integer :: base_acceleration = 2
      integer :: base_displacement = 3
   end type load_kind_t
   type(load_kind_t), parameter :: load_kind = load_kind_t()

   type, extends(numbered_t) :: load_t
      integer :: kind = load_kind%force
      integer :: power = 0                                            !! of |j.omega|, by which the amplitudes are multiplied
      integer, allocatable :: tuple(:)                                !! j, (n_tones)
      integer, allocatable :: dofs(:)
      real(wp), allocatable :: weights(:)                             !! (size(dofs))
      real(wp) :: cosine = 0.0_wp, sine = 0.0_wp
      real(wp) :: phase = 0.0_wp                                      !! [rad], without effect for the zero tuple
      character(4) :: unit = "N"                                      !! of both
      type(load_course_t) :: course                                   !! over time; given: no load of the balance
   contains
      procedure :: declare_numbers => load_declare_numbers
      procedure :: add_to => load_add_to
      procedure :: add_slope_to => load_add_slope_to
      procedure :: is_affine_in => load_is_affine_in
      procedure :: grows => load_grows
      procedure :: depends_on_structure => load_depends_on_structure
   end type load_t

contains

   subroutine load_declare_numbers(self, numbers)
      class(load_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      call numbers%add("cos", self%cosine, unit=trim(self%unit))
      call numbers%add("sin", self%sine, unit=trim(self%unit))
      call numbers%add("phase", self%phase)
   end subroutine load_declare_numbers

   !> Whether the force is an affine function of a number, as it is of both amplitudes.
   pure logical function load_is_affine_in(self, number) result(is_affine)
      class(load_t), intent(in) :: self
      type(number_t), intent(in) :: number

      is_affine = number%key == "cos" .or. number%key == "sin"
   end function load_is_affine_in

   !> Whether the force depends on the frequency.
   elemental logical function load_grows(self) result(grows)
      class(load_t), intent(in) :: self

      grows = self%power > 0 .or. self%kind == load_kind%base_displacement
   end function load_grows

   !> Whether the force depends on the mass of the structure.
   elemental logical function load_depends_on_structure(self) result(depends)
      class(load_t), intent(in) :: self

      depends = self%kind /= load_kind%force
   end function load_depends_on_structure

   !> Adds the force to those of all loads, unless the set does not have its tuple. In the frame of a base that moves by
   !> r a(t), the force is -M r a''.
   subroutine load_add_to(self, structure, set, frequencies, loads, slopes)
      class(load_t), intent(in) :: self
      type(structure_t), intent(in) :: structure
      type(harmonics_t), intent(in) :: set
      real(wp), intent(in) :: frequencies(:)                          !! j.omega [rad/s], (n_harmonics)
      type(amplitudes_t), intent(inout) :: loads                      !! [N], or [m] of a first guess
      type(amplitudes_t), intent(inout), optional :: slopes           !! their derivatives by j.omega [N s]
      type(amplitudes_t) :: amplitudes
      type(error_t), allocatable :: error
      real(wp) :: phase
      integer :: h, power

      call new_amplitudes(amplitudes, structure%n_dofs, set%n_harmonics)
      phase = merge(self%phase, 0.0_wp, any(self%tuple /= 0))
      call amplitudes%add_tuple(set, self%tuple, self%dofs, self%weights*(self%cosine*cos(phase) + self%sine*sin(phase)), &
                                self%weights*(self%sine*cos(phase) - self%cosine*sin(phase)), error)
      if (allocated(error)) return
      power = self%power
      if (self%kind /= load_kind%force) then
         do h = 1, size(amplitudes%values, 2)
            amplitudes%values(:, h) = merge(-1, 1, self%kind == load_kind%base_acceleration)* &
                                      structure%mass_times(amplitudes%values(:, h))
         end do
         if (self%kind == load_kind%base_displacement) power = power + 2
      end if
      if (power == 0) then
         call loads%add_scaled(amplitudes, spread(1.0_wp, 1, set%n_harmonics))
         return
      end if
      call loads%add_scaled(amplitudes, abs(frequencies)**power)
      if (present(slopes)) &
         call slopes%add_scaled(amplitudes, power*abs(frequencies)**(power - 1)*sign(1.0_wp, frequencies))
   end subroutine load_add_to

   !> The loads that have a course over time.
   pure function timed_loads(given, structure) result(timed)
      type(load_t), intent(in) :: given(:)
      type(structure_t), intent(in) :: structure
      type(timed_load_t) :: timed(count(given%course%is_given))
      integer :: i, k, n

      n = 0
      do i = 1, size(given)
         if (.not. given(i)%course%is_given) cycle
         n = n + 1
         timed(n)%course = given(i)%course
         associate (load => given(i))
            allocate (timed(n)%amplitude(structure%n_dofs), source=(0.0_wp, 0.0_wp))
            do k = 1, size(load%dofs)
               timed(n)%amplitude(load%dofs(k)) = timed(n)%amplitude(load%dofs(k)) + &
                                                  load%weights(k)*cmplx(load%cosine, -load%sine, wp)*ahead(load)
            end do
            if (load%kind == load_kind%base_acceleration) timed(n)%amplitude = -structure%mass_times(timed(n)%amplitude)
         end associate
      end do

   contains

      !> exp(i phase), without effect on a load without a frequency.
      pure complex(wp) function ahead(load)
         type(load_t), intent(in) :: load

         ahead = (1.0_wp, 0.0_wp)
         if (load%course%has_own_frequency .or. any(load%tuple /= 0)) ahead = cmplx(cos(load%phase), sin(load%phase), wp)
      end function ahead
   end function timed_loads

   !> Adds the derivative of the force by one of its numbers: linear in the amplitudes, and a quarter of a period ahead for the
   !> phase. `is_known` is false for other numbers, so that differences must take its place.
   subroutine load_add_slope_to(self, number, structure, set, frequencies, slope, is_known)
      class(load_t), intent(in) :: self
      type(number_t), intent(in) :: number                            !! one that it declares
      type(structure_t), intent(in) :: structure
      type(harmonics_t), intent(in) :: set
      real(wp), intent(in) :: frequencies(:)                          !! j.omega [rad/s], (n_harmonics)
      type(amplitudes_t), intent(inout) :: slope                      !! [N by the unit of the number]
      logical, intent(out) :: is_known
      type(load_t) :: unit

      unit = self
      is_known = .true.
      select case (number%key)
      case ("cos")
         unit%cosine = 1.0_wp
         unit%sine = 0.0_wp
      case ("sin")
         unit%cosine = 0.0_wp
         unit%sine = 1.0_wp
      case ("phase")
         if (all(self%tuple == 0)) return                             ! without effect
         unit%phase = self%phase + 0.25_wp*two_pi
      case default
         is_known = .false.
         return
      end select
      call unit%add_to(structure, set, frequencies, slope)
   end subroutine load_add_slope_to
end module hb_load
