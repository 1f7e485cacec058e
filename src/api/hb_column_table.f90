!> All columns of several motions: a row for each motion, stored one after another, and copied into arrays that are padded as
!> those of a result file: with 0 for integers and beyond the harmonics of a motion, and NaN for reals that are not known.
module hb_column_table
   use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
   use hb_column_units, only: column_kind, columns_with_units_t
   use hb_kinds, only: int64, wp
   use hb_line_numbering, only: branch_column
   use hb_motion_result, only: motion_result_t
   use hb_text, only: join, split, string_t
   implicit none
   private
   public :: column_table_t, max_axes, table_column_t

   integer, parameter :: max_axes = 4                                 !! NHBM_MAX_AXES
   integer, parameter :: usual_columns = 128
   integer, parameter :: not_known = -1                               ! extent of a row without values

   type :: table_column_t
      character(:), allocatable :: name, units, axes                  !! names of axes, slowest first, separated by blanks
      character(:), allocatable :: long_name, dof_units, flags, attributes   !! as of `column_view_t`
      integer :: lowest_flag = 0
      integer :: kind = column_kind%real
      integer, allocatable :: i_axis(:)                               !! its axes among those of the table, fastest first
      logical :: is_harmonic = .false.                                !! one of them is that of the harmonics
      integer :: n_rows = 0                                           !! with an entry
      integer :: n_known = 0                                          !! of them with values
      integer :: n_values = 0                                         !! of all rows
      integer, allocatable :: extents(:, :)                           !! of each row, (axes, rows); not of single values
      real(wp), allocatable :: reals(:)
      integer, allocatable :: integers(:)
   end type table_column_t

   type :: table_axis_t
      character(:), allocatable :: name
      integer :: length = not_known                                   !! the largest of all rows
      character(64), allocatable :: labels(:)                         !! of the first row with this length
   end type table_axis_t

   type, extends(columns_with_units_t) :: column_table_t
      integer :: n_rows = 0
      integer :: n_columns = 0
      integer :: declaration = 0                                      !! another number: names, units, axes or labels have changed
      type(table_column_t), allocatable :: columns(:)
      type(table_axis_t), allocatable :: axes(:)
      type(string_t), allocatable :: messages(:)                      !! of each row; not allocated: none
      logical, private :: had_curve = .false.                         ! columns of curves are declared
      integer, private :: i_next = 1                                  ! column that is expected next
      integer, private :: i_last = 0                                  ! that was visited last, if it is new
   contains
      procedure :: clear => column_table_clear
      procedure :: redeclare => column_table_redeclare
      procedure :: add => column_table_add
      procedure :: sizes => column_table_sizes
      procedure :: copy_reals => column_table_copy_reals
      procedure :: copy_integers => column_table_copy_integers
      procedure :: get_message => column_table_get_message
      procedure :: get_labels => column_table_get_labels
      procedure :: bytes => column_table_bytes
      procedure :: find_axis => column_table_find_axis
      procedure :: integer => column_table_integer
      procedure :: attribute => column_table_attribute
      procedure :: real => column_table_real
      procedure :: text => column_table_text
   end type column_table_t

contains

   !> Removes all rows. Columns remain declared.
   subroutine column_table_clear(self)
      class(column_table_t), intent(inout) :: self
      integer :: i

      self%n_rows = 0
      if (allocated(self%messages)) deallocate (self%messages)
      do i = 1, self%n_columns
         self%columns(i)%n_rows = 0
         self%columns(i)%n_known = 0
         self%columns(i)%n_values = 0
      end do
      if (.not. allocated(self%axes)) allocate (self%axes(0))
      self%axes%length = not_known
   end subroutine column_table_clear

   !> Removes all rows and columns.
   subroutine column_table_redeclare(self)
      class(column_table_t), intent(inout) :: self

      self%n_columns = 0
      self%had_curve = .false.
      if (allocated(self%columns)) deallocate (self%columns)
      if (allocated(self%axes)) deallocate (self%axes)
      allocate (self%columns(usual_columns), self%axes(0))
      self%declaration = self%declaration + 1
      call self%clear()
   end subroutine column_table_redeclare

   !> Adds a motion as the last row.
   subroutine column_table_add(self, motion)
      class(column_table_t), intent(inout) :: self
      type(motion_result_t), intent(in) :: motion
      character(:), allocatable :: message

      if (.not. allocated(self%columns)) call self%redeclare()
      self%n_rows = self%n_rows + 1
      self%i_next = 1
      self%has_one_tone = .false.
      if (allocated(motion%frequency)) self%has_one_tone = size(motion%frequency) == 1
      self%n_curve_unknowns = 0
      self%has_curve = allocated(motion%curve)
      if (self%has_curve) then
         if (allocated(motion%curve%unknowns)) self%n_curve_unknowns = size(motion%curve%unknowns)
      end if
      self%describes = self%has_curve .and. .not. self%had_curve      ! the attributes that are used are those of new columns
      self%had_curve = self%had_curve .or. self%has_curve
      call self%append_connected(motion)
      if (self%has_branch) call branch_column(self, motion%leaves_branch)
      call motion%describe(message)
      if (len(message) > 0) call add_message(self, message)
   end subroutine column_table_add

   subroutine add_message(self, message)
      class(column_table_t), intent(inout) :: self
      character(*), intent(in) :: message
      type(string_t), allocatable :: longer(:)
      integer :: n

      n = 0
      if (allocated(self%messages)) n = size(self%messages)
      if (n < self%n_rows) then
         allocate (longer(max(self%n_rows, 2*n)))
         if (n > 0) longer(:n) = self%messages
         call move_alloc(longer, self%messages)
      end if
      self%messages(self%n_rows)%value = message
   end subroutine add_message

   !> For each column whether a row has values, 0 or 1, and the lengths of its axes, slowest first.
   function column_table_sizes(self) result(sizes)
      class(column_table_t), intent(in) :: self
      integer, allocatable :: sizes(:, :)
      integer :: i, n

      allocate (sizes(1 + max_axes, self%n_columns), source=0)
      do i = 1, self%n_columns
         associate (column => self%columns(i))
            if (column%n_known == 0) cycle
            n = size(column%i_axis)
            sizes(1, i) = 1
            sizes(2:1 + n, i) = self%axes(column%i_axis(n:1:-1))%length
         end associate
      end do
   end function column_table_sizes

   !> Bytes that a column takes; 0 if no row has values.
   integer(int64) function column_table_bytes(self, i) result(bytes)
      class(column_table_t), intent(in) :: self
      integer, intent(in) :: i

      bytes = 0_int64
      associate (column => self%columns(i))
         if (column%n_known == 0) return
         bytes = merge(8_int64, 4_int64, column%kind == column_kind%real)*self%n_rows* &
                 product(int(self%axes(column%i_axis)%length, int64))
      end associate
   end function column_table_bytes

   !> Copies a column of reals with values into an array, rows slowest.
   subroutine column_table_copy_reals(self, i, values)
      class(column_table_t), intent(in) :: self
      integer, intent(in) :: i
      real(wp), intent(inout) :: values(:)
      integer :: e(max_axes), first, k, low, n, row, wide(max_axes), width

      associate (column => self%columns(i))
         wide = widest(self, column)
         n = product(wide)
         first = 0
         do row = 1, self%n_rows
            e = extents_of(column, row)
            low = (row - 1)*n
            if (any(e /= wide)) values(low + 1:low + n) = ieee_value(1.0_wp, ieee_quiet_nan)
            if (any(e == not_known)) cycle
            if (column%is_harmonic .and. any(e /= wide)) values(low + 1:low + n) = 0.0_wp
            width = e(1)
            do k = 0, product(e(2:)) - 1
               associate (at => low + position_of(k, e, wide), from => first + k*width)
                  values(at + 1:at + width) = column%reals(from + 1:from + width)
               end associate
            end do
            first = first + product(e)
         end do
      end associate
   end subroutine column_table_copy_reals

   !> Copies a column of integers likewise.
   subroutine column_table_copy_integers(self, i, values)
      class(column_table_t), intent(in) :: self
      integer, intent(in) :: i
      integer, intent(inout) :: values(:)
      integer :: e(max_axes), first, k, low, n, row, wide(max_axes), width

      associate (column => self%columns(i))
         wide = widest(self, column)
         n = product(wide)
         first = 0
         do row = 1, self%n_rows
            e = extents_of(column, row)
            low = (row - 1)*n
            if (any(e /= wide)) values(low + 1:low + n) = 0
            if (any(e == not_known)) cycle
            width = e(1)
            do k = 0, product(e(2:)) - 1
               associate (at => low + position_of(k, e, wide), from => first + k*width)
                  values(at + 1:at + width) = column%integers(from + 1:from + width)
               end associate
            end do
            first = first + product(e)
         end do
      end associate
   end subroutine column_table_copy_integers

   !> Lengths of the axes of a column over all rows, fastest first; 1 for those that it has not.
   pure function widest(self, column) result(wide)
      class(column_table_t), intent(in) :: self
      type(table_column_t), intent(in) :: column
      integer :: wide(max_axes)

      wide = 1
      wide(:size(column%i_axis)) = self%axes(column%i_axis)%length
   end function widest

   !> The same lengths in a row; `not_known` where it has no values.
   pure function extents_of(column, row) result(e)
      type(table_column_t), intent(in) :: column
      integer, intent(in) :: row
      integer :: e(max_axes)

      e = not_known
      if (row > column%n_rows) return
      e = 1
      e(:size(column%extents, 1)) = column%extents(:, row)
   end function extents_of

   !> What is before the values along the fastest axis in a row, for the others counted by `k`.
   pure integer function position_of(k, e, wide) result(position)
      integer, intent(in) :: k
      integer, intent(in) :: e(:), wide(:)

      position = wide(1)*(mod(k, e(2)) + wide(2)*(mod(k/e(2), e(3)) + wide(3)*(k/(e(2)*e(3)))))
   end function position_of

   !> The message of a row; empty if it has none.
   subroutine column_table_get_message(self, row, text)
      class(column_table_t), intent(in) :: self
      integer, intent(in) :: row
      character(:), allocatable, intent(out) :: text

      text = ""
      if (.not. allocated(self%messages)) return
      if (row > size(self%messages)) return
      if (allocated(self%messages(row)%value)) text = self%messages(row)%value
   end subroutine column_table_get_message

   !> Labels along an axis, one per line; empty for an axis without labels.
   subroutine column_table_get_labels(self, axis, text)
      class(column_table_t), intent(in) :: self
      character(*), intent(in) :: axis
      character(:), allocatable, intent(out) :: text
      integer :: i, k

      text = ""
      i = self%find_axis(axis)
      if (i == 0) return
      if (.not. allocated(self%axes(i)%labels)) return
      do k = 1, size(self%axes(i)%labels)
         if (k > 1) text = text//new_line("a")
         text = text//trim(self%axes(i)%labels(k))
      end do
   end subroutine column_table_get_labels

   !> Number of an axis; 0: there is none of this name.
   integer function column_table_find_axis(self, name) result(i)
      class(column_table_t), intent(in) :: self
      character(*), intent(in) :: name

      if (allocated(self%axes)) then
         do i = 1, size(self%axes)
            if (self%axes(i)%name == name) return
         end do
      end if
      i = 0
   end function column_table_find_axis

   ! The visitor

   !> Finds or declares the column that is visited, and gives the rows without it that they have no values.
   subroutine visit(self, name, given, axes, long_name, kind)
      class(column_table_t), intent(inout) :: self
      character(*), intent(in) :: name, given, axes, long_name
      integer, intent(in) :: kind
      integer :: i

      self%i_last = 0
      i = self%i_next
      if (i <= self%n_columns) then
         if (self%columns(i)%name /= name) i = 0
      else
         i = 0
      end if
      if (i == 0) then
         do i = 1, self%n_columns
            if (self%columns(i)%name == name) exit
         end do
      end if
      if (i > self%n_columns) call declare(self, name, given, axes, long_name, kind)
      self%i_next = i + 1
      associate (column => self%columns(i))
         do while (column%n_rows < self%n_rows - 1)
            call add_unknown(column)
         end do
      end associate
   end subroutine visit

   subroutine declare(self, name, given, axes, long_name, kind)
      class(column_table_t), intent(inout) :: self
      character(*), intent(in) :: name, given, axes, long_name
      integer, intent(in) :: kind
      type(table_column_t), allocatable :: longer(:)
      type(table_axis_t), allocatable :: longer_axes(:)
      type(string_t), allocatable :: names(:)
      integer :: i

      if (self%n_columns == size(self%columns)) then
         allocate (longer(2*self%n_columns))
         longer(:self%n_columns) = self%columns
         call move_alloc(longer, self%columns)
      end if
      if (self%n_columns > 0 .and. self%n_rows > 1) self%declaration = self%declaration + 1
      self%n_columns = self%n_columns + 1
      self%i_last = self%n_columns
      call split(axes, " ", names)
      associate (column => self%columns(self%n_columns))
         column%name = name
         column%axes = axes
         column%long_name = long_name
         column%kind = kind
         column%flags = ""
         column%attributes = ""
         call self%units_along(axes, given, column%units, column%dof_units)
         if (len(axes) == 0) deallocate (names)
         if (len(axes) == 0) allocate (names(0))
         column%i_axis = [(axis_of(names(i)%value), i=size(names), 1, -1)]
         column%is_harmonic = index(" "//axes//" ", " harmonic ") > 0
         allocate (column%extents(max(size(names), 1), 1))
         if (kind == column_kind%real) allocate (column%reals(1))
         if (kind == column_kind%integer) allocate (column%integers(1))
      end associate

   contains

      integer function axis_of(name) result(i)
         character(*), intent(in) :: name

         i = self%find_axis(name)
         if (i > 0) return
         allocate (longer_axes(size(self%axes) + 1))
         longer_axes(:size(self%axes)) = self%axes
         call move_alloc(longer_axes, self%axes)
         i = size(self%axes)
         self%axes(i)%name = name
      end function axis_of
   end subroutine declare

   subroutine add_unknown(column)
      type(table_column_t), intent(inout) :: column

      call add_row(column)
      column%extents(:, column%n_rows) = not_known
   end subroutine add_unknown

   !> Makes room for the extents of a further row.
   subroutine add_row(column)
      type(table_column_t), intent(inout) :: column
      integer, allocatable :: longer(:, :)

      column%n_rows = column%n_rows + 1
      if (column%n_rows <= size(column%extents, 2)) return
      allocate (longer(size(column%extents, 1), 2*column%n_rows))
      longer(:, :column%n_rows - 1) = column%extents(:, :column%n_rows - 1)
      call move_alloc(longer, column%extents)
   end subroutine add_row

   !> Adds the extents of a row with values, and makes room for these behind `first`.
   subroutine add_extents(self, column, extents, first)
      class(column_table_t), intent(inout) :: self
      type(table_column_t), intent(inout) :: column
      integer, intent(in) :: extents(:)                               !! fastest first
      integer, intent(out) :: first
      real(wp), allocatable :: reals(:)
      integer, allocatable :: integers(:)
      integer :: i, n

      call add_row(column)
      column%n_known = column%n_known + 1
      column%extents(:, column%n_rows) = 1
      column%extents(:size(extents), column%n_rows) = extents
      do i = 1, size(extents)
         self%axes(column%i_axis(i))%length = max(self%axes(column%i_axis(i))%length, extents(i))
      end do
      first = column%n_values
      n = first + product(extents)
      column%n_values = n
      if (allocated(column%reals)) then
         if (n > size(column%reals)) then
            allocate (reals(max(n, merge(2*n, n, column%n_rows > 1))))
            reals(:first) = column%reals(:first)
            call move_alloc(reals, column%reals)
         end if
      else if (n > size(column%integers)) then
         allocate (integers(max(n, merge(2*n, n, column%n_rows > 1))))
         integers(:first) = column%integers(:first)
         call move_alloc(integers, column%integers)
      end if
   end subroutine add_extents

   !> An attribute of the column that was visited last, if it is new.
   subroutine column_table_attribute(self, name, text)
      class(column_table_t), intent(inout) :: self
      character(*), intent(in) :: name, text

      if (self%i_last == 0) return
      associate (column => self%columns(self%i_last))
         column%attributes = column%attributes//name//" = "//text//new_line("a")
      end associate
   end subroutine column_table_attribute

   subroutine column_table_integer(self, name, units, axes, long_name, values, flags, lowest)
      class(column_table_t), intent(inout) :: self
      character(*), intent(in) :: name, units, axes, long_name
      integer, intent(in), contiguous, optional :: values(..)
      character(*), intent(in), optional :: flags(:)
      integer, intent(in), optional :: lowest
      integer :: first, i, n

      if (.not. self%is_there) return
      call visit(self, name, units, axes, long_name, column_kind%integer)
      i = self%i_next - 1
      if (self%i_last > 0) then
         if (present(flags)) self%columns(i)%flags = trim(join(flags, " "))
         if (present(lowest)) self%columns(i)%lowest_flag = lowest
      end if
      if (.not. (self%is_known .and. present(values))) then
         call add_unknown(self%columns(i))
         return
      end if
      call add_extents(self, self%columns(i), shape(values), first)
      n = self%columns(i)%n_values
      select rank (values)
      rank (0); self%columns(i)%integers(n) = values
      rank (1); self%columns(i)%integers(first + 1:n) = values
      rank (2); self%columns(i)%integers(first + 1:n) = reshape(values, [size(values)])
      end select
   end subroutine column_table_integer

   subroutine column_table_real(self, name, units, axes, long_name, values)
      class(column_table_t), intent(inout) :: self
      character(*), intent(in) :: name, units, axes, long_name
      real(wp), intent(in), contiguous, optional :: values(..)
      integer :: first, i, n

      if (.not. self%is_there) return
      call visit(self, name, units, axes, long_name, column_kind%real)
      i = self%i_next - 1
      if (.not. (self%is_known .and. present(values))) then
         call add_unknown(self%columns(i))
         return
      end if
      call add_extents(self, self%columns(i), shape(values), first)
      n = self%columns(i)%n_values
      select rank (values)
      rank (0); self%columns(i)%reals(n) = values
      rank (1); self%columns(i)%reals(first + 1:n) = values
      rank (2); self%columns(i)%reals(first + 1:n) = reshape(values, [size(values)])
      rank (3); self%columns(i)%reals(first + 1:n) = reshape(values, [size(values)])
      rank (4); self%columns(i)%reals(first + 1:n) = reshape(values, [size(values)])
      end select
   end subroutine column_table_real

   !> Texts are no columns of the table: `messages` has the only one.
   subroutine column_table_text(self, name, units, axes, long_name, value)
      class(column_table_t), intent(inout) :: self
      character(*), intent(in) :: name, units, axes, long_name
      character(*), intent(in), optional :: value

      self%i_last = 0
   end subroutine column_table_text
end module hb_column_table
