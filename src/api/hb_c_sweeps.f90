!> The functions of nhbm.h for sweeps. The header documents them.
module hb_c_sweeps
   use, intrinsic :: iso_c_binding, only: c_associated, c_double, c_f_pointer, c_int, c_ptr, c_size_t
   use hb_c_handles, only: c_status
   use hb_c_model, only: begin_call, end_call, handle_t
   use hb_error, only: error_t, fail
   use hb_kinds, only: wp
   implicit none
   private

   character(*), parameter :: not_begun = "there is no sweep; nhbm_sweep_begin begins one, and setting a value or another "// &
                                          "computation ends it"

   !> struct nhbm_sweep.
   type, bind(c) :: c_sweep_t
      integer(c_size_t) :: n_points, n_chains
   end type c_sweep_t

contains

   integer(c_int) function nhbm_sweep_begin(model, sweep) bind(c, name="nhbm_sweep_begin") result(status)
      type(c_ptr), value :: model, sweep
      type(handle_t), pointer :: handle
      type(c_sweep_t), pointer :: begun
      type(error_t), allocatable :: error

      nullify (begun)
      if (c_associated(sweep)) then
         call c_f_pointer(sweep, begun)
         begun = c_sweep_t(0_c_size_t, 0_c_size_t)
      end if
      status = begin_call(model, "nhbm_sweep_begin", handle, texts=[sweep], needs_input=.true.)
      if (status /= c_status%success) return
      call handle%session%sweep_begin(error)
      if (.not. allocated(error)) &
         begun = c_sweep_t(int(handle%session%source%plan%n_points, c_size_t), int(handle%session%sweep%n_units, c_size_t))
      status = end_call(model, error, c_status%invalid_input)
   end function nhbm_sweep_begin

   integer(c_int) function nhbm_sweep_select(model, first, n) bind(c, name="nhbm_sweep_select") result(status)
      type(c_ptr), value :: model
      integer(c_size_t), value :: first, n
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error
      integer(c_size_t) :: n_units

      status = begin_call(model, "nhbm_sweep_select", handle, needs_input=.true.)
      if (status /= c_status%success) return
      status = c_status%invalid_state
      n_units = int(handle%session%sweep%n_units, c_size_t)
      if (.not. handle%session%sweep%is_begun) then
         call fail(error, "nhbm_sweep_select: "//not_begun)
      else if (first < 0_c_size_t .or. n < 0_c_size_t .or. first > n_units .or. n > n_units - min(first, n_units)) then
         status = c_status%invalid_argument
         call fail(error, "nhbm_sweep_select: the sweep does not have these chains")
      else
         call handle%session%sweep%select(int(first) + 1, int(first + n))
      end if
      status = end_call(model, error, status)
   end function nhbm_sweep_select

   integer(c_int) function nhbm_sweep_next(model, has_point) bind(c, name="nhbm_sweep_next") result(status)
      type(c_ptr), value :: model, has_point
      integer(c_int), pointer :: has
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error

      nullify (has)
      if (c_associated(has_point)) then
         call c_f_pointer(has_point, has)
         has = 0_c_int
      end if
      status = begin_call(model, "nhbm_sweep_next", handle, texts=[has_point], needs_input=.true.)
      if (status /= c_status%success) return
      if (.not. handle%session%sweep%is_begun) then
         call fail(error, "nhbm_sweep_next: "//not_begun)
      else if (handle%session%sweep%has_next()) then
         call handle%session%sweep_next(error)
         if (.not. allocated(error)) has = 1_c_int
      end if
      status = end_call(model, error, c_status%invalid_state)
   end function nhbm_sweep_next

   integer(c_int) function nhbm_sweep_number_branches(model, n_values, n_harmonics, motion_status, tuples, coefficients, branch) &
      bind(c, name="nhbm_sweep_number_branches") result(status)
      type(c_ptr), value :: model, motion_status, tuples, coefficients, branch
      integer(c_size_t), value :: n_values, n_harmonics
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error
      integer(c_int), pointer :: found(:), of_point(:), tuple(:, :, :)
      real(c_double), pointer :: motion(:, :)
      integer, allocatable :: numbers(:)

      status = begin_call(model, "nhbm_sweep_number_branches", handle, texts=[motion_status, tuples, coefficients, branch], &
                          needs_input=.true.)
      if (status /= c_status%success) return
      status = c_status%invalid_state
      if (.not. handle%session%sweep%is_begun) then
         call fail(error, "nhbm_sweep_number_branches: "//not_begun)
      else if (n_values > int(huge(1), c_size_t) .or. n_values < 0_c_size_t .or. n_harmonics < 1_c_size_t .or. &
               n_harmonics > int(huge(1), c_size_t)) then
         status = c_status%invalid_argument
         call fail(error, "nhbm_sweep_number_branches: n_harmonics must be at least 1, and n_values not negative")
      else
         associate (n => handle%session%source%plan%n_points, n_tones => handle%session%source%model%system%tones%n_tones)
            call c_f_pointer(motion_status, of_point, [n])
            call c_f_pointer(tuples, tuple, [n_tones, int(n_harmonics), n])
            call c_f_pointer(coefficients, motion, [int(n_values), n])
            call c_f_pointer(branch, found, [n])
            numbers = int(found)
            call handle%session%sweep%number_branches(handle%session%source, int(of_point), int(tuple), real(motion, wp), numbers, &
                                                      error)
            if (.not. allocated(error)) found = int(numbers, c_int)
         end associate
      end if
      status = end_call(model, error, status)
   end function nhbm_sweep_number_branches
end module hb_c_sweeps
