!> The functions of nhbm.h that compute, and the callbacks during computations. The header documents them.
module hb_c_computations
   use, intrinsic :: ieee_arithmetic, only: ieee_is_nan
   use, intrinsic :: iso_c_binding, only: c_associated, c_double, c_f_pointer, c_funptr, c_int, c_null_ptr, c_ptr, &
      c_size_t
   use hb_c_handles, only: c_status, release_handle
   use hb_c_model, only: address_of_reals, any_null, begin_call, end_call, end_call_with_text, handle_t
   use hb_census, only: census_config_t
   use hb_error, only: annotate, error_t, fail
   use hb_kinds, only: wp
   use hb_motion_result, only: motion_result_t
   use hb_outcome, only: is_solved
   use hb_text, only: to_text
   implicit none
   private

   integer(c_int), parameter :: cold_start = 0_c_int, warm_start = 1_c_int

   !> struct nhbm_motion.
   type, bind(c) :: c_motion_t
      integer(c_size_t) :: n_tones
      integer(c_size_t) :: n_harmonics
      integer(c_size_t) :: n_dofs
      type(c_ptr) :: frequency
      type(c_ptr) :: tuples
      type(c_ptr) :: coefficients
      real(c_double) :: truncation_estimate
      real(c_double) :: aliasing_estimate
      type(c_ptr) :: frequency_estimate
      integer(c_int) :: status
      integer(c_int) :: n_unstable
   end type c_motion_t

   !> struct nhbm_census.
   type, bind(c) :: c_census_t
      integer(c_size_t) :: n_motions
      integer(c_int) :: n_random, n_random_lost, n_directed, n_directed_lost, n_left, n_once, n_never, is_reliable
      real(c_double) :: unseen, unseen_bound, missed, least_share
   end type c_census_t

   !> struct nhbm_census_motion.
   type, bind(c) :: c_census_motion_t
      integer(c_int) :: n_random, n_directed, start, mirror_of
   end type c_census_motion_t

contains

   integer(c_int) function nhbm_set_interrupt_callback(model, callback, context) &
      bind(c, name="nhbm_set_interrupt_callback") result(status)
      type(c_ptr), value :: model, context
      type(c_funptr), value :: callback
      type(handle_t), pointer :: handle

      status = begin_call(model, "nhbm_set_interrupt_callback", handle)
      if (status /= c_status%success) return
      handle%session%cancellation%interrupt = callback
      handle%session%cancellation%interrupt_context = context
      call release_handle(model)
   end function nhbm_set_interrupt_callback

   integer(c_int) function nhbm_set_progress_callback(model, callback, context) &
      bind(c, name="nhbm_set_progress_callback") result(status)
      type(c_ptr), value :: model, context
      type(c_funptr), value :: callback
      type(handle_t), pointer :: handle

      status = begin_call(model, "nhbm_set_progress_callback", handle)
      if (status /= c_status%success) return
      handle%session%cancellation%report = callback
      handle%session%cancellation%report_context = context
      call release_handle(model)
   end function nhbm_set_progress_callback

   integer(c_int) function nhbm_solve(model, start) bind(c, name="nhbm_solve") result(status)
      type(c_ptr), value :: model
      integer(c_int), value :: start
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error

      status = begin_call(model, "nhbm_solve", handle, needs_input=.true.)
      if (status /= c_status%success) return
      if (start == cold_start .or. start == warm_start) then
         call handle%session%solve(start == warm_start, error)
         status = end_call(model, error, c_status%invalid_input)
      else
         call fail(error, "nhbm_solve: start must be NHBM_COLD_START or NHBM_WARM_START")
         status = end_call(model, error, c_status%invalid_argument)
      end if
   end function nhbm_solve

   integer(c_int) function nhbm_set_point_count(model, n_points) bind(c, name="nhbm_set_point_count") result(status)
      type(c_ptr), value :: model
      integer(c_size_t), value :: n_points
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error

      status = begin_call(model, "nhbm_set_point_count", handle)
      if (status /= c_status%success) return
      if (n_points >= 0_c_size_t .and. n_points <= int(huge(1), c_size_t)) then
         handle%session%n_points = int(n_points)
      else
         call fail(error, "nhbm_set_point_count: n_points must be at most 2147483647")
      end if
      status = end_call(model, error, c_status%invalid_argument)
   end function nhbm_set_point_count

   integer(c_int) function nhbm_curve_begin(model) bind(c, name="nhbm_curve_begin") result(status)
      type(c_ptr), value :: model
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error

      status = begin_call(model, "nhbm_curve_begin", handle, needs_input=.true.)
      if (status /= c_status%success) return
      call handle%session%curve_begin(error)
      status = end_call(model, error, c_status%invalid_input)
   end function nhbm_curve_begin

   integer(c_int) function nhbm_curve_lengthen(model, n_points) bind(c, name="nhbm_curve_lengthen") result(status)
      type(c_ptr), value :: model
      integer(c_size_t), value :: n_points
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error

      status = begin_call(model, "nhbm_curve_lengthen", handle, needs_input=.true.)
      if (status /= c_status%success) return
      if (.not. handle%session%is_cut()) then
         call fail(error, "nhbm_curve_lengthen: no curve has ended at its number of points, or a later call has ended it")
         status = end_call(model, error, c_status%invalid_state)
         return
      end if
      call handle%session%curve_lengthen(int(min(n_points, int(huge(1), c_size_t))), error)
      call annotate(error, "nhbm_curve_lengthen")
      status = end_call(model, error, c_status%invalid_argument)
   end function nhbm_curve_lengthen

   integer(c_int) function nhbm_curve_next(model, has_point) bind(c, name="nhbm_curve_next") result(status)
      type(c_ptr), value :: model, has_point
      integer(c_int), pointer :: has
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error

      nullify (has)
      if (c_associated(has_point)) then
         call c_f_pointer(has_point, has)
         has = 0_c_int
      end if
      status = begin_call(model, "nhbm_curve_next", handle, texts=[has_point], needs_input=.true.)
      if (status /= c_status%success) return
      if (.not. handle%session%has_begun_curve()) then
         call fail(error, "nhbm_curve_next: there is no curve; nhbm_curve_begin begins one, and setting a value or another "// &
                   "computation ends it")
         status = end_call(model, error, c_status%invalid_state)
         return
      end if
      if (handle%session%has_curve) then
         call handle%session%curve_next(error)
         if (.not. allocated(error)) has = 1_c_int
      end if
      status = end_call(model, error, c_status%invalid_input)
   end function nhbm_curve_next

   integer(c_int) function nhbm_take_census(model, n_starts, seed, time_limit, census) &
      bind(c, name="nhbm_take_census") result(status)
      type(c_ptr), value :: model, census
      integer(c_int), value :: n_starts, seed
      real(c_double), value :: time_limit
      type(handle_t), pointer :: handle
      type(c_census_t), pointer :: found
      type(census_config_t) :: config
      type(error_t), allocatable :: error
      logical :: is_wrong

      nullify (found)
      if (c_associated(census)) then
         call c_f_pointer(census, found)
         found = c_census_t(0_c_size_t, 0, 0, 0, 0, 0, 0, 0, 0, 0.0_c_double, 0.0_c_double, 0.0_c_double, 0.0_c_double)
      end if
      status = begin_call(model, "nhbm_take_census", handle, texts=[census], needs_input=.true.)
      if (status /= c_status%success) return
      is_wrong = ieee_is_nan(time_limit) .or. n_starts < 0_c_int .or. seed < 0_c_int
      if (.not. is_wrong) is_wrong = time_limit < 0.0_c_double        ! comparing a NaN is trapped in the debug build
      if (is_wrong) then
         call fail(error, "nhbm_take_census: n_starts, seed and time_limit must not be negative")
         status = end_call(model, error, c_status%invalid_argument)
         return
      end if
      config%n_starts = int(n_starts)
      config%seed = int(seed)
      if (time_limit > 0.0_c_double) config%time_limit = real(time_limit, wp)
      call handle%session%take_census(config, error)
      if (.not. allocated(error)) then
         associate (taken => handle%session%census, completeness => handle%session%census%completeness)
            found = c_census_t(size(taken%motions, kind=c_size_t), taken%n_random, taken%n_random_lost, taken%n_directed, &
                               taken%n_directed_lost, taken%n_left, completeness%n_once, completeness%n_never, &
                               merge(1_c_int, 0_c_int, completeness%is_reliable), completeness%unseen, completeness%unseen_bound, &
                               completeness%missed, completeness%least_share)
         end associate
      end if
      status = end_call(model, error, c_status%invalid_input)
   end function nhbm_take_census

   integer(c_int) function nhbm_select_census_motion(model, index, found) &
      bind(c, name="nhbm_select_census_motion") result(status)
      type(c_ptr), value :: model, found
      integer(c_size_t), value :: index
      type(handle_t), pointer :: handle
      type(c_census_motion_t), pointer :: motion
      type(error_t), allocatable :: error

      nullify (motion)
      if (c_associated(found)) then
         call c_f_pointer(found, motion)
         motion = c_census_motion_t(0, 0, 0, -1)
      end if
      status = begin_call(model, "nhbm_select_census_motion", handle, texts=[found], needs_input=.true.)
      if (status /= c_status%success) return
      if (.not. allocated(handle%session%census)) then
         call fail(error, "nhbm_select_census_motion: there is no census of the present values; call nhbm_take_census before")
         status = end_call(model, error, c_status%invalid_state)
         return
      end if
      associate (motions => handle%session%census%motions)
         if (index >= 0_c_size_t .and. index < size(motions, kind=c_size_t)) then
            associate (chosen => motions(int(index) + 1))
               motion = c_census_motion_t(chosen%n_random, chosen%n_directed, chosen%first_kind, chosen%mirror_of - 1)
            end associate
            call handle%session%select_motion(int(index) + 1)
         else
            call fail(error, "nhbm_select_census_motion: the census has no motion with this index")
         end if
      end associate
      status = end_call(model, error, c_status%invalid_argument)
   end function nhbm_select_census_motion

   integer(c_int) function nhbm_integrate(model) bind(c, name="nhbm_integrate") result(status)
      type(c_ptr), value :: model
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error

      status = begin_call(model, "nhbm_integrate", handle, needs_input=.true.)
      if (status /= c_status%success) return
      call handle%session%integrate(error)
      status = end_call(model, error, c_status%invalid_input)
   end function nhbm_integrate

   integer(c_int) function nhbm_verify(model, max_periods) bind(c, name="nhbm_verify") result(status)
      type(c_ptr), value :: model
      integer(c_int), value :: max_periods
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error

      status = begin_call(model, "nhbm_verify", handle, needs_input=.true.)
      if (status /= c_status%success) return
      if (max_periods < 0_c_int) then
         call fail(error, "nhbm_verify: max_periods must be positive, or 0 for as many as the decay requires, not "// &
                   to_text(int(max_periods)))
         status = end_call(model, error, c_status%invalid_argument)
         return
      end if
      status = c_status%invalid_state
      if (handle%session%may_verify()) status = c_status%invalid_input
      call handle%session%verify(int(max_periods), error)
      status = end_call(model, error, status)
   end function nhbm_verify

   integer(c_int) function nhbm_set_verification_time(model, seconds) bind(c, name="nhbm_set_verification_time") result(status)
      type(c_ptr), value :: model
      real(c_double), value :: seconds
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error
      logical :: is_wrong

      status = begin_call(model, "nhbm_set_verification_time", handle)
      if (status /= c_status%success) return
      is_wrong = ieee_is_nan(seconds)
      if (.not. is_wrong) is_wrong = seconds < 0.0_c_double
      if (is_wrong) then
         call fail(error, "nhbm_set_verification_time: seconds must be positive, or 0 for no limit")
      else
         handle%session%verification_time = merge(real(seconds, wp), huge(1.0_wp), seconds > 0.0_c_double)
      end if
      status = end_call(model, error, c_status%invalid_argument)
   end function nhbm_set_verification_time

   integer(c_int) function nhbm_verify_motion(model, motion, max_periods) bind(c, name="nhbm_verify_motion") result(status)
      type(c_ptr), value :: model, motion
      integer(c_int), value :: max_periods
      type(handle_t), pointer :: handle
      type(motion_result_t) :: result
      type(error_t), allocatable :: error

      status = begin_call(model, "nhbm_verify_motion", handle, texts=[motion], needs_input=.true.)
      if (status /= c_status%success) return
      call copy_motion(motion, result, error)
      status = c_status%invalid_argument
      if (.not. allocated(error)) then
         if (max_periods >= 0_c_int) status = c_status%invalid_input
         call handle%session%verify_motion(result, int(max_periods), error)
      end if
      status = end_call(model, error, status)
   end function nhbm_verify_motion

   !> Copies a motion of C. Fails for lengths that are zero or too large, and for arrays that are NULL.
   subroutine copy_motion(address, motion, error)
      type(c_ptr), intent(in) :: address
      type(motion_result_t), intent(out) :: motion
      type(error_t), allocatable, intent(out) :: error
      type(c_motion_t), pointer :: given
      real(c_double), pointer :: coefficients(:, :, :), frequency(:), frequency_estimate(:)
      integer(c_int), pointer :: tuples(:, :)
      integer(c_size_t), parameter :: max_count = int(huge(1), c_size_t)

      call c_f_pointer(address, given)
      associate (n => [given%n_tones, given%n_harmonics, given%n_dofs])
         if (any(n < 1_c_size_t .or. n > max_count)) then
            call fail(error, "nhbm_verify_motion: n_tones, n_harmonics and n_dofs must be at least 1")
         else if (any_null([given%frequency, given%tuples, given%coefficients])) then
            call fail(error, "nhbm_verify_motion: frequency, tuples and coefficients must not be NULL")
         else if (.not. is_solved(int(given%status))) then
            call fail(error, "nhbm_verify_motion: the status is not that of a motion")
         end if
         if (allocated(error)) return
         call c_f_pointer(given%frequency, frequency, [n(1)])
         call c_f_pointer(given%tuples, tuples, [n(1), n(2)])
         call c_f_pointer(given%coefficients, coefficients, [2_c_size_t, n(2), n(3)])
         motion%status = int(given%status)
         motion%frequency = real(frequency, wp)
         motion%harmonics%tuples = int(tuples)
         motion%coefficients = real(coefficients, wp)
         motion%error_estimate%combination = 0*int(tuples(:, 1))         ! the estimates are known, or NaN
         motion%error_estimate%truncation = real(given%truncation_estimate, wp)
         motion%error_estimate%aliasing = real(given%aliasing_estimate, wp)
         motion%stability%n_unstable = int(given%n_unstable)
         if (.not. c_associated(given%frequency_estimate)) return
         call c_f_pointer(given%frequency_estimate, frequency_estimate, [n(1)])
         motion%error_estimate%frequency_error = real(frequency_estimate, wp)
      end associate
   end subroutine copy_motion

   integer(c_int) function nhbm_get_natural_frequencies(model, n, frequencies) bind(c, name="nhbm_get_natural_frequencies") &
      result(status)
      type(c_ptr), value :: model, n, frequencies
      type(handle_t), pointer :: handle
      type(error_t), allocatable :: error
      integer(c_size_t), pointer :: number
      type(c_ptr), pointer :: address

      nullify (number, address)
      if (c_associated(n)) then
         call c_f_pointer(n, number)
         number = 0_c_size_t
      end if
      if (c_associated(frequencies)) then
         call c_f_pointer(frequencies, address)
         address = c_null_ptr
      end if
      status = begin_call(model, "nhbm_get_natural_frequencies", handle, texts=[n, frequencies], needs_input=.true.)
      if (status /= c_status%success) return
      call handle%session%natural_frequencies(handle%frequencies, error)
      if (.not. allocated(error)) then
         number = size(handle%frequencies, kind=c_size_t)
         if (number > 0_c_size_t) address = address_of_reals(handle%frequencies)
      end if
      status = end_call(model, error, c_status%invalid_input)
   end function nhbm_get_natural_frequencies
end module hb_c_computations
