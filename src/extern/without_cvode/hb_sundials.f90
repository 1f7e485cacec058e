!> In the place of CVODE where the library is built without SUNDIALS (HB_CVODE=OFF): whoever needs it gets an error.
module hb_sundials
   use hb_error, only: error_t, fail
   use hb_kinds, only: wp
   use hb_ode, only: ode_t
   implicit none
   private
   public :: cvode_t, has_cvode, new_cvode

   logical, parameter :: has_cvode = .false.                          !! of this build

   type :: cvode_t
      real(wp), pointer, contiguous :: values(:) => null()
   contains
      procedure :: restart => cvode_restart
      procedure :: advance => cvode_advance
      procedure :: destroy => cvode_destroy
   end type cvode_t

contains

   !> Fails.
   subroutine new_cvode(self, ode, n, directions, is_stiff, error)
      type(cvode_t), intent(out) :: self
      class(ode_t), intent(in), target :: ode
      integer, intent(in) :: n
      integer, intent(in) :: directions(:)
      logical, intent(in) :: is_stiff
      type(error_t), allocatable, intent(out) :: error

      call refuse(error)
   end subroutine new_cvode

   !> Fails.
   subroutine cvode_restart(self, t, error)
      class(cvode_t), intent(inout) :: self
      real(wp), intent(in) :: t
      type(error_t), allocatable, intent(out) :: error

      call refuse(error)
   end subroutine cvode_restart

   !> Fails.
   subroutine cvode_advance(self, t_end, t, is_event, found, error)
      class(cvode_t), intent(inout) :: self
      real(wp), intent(in) :: t_end
      real(wp), intent(out) :: t
      logical, intent(out) :: is_event
      integer, intent(out) :: found(:)
      type(error_t), allocatable, intent(out) :: error

      t = 0.0_wp
      is_event = .false.
      found = 0
      call refuse(error)
   end subroutine cvode_advance

   !> There is nothing to free.
   subroutine cvode_destroy(self)
      class(cvode_t), intent(inout) :: self

      nullify (self%values)
   end subroutine cvode_destroy

   subroutine refuse(error)
      type(error_t), allocatable, intent(out) :: error

      call fail(error, "this library was built without SUNDIALS and has no 'cvode'; the other methods of &integration need none")
   end subroutine refuse
end module hb_sundials
