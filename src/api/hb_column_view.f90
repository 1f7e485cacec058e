!> One column of a motion by its name: its values and their shape.
module hb_column_view
   use hb_column_units, only: column_kind, columns_with_units_t
   use hb_error, only: error_t, fail
   use hb_kinds, only: wp
   use hb_line_numbering, only: branch_column
   use hb_motion_result, only: motion_result_t
   use hb_similar_word, only: closest_word
   use hb_text, only: join, split, string_t
   implicit none
   private
   public :: column_view_t

   type, extends(columns_with_units_t) :: column_view_t
      character(:), allocatable :: name                               !! requested; empty: all names are listed
      logical :: is_found
      logical, private :: lists_names                                 ! `names` are wanted: takes longer than the search
      logical, private :: is_last                                     ! it was visited last
      integer :: kind
      real(wp), allocatable :: reals(:)
      integer, allocatable :: integers(:)
      integer, allocatable :: extents(:)                              !! fastest axis first; none for a single value
      character(:), allocatable :: units, axes                        !! names of axes, slowest first, separated by blanks
      character(:), allocatable :: long_name
      character(:), allocatable :: dof_units                          !! of each degree of freedom along it, separated by blanks
      character(:), allocatable :: flags                              !! names of its values, from `lowest_flag`, likewise
      integer :: lowest_flag
      character(:), allocatable :: attributes                         !! further ones, each "name = text" and a newline
      integer :: kind_of_values                                       !! also of values that are not known
      character(:), allocatable :: names                              !! of all columns, separated by blanks
   contains
      procedure :: begin => column_view_begin
      procedure :: find => column_view_find
      procedure :: reject_unknown => column_view_reject_unknown
      procedure :: integer => column_view_integer
      procedure :: attribute => column_view_attribute
      procedure :: real => column_view_real
      procedure :: text => column_view_text
   end type column_view_t

contains

   !> Begins the search for a column among those that follow.
   subroutine column_view_begin(self, name)
      class(column_view_t), intent(inout) :: self
      character(*), intent(in) :: name                                !! empty: `names` are listed

      self%name = name
      self%names = ""
      self%lists_names = .true.
      self%is_found = .false.
      self%is_last = .false.
      self%is_there = .true.
      self%is_known = .true.
      self%kind = column_kind%unknown
      self%extents = [integer ::]
      self%units = "1"
      self%axes = ""
      self%long_name = ""
      self%dof_units = ""
      self%flags = ""
      self%lowest_flag = 0
      self%attributes = ""
      self%describes = .true.
      self%kind_of_values = column_kind%real
   end subroutine column_view_begin

   !> Finds a column. Fails for an unknown name.
   subroutine column_view_find(self, name, motion, n_outputs, error)
      class(column_view_t), intent(inout) :: self
      character(*), intent(in) :: name                                !! empty: `names` are listed
      type(motion_result_t), intent(in) :: motion
      integer, intent(in) :: n_outputs                                !! number of outputs of a tolerance
      type(error_t), allocatable, intent(out) :: error

      call self%begin(name)
      self%has_one_tone = .false.
      if (allocated(motion%frequency)) self%has_one_tone = size(motion%frequency) == 1
      self%has_outputs = n_outputs > 0
      self%n_curve_unknowns = 0
      self%has_curve = allocated(motion%curve)
      if (self%has_curve) then
         if (allocated(motion%curve%unknowns)) self%n_curve_unknowns = size(motion%curve%unknowns)
      end if
      self%lists_names = len(name) == 0
      call visit_all()
      if (.not. (self%is_found .or. self%lists_names)) then
         self%lists_names = .true.                                    ! for the message
         call visit_all()
      end if
      call self%reject_unknown(error)

   contains

      subroutine visit_all()
         call self%append_connected(motion)
         if (self%has_branch) call branch_column(self, motion%leaves_branch)
      end subroutine visit_all
   end subroutine column_view_find

   !> Fails if none of the searched columns has the name, with the closest known name.
   subroutine column_view_reject_unknown(self, error)
      class(column_view_t), intent(in) :: self
      type(error_t), allocatable, intent(out) :: error
      type(string_t), allocatable :: known(:)
      character(:), allocatable :: closest

      if (len(self%name) == 0 .or. self%is_found) return
      call split(self%names, " ", known)
      closest = closest_word(self%name, known)
      if (len(closest) > 0) closest = "; did you mean '"//closest//"'?"
      call fail(error, "there is no column '"//self%name//"'; known: "//self%names//closest)
   end subroutine column_view_reject_unknown

   !> Whether a column is the one that is requested.
   logical function is_requested(self, name, units, axes, long_name)
      class(column_view_t), intent(inout) :: self
      character(*), intent(in) :: name, units, axes, long_name

      if (self%lists_names) then
         if (len(self%names) > 0) self%names = self%names//" "
         self%names = self%names//name
      end if
      is_requested = name == self%name
      self%is_last = is_requested
      if (.not. is_requested) return
      self%is_found = .true.
      self%axes = axes
      self%long_name = long_name
      call self%units_along(axes, units, self%units, self%dof_units)
   end function is_requested

   !> An attribute of the column that was visited last.
   subroutine column_view_attribute(self, name, text)
      class(column_view_t), intent(inout) :: self
      character(*), intent(in) :: name, text

      if (self%is_last) self%attributes = self%attributes//name//" = "//text//new_line("a")
   end subroutine column_view_attribute

   subroutine column_view_integer(self, name, units, axes, long_name, values, flags, lowest)
      class(column_view_t), intent(inout) :: self
      character(*), intent(in) :: name, units, axes, long_name
      integer, intent(in), contiguous, optional :: values(..)
      character(*), intent(in), optional :: flags(:)
      integer, intent(in), optional :: lowest

      if (.not. self%is_there) return
      if (.not. is_requested(self, name, units, axes, long_name)) return
      self%kind_of_values = column_kind%integer
      if (present(flags)) self%flags = trim(join(flags, " "))
      if (present(lowest)) self%lowest_flag = lowest
      if (.not. (self%is_known .and. present(values))) return
      self%kind = column_kind%integer
      self%extents = shape(values)
      select rank (values)
      rank (0); self%integers = [values]
      rank (1); self%integers = values
      rank (2); self%integers = reshape(values, [size(values)])
      end select
   end subroutine column_view_integer

   subroutine column_view_real(self, name, units, axes, long_name, values)
      class(column_view_t), intent(inout) :: self
      character(*), intent(in) :: name, units, axes, long_name
      real(wp), intent(in), contiguous, optional :: values(..)

      if (.not. self%is_there) return
      if (.not. is_requested(self, name, units, axes, long_name)) return
      if (.not. (self%is_known .and. present(values))) return
      self%kind = column_kind%real
      self%extents = shape(values)
      select rank (values)
      rank (0); self%reals = [values]
      rank (1); self%reals = values
      rank (2); self%reals = reshape(values, [size(values)])
      rank (3); self%reals = reshape(values, [size(values)])
      rank (4); self%reals = reshape(values, [size(values)])
      end select
   end subroutine column_view_real

   subroutine column_view_text(self, name, units, axes, long_name, value)
      class(column_view_t), intent(inout) :: self
      character(*), intent(in) :: name, units, axes, long_name
      character(*), intent(in), optional :: value

      if (.not. self%is_there) return
      if (is_requested(self, name, units, axes, long_name)) self%kind = column_kind%text
   end subroutine column_view_text
end module hb_column_view
