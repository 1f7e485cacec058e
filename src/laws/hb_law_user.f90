!> A law of the user's own, from a shared library that is loaded at run time.
!>
!> The functions that the library exports, their arguments and return codes are documented in nhbm_user_law.h, the C header
!> of this interface. Sign: f stands beside K q on the left-hand side.
module hb_law_user
   use, intrinsic :: ieee_arithmetic, only: ieee_all, ieee_get_halting_mode, ieee_is_finite, ieee_quiet_nan, &
      ieee_set_halting_mode, ieee_value
   use, intrinsic :: iso_c_binding, only: c_double, c_f_procpointer, c_funptr, c_int, c_loc, c_null_funptr, c_null_ptr, c_ptr
   use hb_dynamic_library, only: dynamic_library_t, open_library
   use hb_error, only: annotate, error_t, fail
   use hb_kinds, only: wp
   use hb_law, only: law_t, read_dofs, read_place
   use hb_namelist, only: group_t
   use hb_structure, only: structure_t
   use hb_text, only: to_text
   implicit none
   private
   public :: load_user_law, user_law_t

   integer, parameter :: api_version = 1                              ! NHBM_USER_LAW_API
   integer, parameter :: any_number = -1                              ! NHBM_ANY_NUMBER

   !> nhbm_law_info_t
   type, bind(c) :: info_t
      integer(c_int) :: api_version = 0
      integer(c_int) :: n_coordinates = 0
      integer(c_int) :: n_parameters = 0
      integer(c_int) :: needs_velocity = 0
      integer(c_int) :: degree = 0
      real(c_double) :: length_scale = 0.0_c_double
   end type info_t

   type, extends(law_t) :: user_law_t
      character(:), allocatable :: name                               !! prefix of the functions
      real(wp), allocatable :: parameters(:)
      type(info_t), private :: info
      type(c_funptr), private :: evaluate_function = c_null_funptr
   contains
      procedure :: read => user_law_read
      procedure :: evaluate => user_law_evaluate
      procedure :: explain => user_law_explain
      procedure :: length_scale => user_law_length_scale
   end type user_law_t

   abstract interface
      integer(c_int) function info_function(info) bind(c)
         import :: c_int, info_t
         type(info_t), intent(inout) :: info
      end function info_function

      integer(c_int) function evaluate_function(n_samples, n_coordinates, stride, z, v, n_parameters, parameters, f, &
                                                df_dz, df_dv) bind(c)
         import :: c_double, c_int, c_ptr
         integer(c_int), value :: n_samples, n_coordinates, stride, n_parameters
         real(c_double), intent(in) :: z(*), parameters(*)
         type(c_ptr), value :: v, df_dz, df_dv                        ! NULL where there is none
         real(c_double), intent(out) :: f(*)
      end function evaluate_function
   end interface

contains

   !> Loads the law `name` from a library; fails when the library does not load, lacks a function, refuses, is made for
   !> another version of the interface, or takes another number of parameters.
   subroutine load_user_law(self, library, name, parameters, error)
      class(user_law_t), intent(inout) :: self
      character(*), intent(in) :: library                             !! path
      character(*), intent(in) :: name                                !! prefix of the functions
      real(wp), intent(in) :: parameters(:)
      type(error_t), allocatable, intent(out) :: error
      type(dynamic_library_t) :: loaded
      type(c_funptr) :: address
      procedure(info_function), pointer :: ask
      integer(c_int) :: code

      call open_library(loaded, library, error)
      if (allocated(error)) return
      call loaded%find(name//"_info", address, error)
      if (.not. allocated(error)) call loaded%find(name//"_evaluate", self%evaluate_function, error)
      call annotate(error, "'"//library//"'")
      if (allocated(error)) return
      call c_f_procpointer(address, ask)
      self%info = info_t()
      code = ask(self%info)
      if (code /= 0) then
         call fail(error, "'"//library//"': "//name//"_info returned "//to_text(int(code))//" instead of 0")
      else if (self%info%api_version /= api_version) then
         call fail(error, "'"//library//"': '"//name//"' was made for version "//to_text(int(self%info%api_version))// &
                   " of nhbm_user_law.h, this nhbm has version "//to_text(api_version)//"; compile it again")
      else if (self%info%n_parameters /= any_number .and. self%info%n_parameters /= size(parameters)) then
         call fail(error, "'"//name//"' takes "//to_text(int(self%info%n_parameters))//" parameters, not "// &
                   to_text(size(parameters)))
      end if
      if (allocated(error)) return
      self%name = name
      self%parameters = parameters
      self%needs_velocity = self%info%needs_velocity /= 0
      self%degree = max(0, int(self%info%degree))
   end subroutine load_user_law

   !> Reads a `&law type = 'user'` group.
   subroutine user_law_read(self, group, structure)
      class(user_law_t), intent(inout) :: self
      type(group_t), intent(inout) :: group
      type(structure_t), intent(in) :: structure
      character(:), allocatable :: library, name
      real(wp), allocatable :: parameters(:)
      type(error_t), allocatable :: error

      if (group%given("dofs") .and. .not. group%given("weights")) then
         if (group%given("dof")) call group%problem("dofs", "give either 'dof' or 'dofs', not both")
         call read_dofs(self, group, structure)
      else
         call read_place(self, group, structure)
      end if
      allocate (parameters(0))
      call group%require("library", library)
      call group%require("name", name)
      call group%get("parameters", parameters)
      if (.not. (allocated(library) .and. allocated(name))) return
      call load_user_law(self, beside(group%file_name, library), name, parameters, error)
      if (allocated(error)) then
         call group%problem("library", error%message)
      else if (allocated(self%shape) .and. self%info%n_coordinates /= any_number) then
         if (size(self%shape, 2) /= self%info%n_coordinates) call group%problem("dofs", "'"//name//"' takes "// &
            to_text(int(self%info%n_coordinates))//" coordinates, not "//to_text(size(self%shape, 2)))
      end if
   end subroutine user_law_read

   !> Path of a library: beside the input file if there is one of the name, else as it is.
   function beside(input, library) result(path)
      character(*), intent(in) :: input, library
      character(:), allocatable :: path
      logical :: exists

      path = library
      if (index(library, "/") == 1) return
      path = input(:index(input, "/", back=.true.))//library
      if (index(path, "/") == 0) path = "./"//path
      inquire (file=path, exist=exists)
      if (.not. exists) path = library
   end function beside

   !> NaN throughout when the library reports a failure, so that the residual is not finite there.
   subroutine user_law_evaluate(self, z, v, p, f, df_dz, df_dv, df_dp)
      class(user_law_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: f(:, :)
      real(wp), intent(out), contiguous, optional :: df_dz(:, :, :), df_dv(:, :, :), df_dp(:, :, :)

      integer :: code

      if (present(df_dz) .and. present(df_dv)) then
         code = call_library(self, z, v, f, df_dz, df_dv)
      else if (present(df_dz)) then
         code = call_library(self, z, v, f, df_dz)
      else
         code = call_library(self, z, v, f)
      end if
      if (code == 0) return
      f = ieee_value(1.0_wp, ieee_quiet_nan)
      if (present(df_dz)) df_dz = ieee_value(1.0_wp, ieee_quiet_nan)
      if (present(df_dv)) df_dv = ieee_value(1.0_wp, ieee_quiet_nan)
   end subroutine user_law_evaluate

   !> Calls the user's function and gives its return code. Its floating-point exceptions do not stop the program: what they
   !> leave behind is seen in the numbers.
   integer function call_library(self, z, v, f, df_dz, df_dv) result(code)
      type(user_law_t), intent(in) :: self
      real(wp), intent(in), contiguous, target :: z(:, :), v(:, :)
      real(wp), intent(out), contiguous :: f(:, :)
      real(wp), intent(out), contiguous, optional, target :: df_dz(:, :, :), df_dv(:, :, :)
      procedure(evaluate_function), pointer :: evaluate
      type(c_ptr) :: v_address, df_dz_address, df_dv_address
      logical :: halting(size(ieee_all))

      v_address = c_null_ptr
      df_dz_address = c_null_ptr
      df_dv_address = c_null_ptr
      if (self%needs_velocity) v_address = c_loc(v)
      if (present(df_dz)) df_dz_address = c_loc(df_dz)
      if (present(df_dv) .and. self%needs_velocity) df_dv_address = c_loc(df_dv)
      call c_f_procpointer(self%evaluate_function, evaluate)
      call ieee_get_halting_mode(ieee_all, halting)
      call ieee_set_halting_mode(ieee_all, .false.)
      code = evaluate(int(size(z, 1), c_int), int(size(z, 2), c_int), int(size(z, 1), c_int), z, v_address, &
                      int(size(self%parameters), c_int), self%parameters, f, df_dz_address, df_dv_address)
      call ieee_set_halting_mode(ieee_all, halting)
   end function call_library

   !> Asks the library once more.
   subroutine user_law_explain(self, z, v, text, is_fatal)
      class(user_law_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), v(:, :)
      character(:), allocatable, intent(out) :: text
      logical, intent(out) :: is_fatal
      real(wp), allocatable :: f(:, :)
      integer :: code

      allocate (f, mold=z)
      code = call_library(self, z, v, f)
      is_fatal = code < 0
      if (code /= 0) then
         text = "'"//self%name//"_evaluate' returned "//to_text(code)
      else if (.not. all(ieee_is_finite(f))) then
         text = "'"//self%name//"_evaluate' gave NaN or infinity for a force"
      else
         text = "'"//self%name//"_evaluate' gave NaN or infinity for a derivative"
      end if
   end subroutine user_law_explain

   pure real(wp) function user_law_length_scale(self)
      class(user_law_t), intent(in) :: self

      user_law_length_scale = max(0.0_wp, self%info%length_scale)
   end function user_law_length_scale
end module hb_law_user
