!> Laws in shared libraries or of the program itself, as nhbm_user_law.h describes them: the Fortran side of that C interface.
module hb_user_library
   use, intrinsic :: ieee_arithmetic, only: ieee_all, ieee_get_halting_mode, ieee_is_finite, ieee_quiet_nan, &
      ieee_set_halting_mode, ieee_value
   use, intrinsic :: iso_c_binding, only: c_char, c_double, c_f_procpointer, c_funptr, c_int, c_loc, c_null_char, c_null_funptr, &
      c_null_ptr, c_ptr
   use hb_checksum, only: library_mark
   use hb_dynamic_library, only: dynamic_library_t, open_library
   use hb_error, only: annotate, error_t, fail
   use hb_kinds, only: wp
   use hb_outside_code, only: begin_outside_code, end_outside_code
   use hb_text, only: to_text
   implicit none
   private
   public :: any_number, load_user_library, user_library_t

   integer, parameter :: api_version = 2                              ! NHBM_USER_LAW_API_2
   integer, parameter :: any_number = -1                              !! NHBM_ANY_NUMBER

   !> nhbm_law_info_t
   type, bind(c) :: info_t
      integer(c_int) :: api_version = 0
      integer(c_int) :: n_coordinates = 0
      integer(c_int) :: n_parameters = 0
      integer(c_int) :: needs_velocity = 0
      integer(c_int) :: degree = 0
      real(c_double) :: length_scale = 0.0_c_double
      type(c_ptr) :: context = c_null_ptr
   end type info_t

   !> nhbm_law_samples_t
   type, bind(c) :: samples_t
      integer(c_int) :: n_samples, n_coordinates, stride, n_parameters
      type(c_ptr) :: z, v, parameters, f, df_dz, df_dv, context
   end type samples_t

   !> A law that is loaded, and what it says of itself.
   type :: user_library_t
      integer :: n_coordinates = any_number
      integer :: n_parameters = any_number
      logical :: needs_velocity = .false.
      integer :: degree = 0                                           !! of a polynomial law, else 0
      real(wp) :: length_scale = 0.0_wp                               !! [m], 0: none
      type(c_funptr), private :: evaluate_function = c_null_funptr
      type(c_ptr), private :: context = c_null_ptr
      logical, private :: is_of_version_1 = .false., is_given = .false.
   contains
      procedure :: evaluate => user_library_evaluate
      procedure :: has_touched => user_library_has_touched
      procedure :: mark => user_library_mark
   end type user_library_t

   abstract interface
      integer(c_int) function info_function(info) bind(c)
         import :: c_int, info_t
         type(info_t), intent(inout) :: info
      end function info_function

      integer(c_int) function evaluate_2_function(samples) bind(c)
         import :: c_int, samples_t
         type(samples_t), intent(in) :: samples
      end function evaluate_2_function

      integer(c_int) function evaluate_function(n_samples, n_coordinates, stride, z, v, n_parameters, parameters, f, &
                                                df_dz, df_dv) bind(c)
         import :: c_double, c_int, c_ptr
         integer(c_int), value :: n_samples, n_coordinates, stride, n_parameters
         type(c_ptr), value :: z, v, parameters, f, df_dz, df_dv      ! NULL where there is none
      end function evaluate_function
   end interface

   interface
      integer(c_int) function find_given_law(name, info, evaluate) bind(c, name="hb_find_given_law")
         import :: c_char, c_funptr, c_int, info_t
         character(c_char), intent(in) :: name(*)
         type(info_t), intent(inout) :: info
         type(c_funptr), intent(inout) :: evaluate
      end function find_given_law
   end interface

contains

   !> Loads the law `name` from a library, or takes the one that the program has given; fails when the library does not load, lacks a
   !> function, refuses, or is made for another version of the interface.
   subroutine load_user_library(self, path, name, error)
      type(user_library_t), intent(out) :: self
      character(*), intent(in) :: path                                !! empty: the program itself
      character(*), intent(in) :: name                                !! prefix of the functions
      type(error_t), allocatable, intent(out) :: error
      type(info_t) :: info

      self%is_given = len(path) == 0
      if (self%is_given) then
         if (find_given_law(name//c_null_char, info, self%evaluate_function) == 0) &
            call fail(error, "the program has given no law '"//name//"'; without a program around nhbm, 'library' names a file")
      else
         call open_law(self, path, name, info, error)
      end if
      if (allocated(error)) return
      self%is_of_version_1 = info%api_version == 1
      self%n_coordinates = int(info%n_coordinates)
      self%n_parameters = int(info%n_parameters)
      self%needs_velocity = info%needs_velocity /= 0
      self%degree = max(0, int(info%degree))
      self%length_scale = max(0.0_wp, info%length_scale)
      self%context = info%context
   end subroutine load_user_library

   subroutine open_law(self, path, name, info, error)
      type(user_library_t), intent(inout) :: self
      character(*), intent(in) :: path, name
      type(info_t), intent(out) :: info
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

   !> What tells the library from another one: checksum and length; laws of the program have none.
   function user_library_mark(self) result(text)
      class(user_library_t), intent(in) :: self
      character(60) :: text

      text = "of the program"
      if (.not. self%is_given) text = library_mark(self%evaluate_function)
   end function user_library_mark

   !> Calls the user's function and gives its return code. It gets copies, so that it cannot change what others rely on, and
   !> what it does not write stays NaN. Its floating-point exceptions do not stop the program: what they leave behind is seen in
   !> the numbers.
   integer function user_library_evaluate(self, parameters, z, v, f, df_dz, df_dv) result(code)
      class(user_library_t), intent(in) :: self
      real(wp), intent(in), contiguous :: parameters(:)
      real(wp), intent(in), contiguous :: z(:, :), v(:, :)            !! (n_samples, n_coordinates), v empty if not needed
      real(wp), intent(out), contiguous, target :: f(:, :)
      real(wp), intent(out), contiguous, optional, target :: df_dz(:, :, :), df_dv(:, :, :)
      real(wp), allocatable, target :: parameters_copy(:), v_copy(:, :), z_copy(:, :)

      parameters_copy = parameters
      z_copy = z
      v_copy = v
      code = call_evaluate(self, parameters_copy, z_copy, v_copy, f, df_dz, df_dv)
   end function user_library_evaluate

   !> Calls the user's function, and says whether it has written to what it is only to read.
   logical function user_library_has_touched(self, parameters, z, v) result(has_touched)
      class(user_library_t), intent(in) :: self
      real(wp), intent(in) :: parameters(:), z(:, :), v(:, :)         !! as `evaluate` has them
      real(wp), allocatable, target :: f(:, :), parameters_copy(:), v_copy(:, :), z_copy(:, :)
      integer :: ignored

      allocate (f, mold=z)
      parameters_copy = parameters
      z_copy = z
      v_copy = v
      ignored = call_evaluate(self, parameters_copy, z_copy, v_copy, f)
      has_touched = .not. (is_unchanged(parameters_copy, parameters) .and. &
         is_unchanged(reshape(z_copy, [size(z)]), reshape(z, [size(z)])) .and. &
         is_unchanged(reshape(v_copy, [size(v)]), reshape(v, [size(v)])))
   end function user_library_has_touched

   pure logical function is_unchanged(values, before)
      real(wp), intent(in) :: values(:), before(:)

      is_unchanged = all(ieee_is_finite(values))
      if (is_unchanged) is_unchanged = all(abs(values - before) <= 0.0_wp)
   end function is_unchanged

   integer function call_evaluate(self, parameters, z, v, f, df_dz, df_dv) result(code)
      class(user_library_t), intent(in) :: self
      real(wp), intent(inout), contiguous, target :: parameters(:), z(:, :), v(:, :)    ! not to be written, but who knows
      real(wp), intent(out), contiguous, target :: f(:, :)
      real(wp), intent(out), contiguous, optional, target :: df_dz(:, :, :), df_dv(:, :, :)
      procedure(evaluate_function), pointer :: evaluate
      procedure(evaluate_2_function), pointer :: evaluate_2
      type(samples_t) :: s
      logical :: halting(size(ieee_all))

      s = samples_t(size(z, 1, c_int), size(z, 2, c_int), size(z, 1, c_int), size(parameters, kind=c_int), c_loc(z), &
                    c_null_ptr, c_loc(parameters), c_loc(f), c_null_ptr, c_null_ptr, self%context)
      if (self%needs_velocity) s%v = c_loc(v)
      if (present(df_dz)) s%df_dz = c_loc(df_dz)
      if (present(df_dv) .and. self%needs_velocity) s%df_dv = c_loc(df_dv)
      f = ieee_value(1.0_wp, ieee_quiet_nan)
      if (present(df_dz)) df_dz = ieee_value(1.0_wp, ieee_quiet_nan)
      if (present(df_dv)) df_dv = ieee_value(1.0_wp, ieee_quiet_nan)
      call ieee_get_halting_mode(ieee_all, halting)
      call ieee_set_halting_mode(ieee_all, .false.)
      if (self%is_of_version_1) then
         call c_f_procpointer(self%evaluate_function, evaluate)
         code = evaluate(s%n_samples, s%n_coordinates, s%stride, s%z, s%v, s%n_parameters, s%parameters, s%f, s%df_dz, s%df_dv)
      else
         call c_f_procpointer(self%evaluate_function, evaluate_2)
         code = evaluate_2(s)
      end if
      call ieee_set_halting_mode(ieee_all, halting)
   end function call_evaluate
end module hb_user_library
