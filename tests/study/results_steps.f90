!> What the tests of the result file share: a small layout, points whose numbers tell where they belong, and reading back
!> through hb_hdf5. The file stands in the working directory; each test removes it.
module results_steps
   use hb_error, only: error_t
   use hb_hdf5, only: h5_dataset_t, h5_file_t, is_characters, open_file
   use hb_kinds, only: wp
   use hb_motion_result, only: motion_result_t
   use hb_mpi, only: barrier, comm_t, rank_of, size_of
   use hb_outcome, only: outcome
   use hb_result_columns, only: message_length
   use hb_results, only: create_results, results_t
   use hb_results_layout, only: results_layout_t
   implicit none
   private
   public :: attribute_of, integers_of, numbered_point, numbers, read_reals, read_texts, remove, small_layout, write_file
   public :: exact, n_dofs, n_harmonics, n_law_dofs, n_points, n_tones, path

   character(*), parameter :: path = "test_hb_results.h5"
   integer, parameter :: n_points = 5, n_tones = 2, n_harmonics = 3, n_dofs = 2, n_law_dofs = 1
   real(wp), parameter :: exact = 0.0_wp               !! numbers are stored as they are

contains

   !> Two tones, three harmonics, two stored degrees of freedom and one with a law; no surfaces.
   function small_layout() result(layout)
      type(results_layout_t) :: layout
      integer :: i

      layout%n_points = n_points
      layout%tuples = reshape([0, 0, 1, 0, 1, -2], [n_tones, n_harmonics])
      layout%dof_labels = [character(16) :: "v1", "theta3"]
      layout%dof_units = [character(16) :: "m", "rad"]
      layout%law_dof_labels = [character(16) :: "v1"]
      layout%law_labels = [character(64) :: "wall"]
      allocate (layout%output_names(0), layout%gradient_names(0))
      layout%law_dof_units = [character(16) :: "m"]
      layout%n_samples = [integer ::]
      layout%title = "two words"
      layout%input_name = "small.nml"
      layout%input_text = "&tones"//new_line("a")//"/"
      layout%input_overrides = "a%b=1"//new_line("a")//"c%d='x y'"
      layout%input_complete = "&tones /"
      layout%n_ranks = 7
      layout%program_version = "1.2.3"
      layout%git_commit = "abc"
      allocate (layout%parameters(1))
      layout%parameters(1)%path = "law(1)%gap"
      layout%parameters(1)%units = "m"
      layout%parameters(1)%values = [(0.5_wp*i, i=1, n_points)]
   end function small_layout

   !> A point whose numbers tell its index, the dataset and the position in it.
   function numbered_point(i) result(point)
      integer, intent(in) :: i
      type(motion_result_t) :: point

      point%status = outcome%converged
      point%iterations = i
      point%evaluations = 10*i
      point%residual = 1.0e-9_wp*i
      point%solve_seconds = 0.1_wp*i
      point%rank = i - 1
      point%n_harmonics = 2
      point%frequency = [1.0_wp*i, 2.0_wp*i]
      point%coefficients = reshape(numbers(i, 2*n_harmonics*n_dofs), [2, n_harmonics, n_dofs])
      point%force_coefficients = reshape(numbers(-i, 2*n_harmonics*n_law_dofs), [2, n_harmonics, n_law_dofs])
      point%corrected_coefficients = 2*point%force_coefficients
      point%error_estimate%defects%penetration = 0.25_wp*i
      point%error_estimate%combination = [7, -11]
      point%error_estimate%power_laws = [0.125_wp*i]
   end function numbered_point

   pure function numbers(first, n)
      integer, intent(in) :: first, n
      real(wp) :: numbers(n)
      integer :: k

      numbers = [(first + 0.001_wp*k, k=1, n)]
   end function numbers

   subroutine remove(comm, file_path)
      type(comm_t), intent(in) :: comm
      character(*), intent(in) :: file_path
      integer :: unit, status

      call barrier(comm)
      if (rank_of(comm) == 0) then
         open (newunit=unit, file=file_path, status="old", iostat=status)
         if (status == 0) close (unit, status="delete", iostat=status)
      end if
      call barrier(comm)
   end subroutine remove

   !> Makes the file, lets the ranks write the points in turn, closes; the first error ends it.
   subroutine write_file(comm, layout, points, error)
      type(comm_t), intent(in) :: comm
      type(results_layout_t), intent(in) :: layout
      type(motion_result_t), intent(in) :: points(:)
      type(error_t), allocatable, intent(out) :: error
      type(error_t), allocatable :: error_in_close
      type(results_t) :: results
      integer :: i

      call create_results(results, path, layout, .true., comm, error)
      if (allocated(error)) return
      do i = 1 + rank_of(comm), size(points), size_of(comm)
         call results%write_point(i, points(i), error)
         if (allocated(error)) exit
      end do
      call results%close(error_in_close)
      if (.not. allocated(error)) call move_alloc(error_in_close, error)
   end subroutine write_file

   !> Reads a dataset of real numbers as one vector in the order of Fortran.
   subroutine read_reals(name, values, extents)
      character(*), intent(in) :: name
      real(wp), allocatable, intent(out) :: values(:)
      integer, allocatable, intent(out) :: extents(:)
      type(h5_file_t) :: file
      type(h5_dataset_t) :: dataset
      type(error_t), allocatable :: error

      extents = [-1]
      allocate (values(0))
      call open_file(file, path, error)
      if (.not. allocated(error)) call file%open_dataset(name, dataset, error)
      if (.not. allocated(error)) then
         extents = dataset%get_extents()
         deallocate (values)
         allocate (values(product(extents)))
         call dataset%read(values, error)
      end if
      call file%close(error)
   end subroutine read_reals

   function integers_of(name) result(values)
      character(*), intent(in) :: name
      integer, allocatable :: values(:)
      type(h5_file_t) :: file
      type(h5_dataset_t) :: dataset
      type(error_t), allocatable :: error

      values = [-huge(1)]
      call open_file(file, path, error)
      if (.not. allocated(error)) call file%open_dataset(name, dataset, error)
      if (.not. allocated(error)) then
         deallocate (values)
         allocate (values(product(dataset%get_extents())))
         call dataset%read(values, error)
      end if
      call file%close(error)
   end function integers_of

   subroutine read_texts(name, values)
      character(*), intent(in) :: name
      character(:), allocatable, intent(out) :: values(:)
      type(h5_file_t) :: file
      type(h5_dataset_t) :: dataset
      type(error_t), allocatable :: error
      character(:), allocatable :: text
      integer :: i

      call open_file(file, path, error)
      if (.not. allocated(error)) call file%open_dataset(name, dataset, error)
      if (.not. allocated(error) .and. dataset%kind == is_characters) then
         values = [character(message_length) ::]
         do i = 1, n_points
            call dataset%read_text_row(i, text, error)
            values = [character(message_length) :: values, text]
         end do
      else if (.not. allocated(error)) then
         call dataset%read(values, error)
      end if
      if (.not. allocated(values)) values = ["(not read)"]
      call file%close(error)
   end subroutine read_texts

   !> Gives a text attribute of a dataset, or of the file for an empty name.
   function attribute_of(name, attribute) result(value)
      character(*), intent(in) :: name, attribute
      character(:), allocatable :: value
      type(h5_file_t) :: file
      type(h5_dataset_t) :: dataset
      type(error_t), allocatable :: error

      call open_file(file, path, error)
      if (.not. allocated(error)) then
         if (name == "") then
            call file%get_attribute(attribute, value, error)
         else
            call file%open_dataset(name, dataset, error)
            if (.not. allocated(error)) call dataset%get_attribute(attribute, value, error)
         end if
      end if
      if (.not. allocated(value)) value = "(not read)"
      call file%close(error)
   end function attribute_of
end module results_steps
