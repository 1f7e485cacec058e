!> A response: the amplitude of one degree of freedom, as a number that can have maxima along a curve.
module hb_response
   use hb_error, only: error_t, fail
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: wp
   use hb_scene, only: scene_t
   use hb_text, only: to_text
   implicit none
   private
   public :: new_response, response_t

   type :: response_t
      integer :: dof = 0                                              !! of the structure
      integer :: column = 0                                           !! number of the coordinate that is dof; 0: none is
      integer, allocatable :: tuple(:)                                !! of a harmonic; none: root mean square of all but the mean
   contains
      procedure :: of => response_of
   end type response_t

contains

   !> Response of a name: `v3` for all that oscillates there, `v3 (1,0)` for one harmonic. Fails where the scene has no such thing.
   subroutine new_response(self, name, scene, error)
      type(response_t), intent(out) :: self
      character(*), intent(in) :: name
      type(scene_t), intent(in) :: scene
      type(error_t), allocatable, intent(out) :: error
      integer :: bracket, status, tuple(scene%tones%n_tones)

      bracket = index(name, "(")
      if (bracket == 0) bracket = len_trim(name) + 1
      call scene%structure%find_dof(trim(adjustl(name(:bracket - 1))), self%dof, error)
      if (allocated(error) .or. bracket > len_trim(name)) return
      status = 1
      if (index(name, ")") == len_trim(name) .and. count_of(",", name) == size(tuple) - 1) &
         read (name(bracket + 1:len_trim(name) - 1), *, iostat=status) tuple
      if (status /= 0) then
         call fail(error, "'"//name//"' is no response; give a degree of freedom, or one with "//to_text(size(tuple))// &
            " integers in brackets, such as 'x1 ("//repeat("1,", size(tuple) - 1)//"1)'")
         return
      end if
      self%tuple = tuple
      if (scene%harmonics%index_of(tuple) == 0 .and. .not. scene%accuracy%grows_set) &
         call fail(error, "'"//name//"': the set of harmonics does not have this tuple")
   end subroutine new_response

   pure integer function count_of(letter, text) result(n)
      character, intent(in) :: letter
      character(*), intent(in) :: text
      integer :: i

      n = count([(text(i:i) == letter, i=1, len(text))])
   end function count_of

   !> Its square, from the amplitudes of its degree of freedom.
   pure real(wp) function response_of(self, harmonics, amplitudes) result(square)
      class(response_t), intent(in) :: self
      type(harmonics_t), intent(in) :: harmonics
      complex(wp), intent(in) :: amplitudes(:)                        !! (n_harmonics)
      integer :: h

      if (allocated(self%tuple)) then
         h = harmonics%index_of(self%tuple)
         square = 0.0_wp
         if (h > 0) square = abs(amplitudes(h))**2
      else
         square = 0.5_wp*sum([(abs(amplitudes(h))**2, h=merge(2, 1, harmonics%has_zero), harmonics%n_harmonics)])
      end if
   end function response_of
end module hb_response
