!> A law of the user's own, from a shared library that is loaded at run time.
!>
!> The functions that the library exports, their arguments and return codes are documented in nhbm_user_law.h, the C header
!> of this interface. Sign: f stands beside K q on the left-hand side.
module hb_law_user
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite, ieee_quiet_nan, ieee_value
   use hb_error, only: error_t, fail
   use hb_kinds, only: wp
   use hb_law, only: law_t, read_dofs, read_place
   use hb_path, only: library_place
   use hb_properties, only: properties_t
   use hb_structure, only: structure_t
   use hb_text, only: to_text
   use hb_user_library, only: any_number, load_user_library, user_library_t
   implicit none
   private
   public :: load_user_law, user_law_t

   type, extends(law_t) :: user_law_t
      character(:), allocatable :: name                               !! prefix of the functions
      real(wp), allocatable :: parameters(:)
      type(user_library_t), private :: library
   contains
      procedure :: read => user_law_read
      procedure :: evaluate => user_law_evaluate
      procedure :: explain => user_law_explain
      procedure :: mark => user_law_mark
      procedure :: has_touched_inputs => user_law_has_touched_inputs
   end type user_law_t

contains

   !> Loads the law `name` from a library; fails when it cannot be loaded or takes another number of parameters.
   subroutine load_user_law(self, library, name, parameters, error)
      class(user_law_t), intent(inout) :: self
      character(*), intent(in) :: library                             !! path; empty: the program itself
      character(*), intent(in) :: name                                !! prefix of the functions
      real(wp), intent(in) :: parameters(:)
      type(error_t), allocatable, intent(out) :: error

      call load_user_library(self%library, library, name, error)
      if (allocated(error)) return
      if (all(self%library%n_parameters /= [any_number, size(parameters)])) then
         call fail(error, "'"//name//"' takes "//to_text(self%library%n_parameters)//" parameters, not "// &
                   to_text(size(parameters)))
         return
      end if
      self%name = name
      self%parameters = parameters
      self%needs_velocity = self%library%needs_velocity
      self%degree = self%library%degree
      self%is_users_own = .true.
      self%length_scale = self%library%length_scale
   end subroutine load_user_law

   !> Reads a `&law type = 'user'` group.
   subroutine user_law_read(self, group, structure)
      class(user_law_t), intent(inout) :: self
      type(properties_t), intent(inout) :: group
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
      call group%get("library", library)
      call group%get("name", name)
      call group%get("parameters", parameters)
      call group%get("odd", self%is_odd)                              ! nobody else can see it
      if (.not. (allocated(library) .and. allocated(name))) return
      if (len(library) > 0) library = trim(library_place(group%file_name, library))
      call load_user_law(self, library, name, parameters, error)
      if (allocated(error)) then
         call group%problem("library", error%message)
      else if (allocated(self%shape)) then
         if (all(self%library%n_coordinates /= [any_number, size(self%shape, 2)])) then
            call group%problem("dofs", "'"//name//"' takes "//to_text(self%library%n_coordinates)//" coordinates, not "// &
                               to_text(size(self%shape, 2)))
         end if
      end if
   end subroutine user_law_read

   !> NaN throughout when the library reports a failure, so that the residual is not finite there.
   subroutine user_law_evaluate(self, z, v, p, f, df_dz, df_dv, df_dp)
      class(user_law_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: f(:, :)
      real(wp), intent(out), contiguous, optional :: df_dz(:, :, :), df_dv(:, :, :), df_dp(:, :, :)

      integer :: code

      if (present(df_dz) .and. present(df_dv)) then
         code = self%library%evaluate(self%parameters, z, v, f, df_dz, df_dv)
      else if (present(df_dz)) then
         code = self%library%evaluate(self%parameters, z, v, f, df_dz)
      else
         code = self%library%evaluate(self%parameters, z, v, f)
      end if
      if (code == 0) return
      f = ieee_value(1.0_wp, ieee_quiet_nan)
      if (present(df_dz)) df_dz = ieee_value(1.0_wp, ieee_quiet_nan)
      if (present(df_dv)) df_dv = ieee_value(1.0_wp, ieee_quiet_nan)
   end subroutine user_law_evaluate

   !> Asks the library once more.
   subroutine user_law_explain(self, z, v, text, is_fatal)
      class(user_law_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), v(:, :)
      character(:), allocatable, intent(out) :: text
      logical, intent(out) :: is_fatal
      real(wp), allocatable :: f(:, :)
      integer :: code

      allocate (f, mold=z)
      code = self%library%evaluate(self%parameters, z, v, f)
      is_fatal = code < 0
      if (code /= 0) then
         text = "'"//self%name//"_evaluate' returned "//to_text(code)
      else if (.not. all(ieee_is_finite(f))) then
         text = "'"//self%name//"_evaluate' gave NaN or infinity for a force"
      else
         text = "'"//self%name//"_evaluate' gave NaN or infinity for a derivative"
      end if
   end subroutine user_law_explain

   !> Its name, and what tells the library from another one.
   function user_law_mark(self) result(text)
      class(user_law_t), intent(in) :: self
      character(300) :: text

      text = self%name//", "//self%library%mark()
   end function user_law_mark

   !> Asks the library once more: whether it writes to what it is only to read.
   logical function user_law_has_touched_inputs(self, z, v) result(has_touched)
      class(user_law_t), intent(in) :: self
      real(wp), intent(in) :: z(:, :), v(:, :)                        !! as `evaluate` has them

      has_touched = self%library%has_touched(self%parameters, z, v)
   end function user_law_has_touched_inputs
end module hb_law_user
