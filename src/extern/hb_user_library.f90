!> Laws in shared libraries or of the program itself, as nhbm_user_law.h describes them: the Fortran side of that C interface.
module hb_user_library
   use, intrinsic :: ieee_arithmetic, only: ieee_all, ieee_get_halting_mode, ieee_is_finite, ieee_quiet_nan, &
      ieee_set_halting_mode, ieee_value
   use, intrinsic :: iso_c_binding, only: c_associated, c_char, c_double, c_f_procpointer, c_funptr, c_int, c_loc, c_null_char, &
      c_null_funptr, c_null_ptr, c_ptr
   use hb_c_text, only: c_text
   use hb_checksum, only: library_fingerprint
   use hb_error, only: annotate, error_t, fail
   use hb_kinds, only: wp
   use hb_operating_system, only: file_kind, kind_of_file
   use hb_outside_code, only: begin_outside_code, end_outside_code
   use hb_text, only: to_text
   implicit none
   private
   public :: any_number, api_version, check_law_info, law_info_t, law_input_t, law_samples_t, law_step_t, &
      load_user_library, register_law, register_law_of_c, unregister_law, unregister_law_of_c, user_library_t

   !> A shared library. It remains loaded until the process ends, so that addresses are valid in every copy of their
   !> holder. Source of the interfaces: POSIX.1-2017, dlopen, dlsym, dlerror.
   type :: dynamic_library_t
      type(c_ptr), private :: handle = c_null_ptr
   contains
      procedure :: find => dynamic_library_find
   end type dynamic_library_t

   integer(c_int), parameter :: rtld_now = 2                           ! the same on Linux, BSD and macOS

   interface
      type(c_ptr) function dlopen(path, flags) bind(c, name="dlopen")
         import :: c_char, c_int, c_ptr
         character(kind=c_char), intent(in) :: path(*)
         integer(c_int), value :: flags
      end function dlopen

      type(c_funptr) function dlsym(handle, name) bind(c, name="dlsym")
         import :: c_char, c_funptr, c_ptr
         type(c_ptr), value :: handle
         character(kind=c_char), intent(in) :: name(*)
      end function dlsym

      type(c_ptr) function dlerror() bind(c, name="dlerror")
         import :: c_ptr
      end function dlerror
   end interface

   integer, parameter :: api_version = 2                              !! NHBM_USER_LAW_API_2
   integer, parameter :: any_number = -1                              !! NHBM_ANY_NUMBER
   integer, parameter :: max_states = 1000, max_degree = 1000         ! as nhbm_user_law.h states

   !> nhbm_law_info_t
   type, bind(c) :: law_info_t
      integer(c_int) :: api_version = 0
      integer(c_int) :: n_coordinates = 0
      integer(c_int) :: n_parameters = 0
      integer(c_int) :: needs_velocity = 0
      integer(c_int) :: degree = 0
      real(c_double) :: length_scale = 0.0_c_double
      type(c_ptr) :: context = c_null_ptr
      integer(c_int) :: needs_phases = 0
      integer(c_int) :: needs_frequencies = 0
      integer(c_int) :: n_states = 0
      type(c_funptr) :: advance = c_null_funptr
      type(c_ptr) :: reserved(4) = c_null_ptr
   end type law_info_t

   !> nhbm_law_samples_t
   type, bind(c) :: law_samples_t
      integer(c_int) :: n_samples = 0, n_coordinates = 0, stride = 0, n_parameters = 0
      type(c_ptr) :: z = c_null_ptr, v = c_null_ptr, parameters = c_null_ptr
      type(c_ptr) :: f = c_null_ptr, df_dz = c_null_ptr, df_dv = c_null_ptr, context = c_null_ptr
      integer(c_int) :: n_tones = 0, n_states = 0
      type(c_ptr) :: phases = c_null_ptr, frequencies = c_null_ptr, states = c_null_ptr, df_ds = c_null_ptr
   end type law_samples_t

   !> nhbm_law_step_t
   type, bind(c) :: law_step_t
      integer(c_int) :: n_samples = 0, n_coordinates = 0, n_states = 0, stride = 0, n_parameters = 0
      type(c_ptr) :: z = c_null_ptr, z_before = c_null_ptr, rise = c_null_ptr, rise_before = c_null_ptr
      type(c_ptr) :: states_before = c_null_ptr, parameters = c_null_ptr, states = c_null_ptr
      type(c_ptr) :: ds_dbefore = c_null_ptr
      type(c_ptr) :: ds_dz = c_null_ptr, ds_dz_before = c_null_ptr, ds_drise = c_null_ptr, ds_drise_before = c_null_ptr
      type(c_ptr) :: context = c_null_ptr
   end type law_step_t

   !> What the function of a law may know: a copy of its own, so that it cannot change data of others. Not allocated: not needed.
   type :: law_input_t
      real(wp), allocatable :: parameters(:)
      real(wp), allocatable :: z(:, :)                                !! [m], (n_samples, n_coordinates)
      real(wp), allocatable :: v(:, :)                                !! [m/s], as z; empty if not needed
      real(wp), allocatable :: phases(:, :)                           !! [rad], (n_samples, n_tones)
      real(wp), allocatable :: frequencies(:)                         !! [rad/s], (n_tones)
      real(wp), allocatable :: states(:, :)                           !! (n_samples, n_states)
   end type law_input_t

   !> A loaded law and its properties.
   type :: user_library_t
      integer :: n_coordinates = any_number
      integer :: n_parameters = any_number
      logical :: needs_velocity = .false.
      integer :: degree = 0                                           !! of a polynomial law, else 0
      real(wp) :: length_scale = 0.0_wp                               !! [m], 0: none
      logical :: needs_phases = .false., needs_frequencies = .false.
      integer :: n_states = 0                                         !! of one sample
      type(c_funptr), private :: advance_function = c_null_funptr
      type(c_funptr), private :: evaluate_function = c_null_funptr
      type(c_ptr), private :: context = c_null_ptr
      logical, private :: is_of_version_1, is_given
   contains
      procedure :: evaluate => user_library_evaluate
      procedure :: advance => user_library_advance
      procedure :: has_touched => user_library_has_touched
      procedure :: fingerprint => user_library_fingerprint
   end type user_library_t

   abstract interface
      integer(c_int) function info_function(info) bind(c)
         import :: c_int, law_info_t
         type(law_info_t), intent(inout) :: info
      end function info_function

      integer(c_int) function evaluate_2_function(samples) bind(c)
         import :: c_int, law_samples_t
         type(law_samples_t), intent(in) :: samples
      end function evaluate_2_function

      integer(c_int) function advance_function(step) bind(c)
         import :: c_int, law_step_t
         type(law_step_t), intent(in) :: step
      end function advance_function

      integer(c_int) function evaluate_function(n_samples, n_coordinates, stride, z, v, n_parameters, parameters, f, &
                                                df_dz, df_dv) bind(c)
         import :: c_double, c_int, c_ptr
         integer(c_int), value :: n_samples, n_coordinates, stride, n_parameters
         type(c_ptr), value :: z, v, parameters, f, df_dz, df_dv      ! NULL if there is none
      end function evaluate_function
   end interface

   interface
      integer(c_int) function find_registered_law(name, info, evaluate) bind(c, name="hb_find_registered_law")
         import :: c_char, c_funptr, c_int, law_info_t
         character(c_char), intent(in) :: name(*)
         type(law_info_t), intent(inout) :: info
         type(c_funptr), intent(inout) :: evaluate
      end function find_registered_law

      !> Registers a law whose properties are valid. Returns 0, or 1 if memory is insufficient.
      integer(c_int) function register_law_of_c(name, info, evaluate) bind(c, name="hb_register_law")
         import :: c_funptr, c_int, c_ptr, law_info_t
         type(c_ptr), value :: name
         type(law_info_t), intent(in) :: info
         type(c_funptr), value :: evaluate
      end function register_law_of_c

      !> Removes a law. Returns 0, or 1 if no law has this name.
      integer(c_int) function unregister_law_of_c(name) bind(c, name="hb_unregister_law")
         import :: c_int, c_ptr
         type(c_ptr), value :: name
      end function unregister_law_of_c
   end interface

contains

   !> Registers a law of the program for laws of the type `user` without a library; it replaces one of the same name for
   !> inputs that are read later. Fails if a property is invalid or memory is insufficient.
   subroutine register_law(name, info, evaluate, error)
      character(*), intent(in) :: name
      type(law_info_t), intent(in) :: info
      type(c_funptr), intent(in) :: evaluate                          !! integer(c_int) function(samples), bind(c)
      type(error_t), allocatable, intent(out) :: error
      character(:), allocatable, target :: text

      text = name//c_null_char
      if (.not. c_associated(evaluate)) then
         call fail(error, "'"//name//"' has no function `evaluate`")
      else
         call check_law_info(name, info, .true., error)
      end if
      if (allocated(error)) return
      if (register_law_of_c(c_loc(text), info, evaluate) /= 0) call fail(error, "'"//name//"': memory is insufficient")
   end subroutine register_law

   !> Removes a law of the program. Fails if no law has this name.
   subroutine unregister_law(name, error)
      character(*), intent(in) :: name
      type(error_t), allocatable, intent(out) :: error
      character(:), allocatable, target :: text

      text = name//c_null_char
      if (unregister_law_of_c(c_loc(text)) /= 0) call fail(error, "no law '"//name//"' is registered")
   end subroutine unregister_law

   !> Fails if a property of a law is invalid; the message begins with its name.
   subroutine check_law_info(name, info, is_registered, error)
      character(*), intent(in) :: name
      type(law_info_t), intent(in) :: info
      logical, intent(in) :: is_registered                            !! by the program, not loaded from a library
      type(error_t), allocatable, intent(out) :: error

      if (is_registered .and. info%api_version /= api_version) then
         call fail(error, "api_version must be NHBM_USER_LAW_API_2, which is "//to_text(api_version))
      else if (info%n_coordinates < 1 .and. info%n_coordinates /= any_number) then
         call fail(error, "n_coordinates must be positive or NHBM_ANY_NUMBER, not "//to_text(int(info%n_coordinates)))
      else if (info%n_parameters < 0 .and. info%n_parameters /= any_number) then
         call fail(error, "n_parameters must be 0, positive or NHBM_ANY_NUMBER, not "//to_text(int(info%n_parameters)))
      else if (info%degree < 0 .or. info%degree > max_degree) then
         call fail(error, "degree must be 0 to "//to_text(max_degree)//", not "//to_text(int(info%degree)))
      else if (.not. (ieee_is_finite(info%length_scale) .and. sign(1.0_c_double, info%length_scale) > 0.0_c_double)) then
         call fail(error, "length_scale must be a finite number, positive, or 0 if there is none")
      end if
      if (.not. (allocated(error) .or. info%api_version == 1)) then
         if (info%n_states < 0 .or. info%n_states > max_states) then
            call fail(error, "n_states must be 0 to "//to_text(max_states)//", not "//to_text(int(info%n_states)))
         else if (info%n_states > 0 .and. .not. c_associated(info%advance)) then
            call fail(error, "it has states but no function `advance`")
         else if (info%n_states > 0 .and. any([info%needs_velocity, info%needs_phases, info%needs_frequencies] /= 0)) then
            call fail(error, "the force of a law with states depends on displacements and states alone, not on "// &
                      "velocities, phases or frequencies")
         end if
      end if
      if (.not. allocated(error) .and. len_trim(name) == 0) call fail(error, "a law must have a name")
      call annotate(error, "law '"//name//"'")
   end subroutine check_law_info

   !> Loads the law `name` from a library, or the one registered by the program; fails if the library does not load,
   !> lacks a function, refuses, or was built for another version of the interface.
   subroutine load_user_library(self, path, name, error)
      type(user_library_t), intent(out) :: self
      character(*), intent(in) :: path                                !! empty: the program itself
      character(*), intent(in) :: name                                !! prefix of the functions
      type(error_t), allocatable, intent(out) :: error
      type(law_info_t) :: info

      self%is_given = len(path) == 0
      if (self%is_given) then
         if (find_registered_law(name//c_null_char, info, self%evaluate_function) == 0) &
            call fail(error, "the program has registered no law '"//name//"': a law in Python, or of another program, is known "// &
                      "there alone, and its motions are verified and continued there; otherwise 'library' names a file")
      else
         call open_law(self, path, name, info, error)
      end if
      if (.not. allocated(error)) call check_law_info(name, info, self%is_given, error)
      if (allocated(error)) return
      self%is_of_version_1 = info%api_version == 1
      self%n_coordinates = int(info%n_coordinates)
      self%n_parameters = int(info%n_parameters)
      self%needs_velocity = info%needs_velocity /= 0
      self%degree = int(info%degree)
      self%length_scale = info%length_scale
      self%context = info%context
      if (self%is_of_version_1) return
      self%needs_phases = info%needs_phases /= 0
      self%needs_frequencies = info%needs_frequencies /= 0
      self%n_states = int(info%n_states)
      self%advance_function = info%advance
   end subroutine load_user_library

   subroutine open_law(self, path, name, info, error)
      type(user_library_t), intent(inout) :: self
      character(*), intent(in) :: path, name
      type(law_info_t), intent(out) :: info
      type(error_t), allocatable, intent(out) :: error
      type(dynamic_library_t) :: library
      type(c_funptr) :: address
      procedure(info_function), pointer :: ask
      integer(c_int) :: code

      call open_library(library, path, error)
      if (allocated(error)) return
      call library%find(name//"_info", address, error)
      if (.not. allocated(error)) call library%find(name//"_evaluate", self%evaluate_function, error)
      call annotate(error, "'"//path//"'")
      if (allocated(error)) return
      call c_f_procpointer(address, ask)
      call begin_outside_code("'"//path//"': "//name//"_info ended the process")
      code = ask(info)
      call end_outside_code()
      if (code /= 0) then
         call fail(error, "'"//path//"': "//name//"_info returned "//to_text(int(code))//" instead of 0")
      else if (all(info%api_version /= [1, api_version])) then
         call fail(error, "'"//path//"': '"//name//"' was made for version "//to_text(int(info%api_version))// &
                   " of nhbm_user_law.h, this nhbm has version "//to_text(api_version)//"; compile it again")
      end if
   end subroutine open_law

   !> Fingerprint of the library: checksum and length; laws of the program have none.
   function user_library_fingerprint(self) result(text)
      class(user_library_t), intent(in) :: self
      character(60) :: text

      text = "of the program"
      if (.not. self%is_given) text = library_fingerprint(self%evaluate_function)
   end function user_library_fingerprint

   !> Calls the user's function and returns its return code. Values that it does not write remain NaN.
   integer function user_library_evaluate(self, input, f, df_dz, df_dv, df_ds) result(code)
      class(user_library_t), intent(in) :: self
      type(law_input_t), intent(inout), target :: input               !! unchanged, unless the function is wrong
      real(wp), intent(out), contiguous, target :: f(:, :)
      real(wp), intent(out), contiguous, optional, target :: df_dz(:, :, :), df_dv(:, :, :)
      real(wp), intent(out), contiguous, optional, target :: df_ds(:, :, :)   !! (n_samples, n_coordinates, n_states)
      procedure(evaluate_function), pointer :: evaluate
      procedure(evaluate_2_function), pointer :: evaluate_2
      type(law_samples_t) :: s
      logical :: halting(size(ieee_all))

      s%n_samples = size(input%z, 1, c_int)
      s%n_coordinates = size(input%z, 2, c_int)
      s%stride = s%n_samples
      s%n_parameters = size(input%parameters, kind=c_int)
      s%z = c_loc(input%z)
      s%parameters = c_loc(input%parameters)
      s%f = c_loc(f)
      s%context = self%context
      f = ieee_value(1.0_wp, ieee_quiet_nan)
      if (present(df_dz)) df_dz = ieee_value(1.0_wp, ieee_quiet_nan)
      if (present(df_dv)) df_dv = ieee_value(1.0_wp, ieee_quiet_nan)
      if (present(df_ds)) df_ds = ieee_value(1.0_wp, ieee_quiet_nan)
      if (present(df_dz)) s%df_dz = c_loc(df_dz)
      if (present(df_ds)) s%df_ds = c_loc(df_ds)
      if (self%needs_velocity) s%v = c_loc(input%v)
      if (self%needs_velocity .and. present(df_dv)) s%df_dv = c_loc(df_dv)
      if (allocated(input%phases)) s%n_tones = size(input%phases, 2, c_int)
      if (allocated(input%phases)) s%phases = c_loc(input%phases)
      if (allocated(input%frequencies)) s%n_tones = size(input%frequencies, kind=c_int)
      if (allocated(input%frequencies)) s%frequencies = c_loc(input%frequencies)
      if (allocated(input%states)) s%n_states = size(input%states, 2, c_int)
      if (allocated(input%states)) s%states = c_loc(input%states)
      call begin_arithmetic(halting)
      if (self%is_of_version_1) then
         call c_f_procpointer(self%evaluate_function, evaluate)
         code = evaluate(s%n_samples, s%n_coordinates, s%stride, s%z, s%v, s%n_parameters, s%parameters, s%f, s%df_dz, s%df_dv)
      else
         call c_f_procpointer(self%evaluate_function, evaluate_2)
         code = evaluate_2(s)
      end if
      call ieee_set_halting_mode(ieee_all, halting)
   end function user_library_evaluate

   !> Calls the user's function for the states at the end of a step and returns its return code. Values that it does not write
   !> remain NaN. The last axis of `path` and `ds_dpath`: z, z before, rise, rise before.
   integer function user_library_advance(self, parameters, states_before, path, states, ds_dbefore, ds_dpath) result(code)
      class(user_library_t), intent(in) :: self
      real(wp), intent(in), contiguous, target :: parameters(:)
      real(wp), intent(in), contiguous, target :: states_before(:, :) !! (n_samples, n_states)
      real(wp), intent(in), contiguous, target :: path(:, :, :)       !! [m], (n_samples, n_coordinates, 4)
      real(wp), intent(out), contiguous, target :: states(:, :)
      real(wp), intent(out), contiguous, optional, target :: ds_dbefore(:, :, :)  !! last axis: the state differentiated by
      real(wp), intent(out), contiguous, optional, target :: ds_dpath(:, :, :, :) !! (n_samples, n_states, n_coordinates, 4)
      procedure(advance_function), pointer :: advance
      type(law_step_t) :: step
      logical :: halting(size(ieee_all))

      step = law_step_t(size(path, 1, c_int), size(path, 2, c_int), size(states, 2, c_int), size(path, 1, c_int), &
                        size(parameters, kind=c_int), c_loc(path(1, 1, 1)), c_loc(path(1, 1, 2)), c_loc(path(1, 1, 3)), &
                        c_loc(path(1, 1, 4)), c_loc(states_before), c_loc(parameters), c_loc(states), context=self%context)
      states = ieee_value(1.0_wp, ieee_quiet_nan)
      if (present(ds_dbefore) .and. present(ds_dpath)) then
         ds_dbefore = ieee_value(1.0_wp, ieee_quiet_nan)
         ds_dpath = ieee_value(1.0_wp, ieee_quiet_nan)
         step%ds_dbefore = c_loc(ds_dbefore)
         step%ds_dz = c_loc(ds_dpath(1, 1, 1, 1))
         step%ds_dz_before = c_loc(ds_dpath(1, 1, 1, 2))
         step%ds_drise = c_loc(ds_dpath(1, 1, 1, 3))
         step%ds_drise_before = c_loc(ds_dpath(1, 1, 1, 4))
      end if
      call begin_arithmetic(halting)
      call c_f_procpointer(self%advance_function, advance)
      code = advance(step)
      call ieee_set_halting_mode(ieee_all, halting)
   end function user_library_advance

   !> Floating-point exceptions of the user's function do not stop the program; their results are visible in the numbers.
   subroutine begin_arithmetic(halting)
      logical, intent(out) :: halting(size(ieee_all))                 !! before, to be restored

      call ieee_get_halting_mode(ieee_all, halting)
      call ieee_set_halting_mode(ieee_all, .false.)
   end subroutine begin_arithmetic

   !> Calls the user's function, and says whether it has written to what it is only to read.
   logical function user_library_has_touched(self, input) result(has_touched)
      class(user_library_t), intent(in) :: self
      type(law_input_t), intent(in) :: input
      type(law_input_t) :: copy
      real(wp) :: f(size(input%z, 1), size(input%z, 2))
      integer :: ignored

      copy = input
      ignored = self%evaluate(copy, f)
      has_touched = .not. (is_unchanged(copy%parameters, input%parameters) .and. &
                           is_unchanged(reshape(copy%z, [size(copy%z)]), reshape(input%z, [size(input%z)])) .and. &
                           is_unchanged(reshape(copy%v, [size(copy%v)]), reshape(input%v, [size(input%v)])))
   end function user_library_has_touched

   pure logical function is_unchanged(values, before)
      real(wp), intent(in) :: values(:), before(:)

      is_unchanged = all(ieee_is_finite(values))
      if (is_unchanged) is_unchanged = all(abs(values - before) <= 0.0_wp)
   end function is_unchanged

   !> Loads a shared library; a path with a slash is taken as it is, a name without is searched for where the system keeps
   !> libraries. Fails with the reason that the loader gives.
   subroutine open_library(self, path, error)
      type(dynamic_library_t), intent(out) :: self
      character(*), intent(in) :: path
      type(error_t), allocatable, intent(out) :: error

      if (kind_of_file(path) == file_kind%device_or_pipe) then
         call fail(error, "cannot load the library: '"//path//"' is a pipe or a device")
         return
      end if
      call begin_outside_code("'"//path//"': the loader of the system crashed on this library, which is damaged")   ! e.g. cut off
      self%handle = dlopen(path//c_null_char, rtld_now)
      call end_outside_code()
      if (.not. c_associated(self%handle)) call fail(error, "cannot load the library: "//trim(last_reason(path)))
   end subroutine open_library

   !> Address of a function; fails when the library does not export it.
   subroutine dynamic_library_find(self, name, address, error)
      class(dynamic_library_t), intent(in) :: self
      character(*), intent(in) :: name
      type(c_funptr), intent(out) :: address
      type(error_t), allocatable, intent(out) :: error

      address = dlsym(self%handle, name//c_null_char)
      if (.not. c_associated(address)) call fail(error, "the library has no function '"//name//"': "//trim(last_reason(name)))
   end subroutine dynamic_library_find

   !> The reason that the loader gives for its last failure.
   function last_reason(subject) result(text)
      character(*), intent(in) :: subject                             !! returned if the loader gives no reason
      character(1000) :: text
      type(c_ptr) :: message

      message = dlerror()
      text = subject
      if (c_associated(message)) text = c_text(message)
   end function last_reason
end module hb_user_library
