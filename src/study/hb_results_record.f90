!> What a result file tells of its run: origin, input, and how each point ended. Read by one process; `resume` and
!> `info` start from it.
module hb_results_record
   use hb_error, only: annotate, error_t, fail
   use hb_hdf5, only: h5_dataset_t, h5_file_t, open_file
   use hb_kinds, only: wp
   use hb_outcome, only: is_solved, outcome
   use hb_results_file, only: schema_version
   use hb_system, only: exists
   use hb_text, only: split, string_t, to_text
   implicit none
   private
   public :: open_points, read_record, record_t

   type :: record_t
      character(:), allocatable :: title, program_version, git_commit, created_utc
      integer :: n_ranks = 0                            !! of the run that made the file
      integer :: n_points = 0
      character(:), allocatable :: input_name           !! name of the input file, for messages
      character(:), allocatable :: input_text           !! the input as given
      type(string_t), allocatable :: overrides(:)       !! path=value
      character(:), allocatable :: input_complete       !! the input after defaults
      integer, allocatable :: tuples(:, :)              !! (n_tones, n_harmonics)
      character(:), allocatable :: dofs(:), laws(:)     !! labels
      integer, allocatable :: status(:)                 !! (n_points), hb_outcome; as the next
      integer, allocatable :: rescue(:)
      integer, allocatable :: is_near_commensurate(:)
      real(wp), allocatable :: residual(:)
      real(wp), allocatable :: solve_seconds(:)         !! [s]; NaN for a point not solved, as the next
      real(wp), allocatable :: truncation(:), aliasing(:)
      real(wp), allocatable :: penetration(:)           !! [m]
   end type record_t

   !> Reads a dataset as a whole; does nothing once there is an error.
   interface read_all
      module procedure read_all_integers
      module procedure read_all_reals
      module procedure read_all_texts
   end interface read_all

contains

   !> Reads the file; it may be that of a run which is still going on.
   subroutine read_record(self, path, error)
      type(record_t), intent(out) :: self
      character(*), intent(in) :: path
      type(error_t), allocatable, intent(out) :: error
      type(h5_file_t) :: file
      type(error_t), allocatable :: error_in_close

      if (.not. exists(path)) then
         call fail(error, "result file '"//path//"' does not exist")
         return
      end if
      call open_file(file, path, error)
      if (.not. allocated(error)) call read_attributes(self, file, error)
      if (.not. allocated(error)) call read_datasets(self, file, error)
      call file%close(error_in_close)
      if (.not. allocated(error)) call move_alloc(error_in_close, error)
      call annotate(error, "'"//path//"' is no result file of this program")
   end subroutine read_record

   subroutine read_attributes(self, file, error)
      type(record_t), intent(inout) :: self
      type(h5_file_t), intent(in) :: file
      type(error_t), allocatable, intent(out) :: error
      integer :: version

      call file%get_attribute("schema_version", version, error)
      if (allocated(error)) return
      if (version /= schema_version) then
         call fail(error, "its schema version is "//to_text(version)//", this program knows "//to_text(schema_version))
         return
      end if
      call file%get_attribute("n_ranks", self%n_ranks, error)
      if (.not. allocated(error)) call file%get_attribute("title", self%title, error)
      if (.not. allocated(error)) call file%get_attribute("program_version", self%program_version, error)
      if (.not. allocated(error)) call file%get_attribute("git_commit", self%git_commit, error)
      if (.not. allocated(error)) call file%get_attribute("created_utc", self%created_utc, error)
   end subroutine read_attributes

   subroutine read_datasets(self, file, error)
      type(record_t), intent(inout) :: self
      type(h5_file_t), intent(in) :: file
      type(error_t), allocatable, intent(out) :: error
      type(h5_dataset_t) :: dataset
      character(:), allocatable :: texts(:)
      integer, allocatable :: extents(:)

      call read_all(file, "input_text", texts, error)
      if (allocated(error)) return
      self%input_text = texts(1)
      call file%open_dataset("input_text", dataset, error)
      if (.not. allocated(error)) call dataset%get_attribute("file_name", self%input_name, error)
      if (allocated(error)) return
      call read_all(file, "input_overrides", texts, error)
      if (allocated(error)) return
      call read_overrides(texts(1), self%overrides)
      call read_all(file, "input_complete", texts, error)
      if (allocated(error)) return
      self%input_complete = texts(1)
      call read_all(file, "dof", self%dofs, error)
      call read_all(file, "law", self%laws, error)
      call read_all(file, "status", self%status, error)
      call read_all(file, "rescue", self%rescue, error)
      call read_all(file, "is_near_commensurate", self%is_near_commensurate, error)
      call read_all(file, "residual", self%residual, error)
      call read_all(file, "solve_seconds", self%solve_seconds, error)
      call read_all(file, "truncation_estimate", self%truncation, error)
      call read_all(file, "aliasing_estimate", self%aliasing, error)
      call read_all(file, "penetration", self%penetration, error)
      if (allocated(error)) return
      self%n_points = size(self%status)
      call file%open_dataset("tuple", dataset, error)
      if (allocated(error)) return
      extents = dataset%get_extents()
      allocate (self%tuples(extents(1), extents(2)))
      call dataset%read(self%tuples, error)
   end subroutine read_datasets

   !> Gives the lines of a text that are not empty.
   pure subroutine read_overrides(text, overrides)
      character(*), intent(in) :: text
      type(string_t), allocatable, intent(out) :: overrides(:)
      type(string_t), allocatable :: lines(:)
      integer :: i, n

      call split(text, new_line("a"), lines)
      allocate (overrides(size(lines)))
      n = 0
      do i = 1, size(lines)
         if (len_trim(lines(i)%value) == 0) cycle
         n = n + 1
         overrides(n)%value = lines(i)%value
      end do
      overrides = overrides(:n)
   end subroutine read_overrides

   !> Gives the points, from 1, that a resumed run has to solve: those that are pending and, if `retries`, those whose
   !> solver has failed.
   pure function open_points(self, retries) result(points)
      type(record_t), intent(in) :: self
      logical, intent(in) :: retries
      integer, allocatable :: points(:)
      integer :: i

      points = pack([(i, i=1, self%n_points)], self%status == outcome%pending .or. &
         (retries .and. .not. is_solved(self%status)))
   end function open_points

   subroutine read_all_integers(file, name, values, error)
      type(h5_file_t), intent(in) :: file
      character(*), intent(in) :: name
      integer, allocatable, intent(out) :: values(:)
      type(error_t), allocatable, intent(inout) :: error
      type(h5_dataset_t) :: dataset

      if (.not. allocated(error)) call file%open_dataset(name, dataset, error)
      if (allocated(error)) return
      allocate (values(product(dataset%get_extents())))
      call dataset%read(values, error)
   end subroutine read_all_integers

   subroutine read_all_reals(file, name, values, error)
      type(h5_file_t), intent(in) :: file
      character(*), intent(in) :: name
      real(wp), allocatable, intent(out) :: values(:)
      type(error_t), allocatable, intent(inout) :: error
      type(h5_dataset_t) :: dataset

      if (.not. allocated(error)) call file%open_dataset(name, dataset, error)
      if (allocated(error)) return
      allocate (values(product(dataset%get_extents())))
      call dataset%read(values, error)
   end subroutine read_all_reals

   subroutine read_all_texts(file, name, values, error)
      type(h5_file_t), intent(in) :: file
      character(*), intent(in) :: name
      character(:), allocatable, intent(out) :: values(:)
      type(error_t), allocatable, intent(inout) :: error
      type(h5_dataset_t) :: dataset

      if (.not. allocated(error)) call file%open_dataset(name, dataset, error)
      if (.not. allocated(error)) call dataset%read(values, error)
   end subroutine read_all_texts
end module hb_results_record
