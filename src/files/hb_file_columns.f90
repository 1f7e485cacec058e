!> Dimensions of a file, and datasets along them by the names of these: what result files and records of time integration share.
module hb_file_columns
   use hb_error, only: error_t
   use hb_hdf5, only: h5_dataset_t, h5_file_t, is_integer, is_real
   use hb_kinds, only: wp
   use hb_motion_columns, only: columns_t, find_shared_unit
   use hb_text, only: split, string_t
   implicit none
   private
   public :: amplitude_convention, axis_t, file_columns_t

   character(*), parameter :: amplitude_convention = "x(t) = sum over harmonics h of "// &
      "[ cos_h cos(j_h . omega t) + sin_h sin(j_h . omega t) ], j_h = tuple[h, :]"

   !> A dimension of the file. Its entries are labels, or given values, else numbers from `first`.
   type :: axis_t
      character(:), allocatable :: name, long_name, units
      integer :: length = 0, first = 0
      character(64), allocatable :: labels(:)
      real(wp), allocatable :: values(:)
      character(16), allocatable :: dof_units(:)        ! of the degrees of freedom that the labels name
      type(h5_dataset_t) :: scale
   end type axis_t

   !> Columns of a file with its dimensions.
   type, abstract, extends(columns_t) :: file_columns_t
      type(axis_t), allocatable :: axes(:)
      integer :: row_axis = 0                           ! along which each column has its rows; 0: there are no rows
   contains
      procedure :: add_axis => file_columns_add_axis
      procedure :: axis_index => file_columns_axis_index
      procedure :: find_axes => file_columns_find_axes
      procedure :: find_units => file_columns_find_units
      procedure :: length_of => file_columns_length_of
      procedure :: write_scales => file_columns_write_scales
   end type file_columns_t

contains

   !> Adds a dimension without unit.
   pure subroutine file_columns_add_axis(self, name, length, long_name, labels, dof_units, first)
      class(file_columns_t), intent(inout) :: self
      character(*), intent(in) :: name, long_name
      integer, intent(in) :: length
      character(*), intent(in), optional :: labels(:), dof_units(:)
      integer, intent(in), optional :: first            !! number, default 0
      type(axis_t) :: axis

      axis%name = name
      axis%length = length
      axis%long_name = long_name
      axis%units = "1"
      if (present(labels)) axis%labels = [character(64) :: labels]
      if (present(dof_units)) axis%dof_units = [character(16) :: dof_units]
      if (present(first)) axis%first = first
      if (.not. allocated(self%axes)) allocate (self%axes(0))
      self%axes = [self%axes, axis]
   end subroutine file_columns_add_axis

   !> Gives the index of an axis, 0 where the file has none of the name.
   pure integer function file_columns_axis_index(self, name) result(i)
      class(file_columns_t), intent(in) :: self
      character(*), intent(in) :: name

      do i = size(self%axes), 1, -1
         if (self%axes(i)%name == name) return
      end do
   end function file_columns_axis_index

   !> Gives the length of an axis, 0 where the file has none of the name.
   pure integer function file_columns_length_of(self, axis) result(length)
      class(file_columns_t), intent(in) :: self
      character(*), intent(in) :: axis
      integer :: i

      i = self%axis_index(axis)
      length = 0
      if (i > 0) length = self%axes(i)%length
   end function file_columns_length_of

   !> Axes of a column whose shape names them, fastest first; that of the rows is the last.
   subroutine file_columns_find_axes(self, shape, axes)
      class(file_columns_t), intent(in) :: self
      character(*), intent(in) :: shape                 !! slowest first; `tau` stands for tau_1, tau_2, ...
      integer, allocatable, intent(out) :: axes(:)
      type(string_t), allocatable :: names(:)
      integer :: i, k

      allocate (axes(0))
      if (self%row_axis > 0) axes = [self%row_axis]
      call split(shape, " ", names)
      do i = 1, size(names)
         select case (names(i)%value)
         case ("")
         case ("tau")
            axes = [pack([(k, k=1, size(self%axes))], [(index(self%axes(k)%name, "tau_") == 1, k=1, size(self%axes))]), axes]
         case default
            axes = [self%axis_index(names(i)%value), axes]
         end select
      end do
   end subroutine file_columns_find_axes

   !> Unit of a column: the given one, or that which all degrees of freedom along it share; else the name of the attribute that
   !> lists theirs.
   pure subroutine file_columns_find_units(self, units, axes, shared, list)
      class(file_columns_t), intent(in) :: self
      character(*), intent(in) :: units                 !! of the table
      integer, intent(in) :: axes(:)
      character(:), allocatable, intent(out) :: shared
      character(:), allocatable, intent(out) :: list    !! with blanks between; not allocated for other columns
      character(16), allocatable :: of_dofs(:)
      integer :: i

      allocate (of_dofs(0))
      do i = 1, size(axes)
         if (allocated(self%axes(axes(i))%dof_units)) of_dofs = self%axes(axes(i))%dof_units
      end do
      call find_shared_unit(units, of_dofs, shared, list)
   end subroutine file_columns_find_units

   !> Makes the scales of all axes.
   subroutine file_columns_write_scales(self, file, error)
      class(file_columns_t), intent(inout) :: self
      type(h5_file_t), intent(in) :: file
      type(error_t), allocatable, intent(inout) :: error
      integer :: i, k

      do i = 1, size(self%axes)
         if (allocated(error)) return
         associate (axis => self%axes(i))
            if (allocated(axis%labels)) then
               call file%add_texts(axis%name, axis%labels, axis%scale, error)
            else
               call file%add(axis%name, merge(is_real, is_integer, allocated(axis%values)), [axis%length], axis%scale, error)
               if (axis%length > 0 .and. .not. allocated(error)) then
                  if (allocated(axis%values)) call axis%scale%write(axis%values, error)
                  if (.not. allocated(axis%values)) call axis%scale%write([(axis%first + k, k=0, axis%length - 1)], error)
               end if
            end if
            if (.not. allocated(error)) call axis%scale%make_scale(scale_name(axis), error)
            call axis%scale%describe(axis%units, axis%long_name, error)
         end associate
      end do
   end subroutine file_columns_write_scales

   !> Gives the name that a scale keeps in the file: its own, or the words of netCDF for a dimension without
   !> coordinate.
   function scale_name(axis) result(name)
      type(axis_t), intent(in) :: axis
      character(:), allocatable :: name
      character(64) :: words

      name = axis%name
      if (name /= "message_byte") return
      write (words, "(a, i10)") "This is a netCDF dimension but not a netCDF variable.", axis%length
      name = trim(words)
   end function scale_name
end module hb_file_columns
