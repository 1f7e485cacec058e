!> Model files (HDF5, docs/user/model.md): read whole, once, and refused with the name of the invalid entry.
module hb_fe_model_file
   use hb_error, only: annotate, error_t, fail
   use hb_fe_model, only: fe_model_source_t, fe_model_t, max_speeds
   use hb_file_location, only: check_source
   use hb_hdf5, only: h5_file_t, open_file
   use hb_kinds, only: wp
   use hb_operating_system, only: file_kind, kind_of_file
   use hb_sparse, only: new_sparse, sparse_t
   use hb_text, only: texts_t, to_text
   implicit none
   private
   public :: fe_model_file_t, is_model_file, read_model_file

   character(*), parameter :: format_name = "nhbm model"
   integer, parameter :: schema_version = 1

   !> Models from files.
   type, extends(fe_model_source_t) :: fe_model_file_t
   contains
      procedure :: fetch => fe_model_file_fetch
   end type fe_model_file_t

contains

   subroutine fe_model_file_fetch(self, name, fe_model, error)
      class(fe_model_file_t), intent(in) :: self
      character(*), intent(in) :: name                                !! path of the file
      type(fe_model_t), intent(out) :: fe_model
      type(error_t), allocatable, intent(out) :: error

      call read_model_file(name, fe_model, error)
   end subroutine fe_model_file_fetch

   !> Reads a model file. Fails if it is not a model file, or one of a later version, or if entries are missing, of a
   !> wrong size or not finite.
   subroutine read_model_file(path, fe_model, error)
      character(*), intent(in) :: path
      type(fe_model_t), intent(out) :: fe_model
      type(error_t), allocatable, intent(out) :: error
      type(h5_file_t) :: file
      type(error_t), allocatable :: ignored

      call check_source(path, error)
      if (allocated(error)) return
      call open_file(file, path, error)
      if (.not. allocated(error)) then
         call check_form(file, error)
         if (.not. allocated(error)) call read_parts(file, fe_model, error)
         call file%close(ignored)
      end if
      if (.not. allocated(error)) return
      if (index(error%message, path) == 0) call annotate(error, "file '"//path//"'")
   end subroutine read_model_file

   !> Whether a file is a model file; false if it cannot be opened as one.
   logical function is_model_file(path)
      character(*), intent(in) :: path
      type(h5_file_t) :: file
      type(error_t), allocatable :: error, ignored

      is_model_file = kind_of_file(path) == file_kind%regular         ! opening a pipe would wait for its writer
      if (.not. is_model_file) return
      call open_file(file, path, error)
      is_model_file = .not. allocated(error)
      if (is_model_file) then
         call check_form(file, error)
         is_model_file = .not. allocated(error)
         call file%close(ignored)
      end if
   end function is_model_file

   !> Refuses a file of another format.
   subroutine check_form(file, error)
      type(h5_file_t), intent(in) :: file
      type(error_t), allocatable, intent(out) :: error
      character(:), allocatable :: form
      integer :: version

      call file%get_attribute("format", form, error)
      if (allocated(error)) then
         call fail(error, "is not a model file: it has no attribute 'format' with the value '"//format_name//"'")
         return
      else if (form /= format_name) then
         call fail(error, "is not a model file: its attribute 'format' is '"//form//"', not '"//format_name//"'")
         return
      end if
      call file%get_attribute("schema_version", version, error)
      if (allocated(error)) return
      if (version /= schema_version) call fail(error, "has schema version "//to_text(version)//", this program reads "// &
                                               to_text(schema_version))
   end subroutine check_form

   subroutine read_parts(file, fe_model, error)
      type(h5_file_t), intent(in) :: file
      type(fe_model_t), intent(inout) :: fe_model
      type(error_t), allocatable, intent(out) :: error
      character(:), allocatable :: suffix
      real(wp), allocatable :: up_to(:)
      integer :: i

      call file%get("labels", fe_model%labels, error)
      if (allocated(error)) return
      fe_model%n_dofs = size(fe_model%labels)
      call file%get("units", fe_model%units, error)
      if (allocated(error)) return
      call check_size("units", size(fe_model%units), fe_model%n_dofs, error)
      if (allocated(error)) return
      call read_matrix(file, "mass", .true., fe_model%n_dofs, fe_model%mass, error)
      if (.not. allocated(error)) call read_matrix(file, "stiffness", .true., fe_model%n_dofs, fe_model%stiffness, error)
      if (.not. allocated(error)) call read_matrix(file, "damping", .false., fe_model%n_dofs, fe_model%damping, error)
      if (.not. allocated(error)) call read_matrix(file, "gyroscopic", .false., fe_model%n_dofs, fe_model%gyroscopic, error)
      if (.not. allocated(error)) call read_matrix(file, "structural", .false., fe_model%n_dofs, fe_model%structural, error)
      do i = 1, max_speeds
         suffix = ""
         if (i > 1) suffix = "_"//to_text(i)
         associate (terms => fe_model%speeds(i), n => fe_model%n_dofs)
            if (.not. allocated(error)) call read_matrix(file, "gyroscopic_by_speed"//suffix, .false., n, terms%gyroscopic, error)
            if (.not. allocated(error)) call read_matrix(file, "stiffness_by_speed"//suffix, .false., n, terms%stiffness, error)
            if (.not. allocated(error)) &
               call read_matrix(file, "stiffness_by_speed_squared"//suffix, .false., n, terms%stiffness_squared, error)
         end associate
      end do
      if (.not. allocated(error)) call read_sets(file, fe_model, error)
      if (.not. allocated(error)) call read_vectors(file, fe_model, error)
      if (allocated(error) .or. .not. file%has("up_to")) return
      call file%get("up_to", up_to, error)
      if (.not. allocated(error)) call check_size("up_to", size(up_to), 1, error)
      if (.not. allocated(error)) fe_model%up_to = up_to(1)
   end subroutine read_parts

   subroutine read_matrix(file, name, is_required, n_dofs, matrix, error)
      type(h5_file_t), intent(in) :: file
      character(*), intent(in) :: name
      logical, intent(in) :: is_required
      integer, intent(in) :: n_dofs
      type(sparse_t), intent(inout) :: matrix
      type(error_t), allocatable, intent(out) :: error
      integer, allocatable :: columns(:), starts(:)
      real(wp), allocatable :: values(:)

      if (.not. file%has(name)) then
         if (is_required) call fail(error, "has no matrix '"//name//"'")
         return
      end if
      call file%get(name//"/indptr", starts, error)
      call file%get(name//"/indices", columns, error)
      call file%get(name//"/data", values, error)
      if (allocated(error)) return
      if (size(starts) /= n_dofs + 1) then
         call fail(error, "matrix '"//name//"' has "//to_text(size(starts) - 1)//" rows, there are "//to_text(n_dofs)//" labels")
         return
      end if
      call new_sparse(matrix, n_dofs, starts, columns, values, error)
      call annotate(error, "matrix '"//name//"'")
   end subroutine read_matrix

   !> Reads the data of each degree of freedom, and the sets, if there are nodes.
   subroutine read_sets(file, fe_model, error)
      type(h5_file_t), intent(in) :: file
      type(fe_model_t), intent(inout) :: fe_model
      type(error_t), allocatable, intent(out) :: error
      type(texts_t) :: words
      real(wp), allocatable :: coordinates(:)
      integer, allocatable :: node_of(:), nodes(:), numbers(:), starts(:)
      integer :: i, n_nodes

      if (.not. file%has("sets")) return
      call file%get("nodes/number", numbers, error)
      call file%get("dofs/node", node_of, error)
      call file%get("dofs/direction", words%values, error)
      if (allocated(error)) return
      n_nodes = size(numbers)
      call check_size("dofs/node", size(node_of), fe_model%n_dofs, error)
      if (.not. allocated(error)) call check_size("dofs/direction", size(words%values), fe_model%n_dofs, error)
      if (allocated(error)) return
      if (any(node_of < -1 .or. node_of >= n_nodes)) then
         i = findloc(node_of < -1 .or. node_of >= n_nodes, .true., dim=1)
         call fail(error, "dofs/node("//to_text(i)//") is "//to_text(node_of(i))//", there are nodes 0 to "// &
                   to_text(n_nodes - 1)//", and -1 for none")
         return
      end if
      fe_model%sets%node_of = node_of + 1
      allocate (fe_model%sets%direction(size(words%values)))
      fe_model%sets%direction = words%values
      if (file%has("nodes/coordinates")) then
         call file%get("nodes/coordinates", coordinates, error, extents=[3, n_nodes])
         if (allocated(error)) return
         fe_model%sets%coordinates = reshape(coordinates, [3, n_nodes])
      end if
      call file%get("sets/names", words%values, error)
      call file%get("sets/indptr", starts, error)
      call file%get("sets/nodes", nodes, error)
      if (.not. allocated(error)) call check_ranges("sets", size(words%values), starts, size(nodes), error)
      if (allocated(error)) return
      do i = 1, size(words%values)
         call fe_model%sets%add(trim(words%values(i)), nodes(starts(i) + 1:starts(i + 1)), n_nodes, error)
         if (allocated(error)) return
      end do
   end subroutine read_sets

   subroutine read_vectors(file, fe_model, error)
      type(h5_file_t), intent(in) :: file
      type(fe_model_t), intent(inout) :: fe_model
      type(error_t), allocatable, intent(out) :: error
      type(texts_t) :: words
      integer, allocatable :: dofs(:), starts(:)
      real(wp), allocatable :: values(:)
      integer :: i

      if (.not. file%has("loads")) return
      call file%get("loads/names", words%values, error)
      call file%get("loads/indptr", starts, error)
      call file%get("loads/dofs", dofs, error)
      call file%get("loads/values", values, error)
      if (.not. allocated(error)) call check_ranges("loads", size(words%values), starts, size(dofs), error)
      if (.not. allocated(error)) call check_size("loads/values", size(values), size(dofs), error)
      if (allocated(error)) return
      do i = 1, size(words%values)
         associate (first => starts(i) + 1, last => starts(i + 1))
            call fe_model%vectors%add(trim(words%values(i)), dofs(first:last), values(first:last), fe_model%n_dofs, error)
         end associate
         if (allocated(error)) return
      end do
   end subroutine read_vectors

   subroutine check_size(name, n, n_expected, error)
      character(*), intent(in) :: name
      integer, intent(in) :: n, n_expected
      type(error_t), allocatable, intent(out) :: error

      if (n /= n_expected) call fail(error, "'"//name//"' has "//to_text(n)//" entries, expected "//to_text(n_expected))
   end subroutine check_size

   !> Refuses starts of ranges that do not cover `n_entries` contiguously.
   subroutine check_ranges(name, n_ranges, starts, n_entries, error)
      character(*), intent(in) :: name
      integer, intent(in) :: n_ranges, starts(:), n_entries
      type(error_t), allocatable, intent(out) :: error

      call check_size(name//"/indptr", size(starts), n_ranges + 1, error)
      if (allocated(error)) return
      if (starts(1) /= 0 .or. starts(n_ranges + 1) /= n_entries .or. any(starts(2:) < starts(:n_ranges))) &
         call fail(error, "'"//name//"/indptr' must rise from 0 to "//to_text(n_entries)//", the number of entries")
   end subroutine check_ranges
end module hb_fe_model_file
