!> CVODE of SUNDIALS behind one type: ordinary differential equations by multistep methods of variable order and step, with
!> location of events. The only module that calls SUNDIALS, by hb_cvode.h.
!>
!> In the order of use: extend `ode_t`, `new_cvode`, `restart` (also after each event), `advance` any number of
!> times, `destroy`. Source: A. C. Hindmarsh et al., SUNDIALS: Suite of nonlinear and differential/algebraic equation
!> solvers, ACM Trans. Math. Software 31 (2005) 363-396; user documentation for CVODE 6.4 and 7.1.
module hb_sundials
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use, intrinsic :: iso_c_binding, only: c_associated, c_double, c_f_pointer, c_funloc, c_funptr, c_int, c_loc, c_null_ptr, c_ptr
   use hb_c_text, only: c_text
   use hb_cancellation, only: work_is_over
   use hb_error, only: error_t, fail
   use hb_kinds, only: wp
   use hb_text, only: to_text
   implicit none
   private
   public :: cvode_t, has_cvode, new_cvode, ode_t

   integer(c_int), parameter :: recoverable = 1, unrecoverable = -1   ! of a right-hand side: any > 0, any < 0
   integer, parameter :: evaluations_between = 32                     ! evaluations between two checks of the cancellation

   !> Equations y' = rhs(t, y) with event functions.
   type, abstract :: ode_t
      logical :: is_over = .false.                                    !! set by `rhs` to end the integration
   contains
      procedure(rhs_of_ode), deferred :: rhs
      procedure(events_of_ode), deferred :: events
      procedure(weights_of_ode), deferred :: weights
   end type ode_t

   abstract interface
      subroutine rhs_of_ode(self, t, y, dydt)
         import :: ode_t, wp
         class(ode_t), intent(inout) :: self
         real(wp), intent(in) :: t
         real(wp), intent(in), contiguous :: y(:)
         real(wp), intent(out), contiguous :: dydt(:)
      end subroutine rhs_of_ode

      !> Functions whose zeros stop the integration.
      subroutine events_of_ode(self, t, y, g)
         import :: ode_t, wp
         class(ode_t), intent(inout) :: self
         real(wp), intent(in) :: t
         real(wp), intent(in), contiguous :: y(:)
         real(wp), intent(out), contiguous :: g(:)
      end subroutine events_of_ode

      !> Weights w of the error norm: |w(i) error(i)| = 1 is just tolerable.
      subroutine weights_of_ode(self, y, w)
         import :: ode_t, wp
         class(ode_t), intent(inout) :: self
         real(wp), intent(in), contiguous :: y(:)
         real(wp), intent(out), contiguous :: w(:)
      end subroutine weights_of_ode
   end interface

   !> Data of the callbacks.
   type :: handle_t
      class(ode_t), pointer :: ode => null()
      integer :: n = 0, n_events = 0
      logical :: is_stuck = .false.                                   ! steps no longer change the time
      logical :: has_ended = .false.                                  ! the work was over at an evaluation
      integer :: n_rhs = 0                                            ! evaluations so far, modulo the range of integers
      character(:), allocatable :: message                            ! the last message of the library
   end type handle_t

   type :: cvode_t
      private
      type(handle_t), pointer :: handle => null()
      type(c_ptr) :: integrator = c_null_ptr
      real(wp), pointer, contiguous, public :: values(:) => null()    !! y at the present time; may be changed before `restart`
   contains
      procedure :: restart => cvode_restart
      procedure :: advance => cvode_advance
      procedure :: is_at_pole => cvode_is_at_pole
      procedure :: destroy => cvode_destroy
   end type cvode_t

   !> hb_cvode_problem_t
   type, bind(c) :: problem_t
      type(c_funptr) :: rhs, events, weights, report
      type(c_ptr) :: data
      integer(c_int) :: n, n_events, is_stiff
   end type problem_t

   interface
      pure integer(c_int) function hb_has_cvode() bind(c)
         import :: c_int
      end function hb_has_cvode

      type(c_ptr) function hb_cvode_new(problem, directions, y, flag) bind(c)
         import :: c_int, c_ptr, problem_t
         type(problem_t), intent(in) :: problem
         integer(c_int), intent(in) :: directions(*)
         type(c_ptr), intent(out) :: y
         integer(c_int), intent(out) :: flag
      end function hb_cvode_new

      integer(c_int) function hb_cvode_restart(integrator, t) bind(c)
         import :: c_double, c_int, c_ptr
         type(c_ptr), value :: integrator
         real(c_double), value :: t
      end function hb_cvode_restart

      integer(c_int) function hb_cvode_advance(integrator, t_end, t, found) bind(c)
         import :: c_double, c_int, c_ptr
         type(c_ptr), value :: integrator
         real(c_double), value :: t_end
         real(c_double), intent(inout) :: t
         integer(c_int), intent(inout) :: found(*)
      end function hb_cvode_advance

      subroutine hb_cvode_delete(integrator) bind(c)
         import :: c_ptr
         type(c_ptr), value :: integrator
      end subroutine hb_cvode_delete
   end interface

contains

   !> Whether this build contains CVODE; without SUNDIALS (HB_CVODE=OFF) `new_cvode` fails.
   pure logical function has_cvode()
      has_cvode = hb_has_cvode() /= 0
   end function has_cvode

   !> Creates an integrator of `n` equations: Adams methods with functional iteration, or backward differences with a
   !> dense Jacobian.
   subroutine new_cvode(self, ode, n, directions, is_stiff, error)
      type(cvode_t), intent(out) :: self
      class(ode_t), intent(in), target :: ode                         !! owned by the caller, who may change it between calls
      integer, intent(in) :: n                                        !! equations, >= 1
      integer, intent(in) :: directions(:)                            !! of each event: -1 falling, 1 rising, 0 both
      logical, intent(in) :: is_stiff
      type(error_t), allocatable, intent(out) :: error
      integer(c_int) :: flag
      type(c_ptr) :: y

      if (.not. has_cvode()) then
         call fail(error, "this library was built without SUNDIALS and has no 'cvode'; other integration methods need none")
         return
      end if
      allocate (self%handle)
      self%handle%ode => ode
      self%handle%n = n
      self%handle%n_events = size(directions)
      self%handle%message = ""
      self%integrator = hb_cvode_new(problem_t(c_funloc(call_rhs), c_funloc(call_events), c_funloc(call_weights), &
                                     c_funloc(store_message), c_loc(self%handle), int(n, c_int), size(directions, kind=c_int), &
                                     merge(1_c_int, 0_c_int, is_stiff)), int(directions, c_int), y, flag)
      if (.not. c_associated(self%integrator)) then
         call fail(error, "cvode: out of memory")
         return
      end if
      call c_f_pointer(y, self%values, [n])
      if (flag /= 0) call fail(error, "cvode: "//self%handle%message)
   end subroutine new_cvode

   !> Restarts from `values` at time t; discards the history.
   subroutine cvode_restart(self, t, error)
      class(cvode_t), intent(inout) :: self
      real(wp), intent(in) :: t
      type(error_t), allocatable, intent(out) :: error

      self%handle%is_stuck = .false.
      self%handle%has_ended = .false.
      if (hb_cvode_restart(self%integrator, t) /= 0) call fail(error, "cvode: "//self%handle%message)
   end subroutine cvode_restart

   !> Integrates to `t_end`, or to an event before it.
   subroutine cvode_advance(self, t_end, t, is_event, found, error, origin)
      class(cvode_t), intent(inout) :: self
      real(wp), intent(in) :: t_end                                   !! [s] from the origin, as `t`
      real(wp), intent(out) :: t                                      !! where `values` hold
      logical, intent(out) :: is_event
      integer, intent(out) :: found(:)                                !! of each event: 0 no, 1 rising, -1 falling
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: origin                        !! [s], for messages; 0 if not given
      integer(c_int) :: flag, found_c(size(found))
      real(wp) :: time

      found_c = 0
      t = 0.0_wp
      flag = hb_cvode_advance(self%integrator, t_end, t, found_c)
      found = found_c
      is_event = flag > 0
      time = t
      if (present(origin)) time = origin + t
      if (flag < 0 .and. self%handle%is_stuck) then
         call fail(error, "cvode at t = "//to_text(time)//" s: the steps become as small as rounding; the force "// &
                   "becomes infinite there (pull-in, contact with a singularity?)")
      else if (flag < 0) then
         call fail(error, "cvode at t = "//to_text(time)//" s: "//self%handle%message)
      end if
   end subroutine cvode_advance

   !> Whether the integration has ended where the derivatives become infinite.
   logical function cvode_is_at_pole(self) result(is_at_pole)
      class(cvode_t), intent(in) :: self

      is_at_pole = self%handle%is_stuck
   end function cvode_is_at_pole

   !> Frees everything; safe to call twice.
   subroutine cvode_destroy(self)
      class(cvode_t), intent(inout) :: self

      call hb_cvode_delete(self%integrator)
      self%integrator = c_null_ptr
      if (associated(self%handle)) deallocate (self%handle)
      nullify (self%values)
   end subroutine cvode_destroy

   ! Callbacks of CVODE

   integer(c_int) function call_rhs(t, y, dydt, data) bind(c)
      real(c_double), value :: t
      type(c_ptr), value :: y, dydt, data
      type(handle_t), pointer :: handle
      real(wp), pointer, contiguous :: y_values(:), dydt_values(:)

      call c_f_pointer(data, handle)
      call c_f_pointer(y, y_values, [handle%n])
      call c_f_pointer(dydt, dydt_values, [handle%n])
      call handle%ode%rhs(t, y_values, dydt_values)
      call_rhs = 0
      if (.not. all(ieee_is_finite(dydt_values))) call_rhs = recoverable
      handle%n_rhs = handle%n_rhs + 1
      if (modulo(handle%n_rhs, evaluations_between) == 0) handle%has_ended = work_is_over()
      ! at each evaluation from here on: the fixed-point iteration repeats a step that fails once, whatever is returned
      if (handle%is_stuck .or. handle%has_ended .or. handle%ode%is_over) call_rhs = unrecoverable
   end function call_rhs

   integer(c_int) function call_events(t, y, g, data) bind(c)
      real(c_double), value :: t
      type(c_ptr), value :: y, g, data
      type(handle_t), pointer :: handle
      real(wp), pointer, contiguous :: y_values(:), g_values(:)

      call c_f_pointer(data, handle)
      call c_f_pointer(y, y_values, [handle%n])
      call c_f_pointer(g, g_values, [handle%n_events])
      call handle%ode%events(t, y_values, g_values)
      call_events = 0
   end function call_events

   integer(c_int) function call_weights(t, y, w, data) bind(c)
      real(c_double), value :: t
      type(c_ptr), value :: y, w, data
      type(handle_t), pointer :: handle
      real(wp), pointer, contiguous :: w_values(:), y_values(:)

      call c_f_pointer(data, handle)
      call c_f_pointer(y, y_values, [handle%n])
      call c_f_pointer(w, w_values, [handle%n])
      call handle%ode%weights(y_values, w_values)
      call_weights = 0
   end function call_weights

   subroutine store_message(message, is_warning, data) bind(c)
      type(c_ptr), value :: message
      integer(c_int), value :: is_warning
      type(c_ptr), value :: data
      type(handle_t), pointer :: handle

      call c_f_pointer(data, handle)
      handle%message = c_text(message)
      handle%is_stuck = handle%is_stuck .or. is_warning /= 0          ! t + h = t; other warnings are disabled
   end subroutine store_message
end module hb_sundials
