!> CVODE of SUNDIALS behind one type: ordinary differential equations by multistep methods of variable order and step, with
!> location of events. The only module that calls SUNDIALS.
!>
!> In the order of use: extend `hb_ode%ode_t`, `new_cvode`, `restart` (also after each event), `advance` any number of
!> times, `destroy`. Source: A. C. Hindmarsh et al., SUNDIALS: Suite of nonlinear and differential/algebraic equation
!> solvers, ACM Trans. Math. Software 31 (2005) 363-396; user documentation for CVODE 6.4.
module hb_sundials
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use, intrinsic :: iso_c_binding, only: c_associated, c_double, c_f_pointer, c_funloc, c_funptr, c_int, c_int64_t, &
      c_loc, c_long, c_null_ptr, c_ptr
   use hb_c_text, only: c_text
   use hb_cancellation, only: work_is_over
   use hb_error, only: error_t, fail
   use hb_kinds, only: wp
   use hb_ode, only: ode_t
   use hb_text, only: to_text
   implicit none
   private
   public :: cvode_t, has_cvode, new_cvode

   logical, parameter :: has_cvode = .true.                           !! in this build

   integer(c_int), parameter :: adams = 1, backward_differences = 2   ! CV_ADAMS, CV_BDF
   integer(c_int), parameter :: to_given_time = 1                     ! CV_NORMAL
   integer(c_int), parameter :: root_found = 2                        ! CV_ROOT_RETURN
   integer(c_int), parameter :: warning = 99                          ! CV_WARNING
   integer(c_int), parameter :: recoverable = 1, unrecoverable = -1   ! of a right-hand side: any > 0, any < 0
   integer, parameter :: looks_between = 32                           ! evaluations between two checks of the cancellation

   !> Data of the callbacks.
   type :: handle_t
      class(ode_t), pointer :: ode => null()
      integer :: n = 0, n_events = 0
      logical :: is_stuck = .false.                                   ! steps no longer change the time
      integer :: n_rhs = 0                                            ! evaluations so far, modulo the range of integers
      character(:), allocatable :: message                            ! the last message of the library
   end type handle_t

   type :: cvode_t
      private
      type(handle_t), pointer :: handle => null()
      type(c_ptr) :: context = c_null_ptr, memory = c_null_ptr, y = c_null_ptr
      type(c_ptr) :: nonlinear_solver = c_null_ptr, linear_solver = c_null_ptr, matrix = c_null_ptr
      real(wp), pointer, contiguous, public :: values(:) => null()    !! y at the present time; may be changed before `restart`
   contains
      procedure :: restart => cvode_restart
      procedure :: advance => cvode_advance
      procedure :: destroy => cvode_destroy
   end type cvode_t

   interface
      integer(c_int) function SUNContext_Create(comm, context) bind(c, name="SUNContext_Create")
         import :: c_int, c_ptr
         type(c_ptr), value :: comm
         type(c_ptr), intent(out) :: context
      end function SUNContext_Create

      integer(c_int) function SUNContext_Free(context) bind(c, name="SUNContext_Free")
         import :: c_int, c_ptr
         type(c_ptr), intent(inout) :: context
      end function SUNContext_Free

      type(c_ptr) function N_VNew_Serial(length, context) bind(c, name="N_VNew_Serial")
         import :: c_int64_t, c_ptr
         integer(c_int64_t), value :: length
         type(c_ptr), value :: context
      end function N_VNew_Serial

      type(c_ptr) function N_VGetArrayPointer(v) bind(c, name="N_VGetArrayPointer")
         import :: c_ptr
         type(c_ptr), value :: v
      end function N_VGetArrayPointer

      subroutine N_VDestroy(v) bind(c, name="N_VDestroy")
         import :: c_ptr
         type(c_ptr), value :: v
      end subroutine N_VDestroy

      type(c_ptr) function SUNDenseMatrix(m, n, context) bind(c, name="SUNDenseMatrix")
         import :: c_int64_t, c_ptr
         integer(c_int64_t), value :: m, n
         type(c_ptr), value :: context
      end function SUNDenseMatrix

      subroutine SUNMatDestroy(a) bind(c, name="SUNMatDestroy")
         import :: c_ptr
         type(c_ptr), value :: a
      end subroutine SUNMatDestroy

      type(c_ptr) function SUNLinSol_Dense(y, a, context) bind(c, name="SUNLinSol_Dense")
         import :: c_ptr
         type(c_ptr), value :: y, a, context
      end function SUNLinSol_Dense

      integer(c_int) function SUNLinSolFree(solver) bind(c, name="SUNLinSolFree")
         import :: c_int, c_ptr
         type(c_ptr), value :: solver
      end function SUNLinSolFree

      type(c_ptr) function SUNNonlinSol_FixedPoint(y, m, context) bind(c, name="SUNNonlinSol_FixedPoint")
         import :: c_int, c_ptr
         type(c_ptr), value :: y
         integer(c_int), value :: m
         type(c_ptr), value :: context
      end function SUNNonlinSol_FixedPoint

      integer(c_int) function SUNNonlinSolFree(solver) bind(c, name="SUNNonlinSolFree")
         import :: c_int, c_ptr
         type(c_ptr), value :: solver
      end function SUNNonlinSolFree

      type(c_ptr) function CVodeCreate(method, context) bind(c, name="CVodeCreate")
         import :: c_int, c_ptr
         integer(c_int), value :: method
         type(c_ptr), value :: context
      end function CVodeCreate

      integer(c_int) function CVodeInit(memory, rhs, t0, y0) bind(c, name="CVodeInit")
         import :: c_double, c_funptr, c_int, c_ptr
         type(c_ptr), value :: memory
         type(c_funptr), value :: rhs
         real(c_double), value :: t0
         type(c_ptr), value :: y0
      end function CVodeInit

      integer(c_int) function CVodeReInit(memory, t0, y0) bind(c, name="CVodeReInit")
         import :: c_double, c_int, c_ptr
         type(c_ptr), value :: memory
         real(c_double), value :: t0
         type(c_ptr), value :: y0
      end function CVodeReInit

      integer(c_int) function CVodeWFtolerances(memory, weights) bind(c, name="CVodeWFtolerances")
         import :: c_funptr, c_int, c_ptr
         type(c_ptr), value :: memory
         type(c_funptr), value :: weights
      end function CVodeWFtolerances

      integer(c_int) function CVodeSetUserData(memory, data) bind(c, name="CVodeSetUserData")
         import :: c_int, c_ptr
         type(c_ptr), value :: memory, data
      end function CVodeSetUserData

      integer(c_int) function CVodeSetErrHandlerFn(memory, handler, data) bind(c, name="CVodeSetErrHandlerFn")
         import :: c_funptr, c_int, c_ptr
         type(c_ptr), value :: memory
         type(c_funptr), value :: handler
         type(c_ptr), value :: data
      end function CVodeSetErrHandlerFn

      integer(c_int) function CVodeSetMaxNumSteps(memory, n) bind(c, name="CVodeSetMaxNumSteps")
         import :: c_int, c_long, c_ptr
         type(c_ptr), value :: memory
         integer(c_long), value :: n
      end function CVodeSetMaxNumSteps

      integer(c_int) function CVodeSetLinearSolver(memory, solver, a) bind(c, name="CVodeSetLinearSolver")
         import :: c_int, c_ptr
         type(c_ptr), value :: memory, solver, a
      end function CVodeSetLinearSolver

      integer(c_int) function CVodeSetNonlinearSolver(memory, solver) bind(c, name="CVodeSetNonlinearSolver")
         import :: c_int, c_ptr
         type(c_ptr), value :: memory, solver
      end function CVodeSetNonlinearSolver

      integer(c_int) function CVodeRootInit(memory, n, events) bind(c, name="CVodeRootInit")
         import :: c_funptr, c_int, c_ptr
         type(c_ptr), value :: memory
         integer(c_int), value :: n
         type(c_funptr), value :: events
      end function CVodeRootInit

      integer(c_int) function CVodeSetRootDirection(memory, direction) bind(c, name="CVodeSetRootDirection")
         import :: c_int, c_ptr
         type(c_ptr), value :: memory
         integer(c_int), intent(in) :: direction(*)
      end function CVodeSetRootDirection

      integer(c_int) function CVodeSetNoInactiveRootWarn(memory) bind(c, name="CVodeSetNoInactiveRootWarn")
         import :: c_int, c_ptr
         type(c_ptr), value :: memory
      end function CVodeSetNoInactiveRootWarn

      integer(c_int) function CVode(memory, t_out, y, t, task) bind(c, name="CVode")
         import :: c_double, c_int, c_ptr
         type(c_ptr), value :: memory
         real(c_double), value :: t_out
         type(c_ptr), value :: y
         real(c_double), intent(inout) :: t
         integer(c_int), value :: task
      end function CVode

      integer(c_int) function CVodeGetRootInfo(memory, found) bind(c, name="CVodeGetRootInfo")
         import :: c_int, c_ptr
         type(c_ptr), value :: memory
         integer(c_int), intent(out) :: found(*)
      end function CVodeGetRootInfo

      subroutine CVodeFree(memory) bind(c, name="CVodeFree")
         import :: c_ptr
         type(c_ptr), intent(inout) :: memory
      end subroutine CVodeFree
   end interface

contains

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

      allocate (self%handle)
      self%handle%ode => ode
      self%handle%n = n
      self%handle%n_events = size(directions)
      self%handle%message = ""
      flag = SUNContext_Create(c_null_ptr, self%context)
      if (flag == 0) self%y = N_VNew_Serial(int(n, c_int64_t), self%context)
      if (c_associated(self%y)) then
         call c_f_pointer(N_VGetArrayPointer(self%y), self%values, [n])
         self%values = 0.0_wp
         self%memory = CVodeCreate(merge(backward_differences, adams, is_stiff), self%context)
      end if
      if (.not. c_associated(self%memory)) then
         call fail(error, "cvode: out of memory")
         return
      end if
      flag = CVodeSetErrHandlerFn(self%memory, c_funloc(keep_message), c_loc(self%handle))
      if (flag == 0) flag = CVodeInit(self%memory, c_funloc(call_rhs), 0.0_c_double, self%y)
      if (flag == 0) flag = CVodeSetUserData(self%memory, c_loc(self%handle))
      if (flag == 0) flag = CVodeWFtolerances(self%memory, c_funloc(call_weights))
      if (flag == 0) flag = CVodeSetMaxNumSteps(self%memory, huge(1_c_long))
      if (is_stiff) then
         self%matrix = SUNDenseMatrix(int(n, c_int64_t), int(n, c_int64_t), self%context)
         if (c_associated(self%matrix)) self%linear_solver = SUNLinSol_Dense(self%y, self%matrix, self%context)
         if (flag == 0) flag = CVodeSetLinearSolver(self%memory, self%linear_solver, self%matrix)
      else
         self%nonlinear_solver = SUNNonlinSol_FixedPoint(self%y, 0_c_int, self%context)
         if (flag == 0) flag = CVodeSetNonlinearSolver(self%memory, self%nonlinear_solver)
      end if
      if (flag == 0) flag = CVodeSetNoInactiveRootWarn(self%memory)
      if (flag == 0 .and. size(directions) > 0) then
         flag = CVodeRootInit(self%memory, int(size(directions), c_int), c_funloc(call_events))
         if (flag == 0) flag = CVodeSetRootDirection(self%memory, int(directions, c_int))
      end if
      if (flag /= 0) call fail(error, "cvode: "//self%handle%message)
   end subroutine new_cvode

   !> Restarts from `values` at time t; discards the history.
   subroutine cvode_restart(self, t, error)
      class(cvode_t), intent(inout) :: self
      real(wp), intent(in) :: t
      type(error_t), allocatable, intent(out) :: error

      self%handle%is_stuck = .false.
      if (CVodeReInit(self%memory, t, self%y) /= 0) call fail(error, "cvode: "//self%handle%message)
   end subroutine cvode_restart

   !> Integrates to `t_end`, or to an event before it.
   subroutine cvode_advance(self, t_end, t, is_event, found, error)
      class(cvode_t), intent(inout) :: self
      real(wp), intent(in) :: t_end
      real(wp), intent(out) :: t                                      !! where `values` hold
      logical, intent(out) :: is_event
      integer, intent(out) :: found(:)                                !! of each event: 0 no, 1 rising, -1 falling
      type(error_t), allocatable, intent(out) :: error
      integer(c_int) :: flag, found_c(size(found))

      found = 0
      t = 0.0_wp
      flag = CVode(self%memory, t_end, self%y, t, to_given_time)
      is_event = flag == root_found
      if (flag < 0 .and. self%handle%is_stuck) then
         call fail(error, "cvode at t = "//to_text(t)//": steps are as small as rounding of the time, "// &
                   "as before a force without bound")
      else if (flag < 0) then
         call fail(error, "cvode at t = "//to_text(t)//": "//self%handle%message)
      else if (is_event) then
         flag = CVodeGetRootInfo(self%memory, found_c)
         found = found_c
      end if
   end subroutine cvode_advance

   !> Frees everything; safe to call twice.
   subroutine cvode_destroy(self)
      class(cvode_t), intent(inout) :: self
      integer(c_int) :: flag

      if (c_associated(self%memory)) call CVodeFree(self%memory)
      if (c_associated(self%linear_solver)) flag = SUNLinSolFree(self%linear_solver)
      if (c_associated(self%nonlinear_solver)) flag = SUNNonlinSolFree(self%nonlinear_solver)
      if (c_associated(self%matrix)) call SUNMatDestroy(self%matrix)
      if (c_associated(self%y)) call N_VDestroy(self%y)
      if (c_associated(self%context)) flag = SUNContext_Free(self%context)
      self%memory = c_null_ptr
      self%linear_solver = c_null_ptr
      self%nonlinear_solver = c_null_ptr
      self%matrix = c_null_ptr
      self%y = c_null_ptr
      self%context = c_null_ptr
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
      call c_f_pointer(N_VGetArrayPointer(y), y_values, [handle%n])
      call c_f_pointer(N_VGetArrayPointer(dydt), dydt_values, [handle%n])
      call handle%ode%rhs(t, y_values, dydt_values)
      call_rhs = 0
      if (.not. all(ieee_is_finite(dydt_values))) call_rhs = recoverable
      if (handle%is_stuck .or. handle%ode%is_over) call_rhs = unrecoverable
      handle%n_rhs = handle%n_rhs + 1
      if (modulo(handle%n_rhs, looks_between) > 0) return
      if (work_is_over()) call_rhs = unrecoverable
   end function call_rhs

   integer(c_int) function call_events(t, y, g, data) bind(c)
      real(c_double), value :: t
      type(c_ptr), value :: y, g, data
      type(handle_t), pointer :: handle
      real(wp), pointer, contiguous :: y_values(:), g_values(:)

      call c_f_pointer(data, handle)
      call c_f_pointer(N_VGetArrayPointer(y), y_values, [handle%n])
      call c_f_pointer(g, g_values, [handle%n_events])
      call handle%ode%events(t, y_values, g_values)
      call_events = 0
   end function call_events

   integer(c_int) function call_weights(y, w, data) bind(c)
      type(c_ptr), value :: y, w, data
      type(handle_t), pointer :: handle
      real(wp), pointer, contiguous :: w_values(:), y_values(:)

      call c_f_pointer(data, handle)
      call c_f_pointer(N_VGetArrayPointer(y), y_values, [handle%n])
      call c_f_pointer(N_VGetArrayPointer(w), w_values, [handle%n])
      call handle%ode%weights(y_values, w_values)
      call_weights = 0
   end function call_weights

   subroutine keep_message(code, module_name, function_name, message, data) bind(c)
      integer(c_int), value :: code
      type(c_ptr), value :: module_name, function_name, message, data
      type(handle_t), pointer :: handle

      call c_f_pointer(data, handle)
      handle%message = c_text(message)
      handle%is_stuck = handle%is_stuck .or. code == warning          ! t + h = t; other warnings are disabled
   end subroutine keep_message
end module hb_sundials
