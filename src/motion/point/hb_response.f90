!> A response: the oscillation of one degree of freedom, or one harmonic of it.
module hb_response
   use hb_error, only: error_t, fail
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: wp
   use hb_structure, only: structure_t
   use hb_text, only: number_of, to_text
   use hb_thresholds, only: rounding_level
   implicit none
   private
   public :: new_response, response_t

   type :: response_t
      character(:), allocatable :: name                               !! as in the input
      integer :: dof = 0                                              !! of the structure
      integer :: column = 0                                           !! number of the coordinate that equals dof; 0: none
      integer, allocatable :: tuple(:)                                !! of a harmonic; none: root mean square of all but the mean
   contains
      procedure :: of => response_of
      procedure :: slope_of => response_slope_of
      procedure :: find_weights => response_find_weights
      procedure :: numbers_in => response_numbers_in
      procedure :: distance => response_distance
      procedure :: is_in => response_is_in
   end type response_t

contains

   !> Creates the response of a name: `v3` for the whole oscillation, `v3 (1,0)` for one harmonic. Fails if the
   !> structure has no such degree of freedom.
   subroutine new_response(self, name, structure, n_tones, error)
      type(response_t), intent(out) :: self
      character(*), intent(in) :: name
      type(structure_t), intent(in) :: structure
      integer, intent(in) :: n_tones
      type(error_t), allocatable, intent(out) :: error
      integer :: bracket, status, tuple(n_tones)

      self%name = trim(name)
      bracket = index(name, "(")
      if (bracket == 0) bracket = len_trim(name) + 1
      call structure%find_dof(trim(adjustl(name(:bracket - 1))), self%dof, error)
      if (allocated(error) .or. bracket > len_trim(name)) return
      status = 1
      if (index(name, ")") == len_trim(name) .and. count_of(",", name) == size(tuple) - 1) &
         read (name(bracket + 1:len_trim(name) - 1), *, iostat=status) tuple
      if (status /= 0) then
         call fail(error, "'"//name//"' is not a response; give a degree of freedom, or one with "// &
            number_of(size(tuple), "integer")//" in brackets, such as 'x1 ("//repeat("1,", size(tuple) - 1)//"1)'")
         return
      end if
      self%tuple = tuple
   end subroutine new_response

   pure integer function count_of(letter, text) result(n)
      character, intent(in) :: letter
      character(*), intent(in) :: text
      integer :: i

      n = count([(text(i:i) == letter, i=1, len(text))])
   end function count_of

   !> Whether a set contains its harmonic.
   pure logical function response_is_in(self, harmonics) result(is_in)
      class(response_t), intent(in) :: self
      type(harmonics_t), intent(in) :: harmonics

      is_in = .true.
      if (allocated(self%tuple)) is_in = harmonics%index_of(self%tuple) > 0
   end function response_is_in

   !> Its square, from the amplitudes of its degree of freedom.
   pure real(wp) function response_of(self, harmonics, amplitudes) result(square)
      class(response_t), intent(in) :: self
      type(harmonics_t), intent(in) :: harmonics
      complex(wp), intent(in) :: amplitudes(:)                        !! (n_harmonics)

      associate (numbers => self%numbers_in(harmonics))
         square = sum(abs(amplitudes(numbers))**2)
      end associate
      if (.not. allocated(self%tuple)) square = 0.5_wp*square
   end function response_of

   !> Derivative of its square, from the amplitudes of its degree of freedom and their derivatives.
   pure real(wp) function response_slope_of(self, harmonics, amplitudes, slopes) result(slope)
      class(response_t), intent(in) :: self
      type(harmonics_t), intent(in) :: harmonics
      complex(wp), intent(in) :: amplitudes(:), slopes(:)             !! (n_harmonics)

      associate (numbers => self%numbers_in(harmonics))
         slope = sum(real(conjg(amplitudes(numbers))*slopes(numbers)))
      end associate
      if (allocated(self%tuple)) slope = 2.0_wp*slope
   end function response_slope_of

   !> The differential of the response itself, Re(sum of conj(weights) dx); not allocated if it is zero, where it has none.
   pure subroutine response_find_weights(self, harmonics, amplitudes, weights)
      class(response_t), intent(in) :: self
      type(harmonics_t), intent(in) :: harmonics
      complex(wp), intent(in) :: amplitudes(:)                        !! of its degree of freedom, (n_harmonics)
      complex(wp), allocatable, intent(out) :: weights(:)             !! as amplitudes
      real(wp) :: square

      square = self%of(harmonics, amplitudes)
      if (.not. square > 0.0_wp) return
      allocate (weights(size(amplitudes)), source=(0.0_wp, 0.0_wp))
      associate (numbers => self%numbers_in(harmonics))
         weights(numbers) = amplitudes(numbers)*merge(1.0_wp, 0.5_wp, allocated(self%tuple))/sqrt(square)
      end associate
   end subroutine response_find_weights

   !> Numbers of the harmonics of a set of which it consists.
   pure function response_numbers_in(self, harmonics) result(numbers)
      class(response_t), intent(in) :: self
      type(harmonics_t), intent(in) :: harmonics
      integer, allocatable :: numbers(:)
      integer :: h

      if (allocated(self%tuple)) then
         numbers = [harmonics%index_of(self%tuple)]
         numbers = pack(numbers, numbers > 0)
      else
         numbers = [(h, h=merge(2, 1, harmonics%has_zero), harmonics%n_harmonics)]
      end if
   end function response_numbers_in

   !> Distance of two motions of its degree of freedom in its harmonics, relative to the second, including phases: 1
   !> if the first has none of them, 0 if neither has. Amplitudes at the level of rounding are not used as a unit.
   pure real(wp) function response_distance(self, set, amplitudes, set_of_second, second) result(distance)
      class(response_t), intent(in) :: self
      type(harmonics_t), intent(in) :: set, set_of_second
      complex(wp), intent(in) :: amplitudes(:), second(:)             !! (n_harmonics of each)
      complex(wp) :: difference(size(second))
      real(wp) :: beyond, reference
      integer :: h, k

      difference = second
      beyond = 0.0_wp
      do h = 1, set%n_harmonics
         k = set_of_second%index_of(set%tuples(:, h))
         if (k > 0) then
            difference(k) = difference(k) - amplitudes(h)
         else if (.not. allocated(self%tuple)) then
            if (any(set%tuples(:, h) /= 0)) beyond = beyond + 0.5_wp*abs(amplitudes(h))**2
         end if
      end do
      reference = max(sqrt(self%of(set_of_second, second)), rounding_level*norm2(abs(second)), tiny(1.0_wp))
      distance = sqrt(self%of(set_of_second, difference) + beyond)/reference
   end function response_distance
end module hb_response
