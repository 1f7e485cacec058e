!> A force, or the motion of a base: one tuple at some degrees of freedom, both may grow with a power of the frequency. In time
!> integration it may begin, end, and have a frequency of its own.
module hb_load
   use hb_harmonic_amplitude, only: harmonic_amplitude_t
   use hb_harmonics, only: canonical_sign
   use hb_kinds, only: wp
   use hb_load_course, only: load_course_t
   use hb_numbers, only: number_t, numbers_t
   use hb_problems, only: problems_t
   use hb_sine_course, only: sine_course_t
   use hb_spectrum, only: spectrum_t
   use hb_structure, only: structure_t
   use hb_structure_load, only: structure_load_t, timed_structure_load_t
   implicit none
   private
   public :: load_t

   character(*), parameter :: units_of_powers(0:4) = [character(4) :: "N", "N s", "N s2", "N s3", "N s4"]

   type, extends(timed_structure_load_t) :: load_t
      logical :: is_acceleration = .false., is_displacement = .false. !! of the base; neither: a force
      integer :: power = 0                                            !! of |j.omega|, by which the amplitudes are multiplied
      type(harmonic_amplitude_t) :: amplitude                         !! [N], [m/s**2], [m], by the power of the frequency
      type(sine_course_t) :: course                                   !! if it is one of time integration alone
      logical, private :: has_cosine = .true., has_sine = .true., is_tuple_given = .false. ! in an input; as the next
      logical, private :: has_begin = .false., has_end = .false., has_frequency = .false., has_end_frequency = .false., &
                          has_chirp = .false.
   contains
      procedure :: add_slope_to => load_add_slope_to
      procedure :: add_to => load_add_to
      procedure :: check => load_check
      procedure :: declare_numbers => load_declare_numbers
      procedure :: depends_on_frequency => load_depends_on_frequency
      procedure :: depends_on_structure => load_depends_on_structure
      procedure :: derive => load_derive
      procedure :: find_course => load_find_course
      procedure :: has_tuple => load_has_tuple
      procedure :: has_valid_numbers => load_has_valid_numbers
      procedure :: is_affine_in => load_is_affine_in
      procedure :: is_zero => load_is_zero
      procedure :: repeats => load_repeats
   end type load_t

contains

   subroutine load_declare_numbers(self, numbers)
      class(load_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      call numbers%add("frequency_power", self%power)
      call numbers%add("kind", self%is_acceleration, "base_acceleration")
      call numbers%add("kind", self%is_displacement, "base_displacement")
      call declare_course(self, numbers)
      call numbers%note_given("cos", self%has_cosine)
      call numbers%note_given("sin", self%has_sine)
      call self%amplitude%declare(numbers, trim(unit_of(self)))
   end subroutine load_declare_numbers

   !> Declares the numbers of the course over time that are given.
   subroutine declare_course(self, numbers)
      class(load_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      call numbers%note_given("tuple", self%is_tuple_given)
      call numbers%note_given("begin", self%has_begin)
      call numbers%note_given("end", self%has_end)
      call numbers%note_given("frequency", self%has_frequency)
      call numbers%note_given("end_frequency", self%has_end_frequency)
      call numbers%note_given("chirp", self%has_chirp)
      if (self%has_begin) call numbers%add("begin", self%course%begin)
      if (self%has_end) call numbers%add("end", self%course%end)
      if (self%has_frequency) call numbers%add("frequency", self%course%frequency)
      if (self%has_end_frequency) call numbers%add("end_frequency", self%course%end_frequency)
      if (self%has_chirp) call numbers%add("chirp", self%course%is_exponential, "exponential")
      self%timed_by = ""
      if (self%has_chirp) self%timed_by = "chirp"
      if (self%has_end_frequency) self%timed_by = "end_frequency"
      if (self%has_frequency) self%timed_by = "frequency"
      if (self%has_end) self%timed_by = "end"
      if (self%has_begin) self%timed_by = "begin"
   end subroutine declare_course

   !> Unit of the amplitudes.
   pure character(4) function unit_of(self) result(unit)
      class(load_t), intent(in) :: self

      unit = units_of_powers(max(0, min(self%power, 4)))
      if (self%is_acceleration) unit = "m/s2"
      if (self%is_displacement) unit = "m"
   end function unit_of

   !> The chirp begins with the load, at the frequency that is given.
   pure subroutine load_derive(self)
      class(load_t), intent(inout) :: self

      self%course%power = self%power
      self%course%is_chirp = self%has_end_frequency
      if (self%has_frequency .and. self%has_begin) self%course%origin = self%course%begin
   end subroutine load_derive

   subroutine load_check(self, problems)
      class(load_t), intent(in) :: self
      class(problems_t), intent(inout) :: problems

      if (.not. (self%has_cosine .or. self%has_sine)) call problems%add("cos", "give 'cos', 'sin' or both")
      if (self%timed_by == "") return
      if (.not. ends_after_begin(self)) call problems%add("end", "must be later than the begin of the load")
      if (self%has_end_frequency .and. .not. (self%has_end .and. self%has_frequency)) then
         call problems%add("end_frequency", "needs 'frequency', from which it changes, and 'end', when it is reached")
      else if (.not. has_frequencies_of_chirp(self)) then
         call problems%add("chirp", "'exponential' needs 'frequency' and 'end_frequency' above 0")
      end if
      if (self%has_frequency .and. self%is_tuple_given) &
         call problems%add("frequency", "give either 'tuple' or 'frequency', not both")
      if (self%is_displacement) call problems%add("kind", "a base that jumps or changes its frequency is given by its "// &
                                                  "acceleration: 'base_acceleration'")
   end subroutine load_check

   logical function load_has_valid_numbers(self) result(are_valid)
      class(load_t), intent(in) :: self

      are_valid = .true.
      if (self%timed_by /= "") are_valid = ends_after_begin(self) .and. has_frequencies_of_chirp(self)
   end function load_has_valid_numbers

   pure logical function ends_after_begin(self)
      class(load_t), intent(in) :: self
      real(wp) :: begin

      begin = self%course%begin
      if (self%has_end_frequency .and. .not. (self%has_begin .and. self%has_frequency)) begin = max(begin, 0.0_wp)
      ends_after_begin = self%course%end > begin
   end function ends_after_begin

   pure logical function has_frequencies_of_chirp(self) result(has)
      class(load_t), intent(in) :: self

      has = .not. self%course%is_exponential
      if (.not. has) has = self%has_end_frequency .and. self%course%frequency > 0.0_wp .and. self%course%end_frequency > 0.0_wp
   end function has_frequencies_of_chirp

   !> Whether the force is an affine function of a number, as it is of both amplitudes.
   pure logical function load_is_affine_in(self, number) result(is_affine)
      class(load_t), intent(in) :: self
      type(number_t), intent(in) :: number

      is_affine = number%key == "cos" .or. number%key == "sin"
   end function load_is_affine_in

   pure logical function load_depends_on_frequency(self) result(depends)
      class(load_t), intent(in) :: self

      depends = self%power > 0 .or. self%is_displacement
   end function load_depends_on_frequency

   !> The motion of a base acts on the mass.
   pure logical function load_depends_on_structure(self) result(depends)
      class(load_t), intent(in) :: self

      depends = self%is_acceleration .or. self%is_displacement
   end function load_depends_on_structure

   !> Whether it has a tuple, instead of a frequency of its own.
   pure logical function load_has_tuple(self) result(has)
      class(load_t), intent(in) :: self

      has = .not. self%has_frequency
   end function load_has_tuple

   pure logical function load_is_zero(self) result(is_zero)
      class(load_t), intent(in) :: self

      is_zero = self%amplitude%is_zero() .or. .not. any(abs(self%weights) > 0.0_wp)
   end function load_is_zero

   !> In the frame of a base that moves by r a(t), the force is -M r a''.
   subroutine load_add_to(self, structure, omega, loads, slopes)
      class(load_t), intent(in) :: self
      type(structure_t), intent(in) :: structure
      real(wp), intent(in) :: omega(:)
      type(spectrum_t), intent(inout) :: loads
      type(spectrum_t), intent(inout), optional :: slopes
      real(wp) :: frequency
      integer :: power

      frequency = canonical_sign(self%tuple)*dot_product(omega, self%tuple)
      power = self%power + merge(2, 0, self%is_displacement)
      call add_times(loads, merge(1.0_wp, abs(frequency)**power, power == 0))
      if (present(slopes) .and. power > 0) &
         call add_times(slopes, power*abs(frequency)**(power - 1)*sign(1.0_wp, frequency))

   contains

      subroutine add_times(sum_of_loads, factor)
         type(spectrum_t), intent(inout) :: sum_of_loads
         real(wp), intent(in) :: factor
         complex(wp) :: all_dofs(structure%n_dofs), c
         integer :: i

         c = self%amplitude%turned(is_constant=all(self%tuple == 0))
         if (.not. self%depends_on_structure()) then
            call sum_of_loads%add(self%tuple, factor*(self%weights*c), self%dofs)
            return
         end if
         all_dofs = (0.0_wp, 0.0_wp)
         do i = 1, size(self%dofs)
            all_dofs(self%dofs(i)) = all_dofs(self%dofs(i)) + self%weights(i)*c
         end do
         call sum_of_loads%add(self%tuple, factor*merge(-1, 1, self%is_acceleration)*structure%mass_times(all_dofs))
      end subroutine add_times
   end subroutine load_add_to

   !> The force is linear in its amplitude.
   subroutine load_add_slope_to(self, number, structure, omega, slope, is_known)
      class(load_t), intent(in) :: self
      type(number_t), intent(in) :: number
      type(structure_t), intent(in) :: structure
      real(wp), intent(in) :: omega(:)
      type(spectrum_t), intent(inout) :: slope
      logical, intent(out) :: is_known
      type(load_t) :: unit

      unit = self
      call self%amplitude%slope(trim(number%key), all(self%tuple == 0), unit%amplitude, is_known)
      if (is_known .and. .not. unit%amplitude%is_zero()) call unit%add_to(structure, omega, slope)
   end subroutine load_add_slope_to

   subroutine load_find_course(self, structure, omega, course, amplitude)
      class(load_t), intent(in) :: self
      type(structure_t), intent(in) :: structure
      real(wp), intent(in) :: omega(:)
      class(load_course_t), allocatable, intent(out) :: course
      complex(wp), intent(inout) :: amplitude(:)
      type(sine_course_t) :: mine
      complex(wp) :: c
      integer :: k

      mine = self%course
      if (.not. self%has_frequency) mine%frequency = dot_product(self%tuple, omega)
      allocate (course, source=mine)
      c = self%amplitude%turned(is_constant=.not. self%has_frequency .and. all(self%tuple == 0))
      do k = 1, size(self%dofs)
         amplitude(self%dofs(k)) = amplitude(self%dofs(k)) + self%weights(k)*c
      end do
      if (self%is_acceleration) amplitude = -structure%mass_times(amplitude)
   end subroutine load_find_course

   !> The same place, tuple and component.
   pure logical function load_repeats(self, other) result(repeats)
      class(load_t), intent(in) :: self
      class(structure_load_t), intent(in) :: other

      repeats = .false.
      select type (other)
      type is (load_t)
         repeats = allocated(self%tuple) .and. allocated(other%tuple) .and. allocated(self%dofs) .and. allocated(other%dofs) .and. &
                   (self%is_acceleration .eqv. other%is_acceleration) .and. &
                   (self%is_displacement .eqv. other%is_displacement) .and. self%power == other%power .and. &
                   self%timed_by == "" .and. other%timed_by == ""
         if (repeats) repeats = size(self%tuple) == size(other%tuple) .and. size(self%dofs) == size(other%dofs)
         if (.not. repeats) return
         associate (a => self%amplitude, b => other%amplitude)
            repeats = all(self%dofs == other%dofs) .and. abs(a%phase - b%phase) <= 0.0_wp .and. &
                      (all(self%tuple == other%tuple) .or. all(self%tuple == -other%tuple)) .and. &
                      (abs(a%cosine*b%cosine) > 0.0_wp .or. abs(a%sine*b%sine) > 0.0_wp)
         end associate
         if (repeats) repeats = all(abs(self%weights - other%weights) <= 0.0_wp)
      end select
   end function load_repeats
end module hb_load
