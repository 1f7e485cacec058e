!> What the rungs of a benchmark are compared with, unless it is one of them: coefficients from the input or from a file.
module hb_benchmark_reference
   use, intrinsic :: ieee_arithmetic, only: ieee_is_nan, ieee_quiet_nan, ieee_value
   use hb_coefficient_set, only: coefficient_set_t, new_coefficient_set
   use hb_error, only: annotate, error_t, fail
   use hb_hdf5, only: h5_dataset_t, h5_file_t, open_file
   use hb_kinds, only: wp
   use hb_namelist, only: document_t, group_t
   use hb_outcome, only: is_solved, outcome_name
   use hb_harmonics, only: harmonics_t, new_harmonics, tuple_text
   use hb_system, only: exists
   use hb_text, only: join, to_text
   implicit none
   private
   public :: read_reference, read_reference_file

   real(wp), parameter :: same_frequency = 1.0e-9_wp                  ! relative difference of tones that count as equal

contains

   !> Reads the groups `&reference`: each has `dof`, `tuple`, `cos` and `sin` of one known coefficient.
   subroutine read_reference(self, document, n_tones, dofs, error)
      type(coefficient_set_t), intent(out) :: self
      type(document_t), intent(inout), target :: document
      integer, intent(in) :: n_tones
      character(*), intent(in) :: dofs(:)                             !! where the error is measured
      type(error_t), allocatable, intent(out) :: error
      type(group_t), pointer :: group
      type(harmonics_t) :: set
      character(:), allocatable :: name
      integer, allocatable :: tuple(:), tuples(:, :)
      real(wp), allocatable :: pairs(:, :), values(:, :, :)
      integer, allocatable :: dof_of(:)
      integer :: h, i, n

      n = document%count("reference")
      allocate (tuples(n_tones, n), dof_of(n), pairs(2, n))
      do i = 1, n
         group => document%group("reference", i)
         if (allocated(name)) deallocate (name)
         if (allocated(tuple)) deallocate (tuple)
         pairs(:, i) = 0.0_wp
         call group%require("dof", name)
         call group%require("tuple", tuple, n=n_tones)
         call group%require("cos", pairs(1, i))
         call group%get("sin", pairs(2, i))
         if (allocated(name)) then
            dof_of(i) = findloc(dofs == name, .true., dim=1)
            if (dof_of(i) == 0) call group%problem("dof", "'"//name//"' is not observed; observed: "//join(dofs, ", ")// &
                                                   "; others by &benchmark dofs")
         end if
         call group%finish(error)
         if (allocated(error)) return
         tuples(:, i) = tuple
      end do
      call keep_different(tuples)
      call new_harmonics(set, tuples, error)
      if (allocated(error)) return
      allocate (values(2, size(tuples, 2), size(dofs)), source=ieee_value(1.0_wp, ieee_quiet_nan))
      do i = 1, n
         group => document%group("reference", i)
         call group%get("tuple", tuple)
         h = column_of(tuples, tuple)
         if (.not. ieee_is_nan(values(1, h, dof_of(i)))) then
            call fail(error, group%place()//": the coefficient at "//tuple_text(tuple)//" of '"//trim(dofs(dof_of(i)))// &
                      "' is given twice (j and -j are the same)")
            return
         end if
         values(1, h, dof_of(i)) = pairs(1, i)
         values(2, h, dof_of(i)) = merge(1, -1, all(tuples(:, h) == tuple))*pairs(2, i)
      end do
      call new_coefficient_set(self, tuples, values, error)
   end subroutine read_reference

   !> Drops tuples that are there before, as they are or as their negatives.
   subroutine keep_different(tuples)
      integer, allocatable, intent(inout) :: tuples(:, :)
      integer :: i, n

      n = 0
      do i = 1, size(tuples, 2)
         if (column_of(tuples(:, :n), tuples(:, i)) > 0) cycle
         n = n + 1
         tuples(:, n) = tuples(:, i)
      end do
      tuples = tuples(:, :n)
   end subroutine keep_different

   !> Where j or -j stands, 0 where neither does.
   pure integer function column_of(tuples, j)
      integer, intent(in) :: tuples(:, :), j(:)

      do column_of = size(tuples, 2), 1, -1
         if (all(tuples(:, column_of) == j) .or. all(tuples(:, column_of) == -j)) return
      end do
   end function column_of

   !> Reads `tuple` (harmonic, tone) and `coefficients` ([point,] dof, harmonic, component) with the labels `dof` of a file
   !> such as `nhbm solve` writes; docs/user/schema.md. `frequency` and `status` are looked at where the file has them.
   subroutine read_reference_file(self, path, point, omega, dofs, error)
      type(coefficient_set_t), intent(out) :: self
      character(*), intent(in) :: path
      integer, intent(in) :: point                                    !! from 0; -1: the only one
      real(wp), intent(in) :: omega(:)                                !! base frequencies of the benchmark [rad/s]
      character(*), intent(in) :: dofs(:)                             !! where the error is measured
      type(error_t), allocatable, intent(out) :: error
      type(h5_file_t) :: file
      type(error_t), allocatable :: ignored

      if (.not. exists(path)) then
         call fail(error, "no such file")
      else
         call open_file(file, path, error)
         if (.not. allocated(error)) call read_coefficients(self, file, point, omega, dofs, error)
         call file%close(ignored)
      end if
      call annotate(error, "reference file '"//path//"'")
   end subroutine read_reference_file

   subroutine read_coefficients(self, file, point, omega, dofs, error)
      type(coefficient_set_t), intent(out) :: self
      type(h5_file_t), intent(in) :: file
      integer, intent(in) :: point
      real(wp), intent(in) :: omega(:)
      character(*), intent(in) :: dofs(:)
      type(error_t), allocatable, intent(out) :: error
      type(h5_dataset_t) :: dataset
      character(:), allocatable :: labels(:)
      integer, allocatable :: extents(:), tuples(:, :)
      real(wp), allocatable :: all_values(:, :, :, :), values(:, :, :)
      integer :: chosen, i, k

      call file%open_dataset("tuple", dataset, error)
      if (allocated(error)) return
      extents = dataset%get_extents()
      if (size(extents) /= 2) extents = [0, 0]
      if (extents(1) /= size(omega) .or. extents(2) < 1) then
         call fail(error, "'tuple' is not (harmonic, tone) with "//to_text(size(omega))//" tones")
         return
      end if
      allocate (tuples(extents(1), extents(2)))
      call dataset%read(tuples, error)
      if (.not. allocated(error)) call file%open_dataset("dof", dataset, error)
      if (.not. allocated(error)) call dataset%read(labels, error)
      if (.not. allocated(error)) call file%open_dataset("coefficients", dataset, error)
      if (allocated(error)) return
      extents = dataset%get_extents()
      if (size(extents) == 3) extents = [extents, 1]
      if (size(extents) /= 4) extents = [0, 0, 0, 0]
      if (any(extents(1:3) /= [2, size(tuples, 2), size(labels)]) .or. extents(4) < 1) then
         call fail(error, "'coefficients' is not ([point,] dof, harmonic, component)")
         return
      end if
      if (point < 0 .and. extents(4) > 1) then
         call fail(error, "has "//to_text(extents(4))//" points; choose one by 'reference_point', from 0")
      else if (point >= extents(4)) then
         call fail(error, "has no point "//to_text(point)//"; points: 0 to "//to_text(extents(4) - 1))
      end if
      if (allocated(error)) return
      chosen = max(0, point) + 1
      call check_point(file, chosen, omega, error)
      if (allocated(error)) return
      allocate (all_values(2, extents(2), extents(3), extents(4)))
      call dataset%read(all_values, error)
      if (allocated(error)) return
      allocate (values(2, extents(2), size(dofs)))
      do i = 1, size(dofs)
         k = findloc(labels == dofs(i), .true., dim=1)
         if (k == 0) then
            call fail(error, "has no degree of freedom '"//trim(dofs(i))//"'; it has "//join(labels, ", "))
            return
         end if
         values(:, :, i) = all_values(:, :, k, chosen)
      end do
      call new_coefficient_set(self, tuples, values, error)
   end subroutine read_coefficients

   !> Refuses a point that is not solved or has other base frequencies; a file that does not tell is taken at its word.
   subroutine check_point(file, point, omega, error)
      type(h5_file_t), intent(in) :: file
      integer, intent(in) :: point                                    !! from 1
      real(wp), intent(in) :: omega(:)
      type(error_t), allocatable, intent(out) :: error
      type(error_t), allocatable :: absent
      type(h5_dataset_t) :: dataset
      integer, allocatable :: extents(:), status(:)
      real(wp), allocatable :: frequency(:)

      call file%open_dataset("status", dataset, absent)
      if (.not. allocated(absent)) then
         extents = dataset%get_extents()
         allocate (status(product(extents)))
         if (size(extents) == 1 .and. size(status) >= point) then
            call dataset%read(status, error)
            if (allocated(error)) return
            if (.not. is_solved(status(point))) then
               call fail(error, "point "//to_text(point - 1)//" is not solved ("//outcome_name(status(point))//")")
               return
            end if
         end if
      end if
      call file%open_dataset("frequency", dataset, absent)
      if (allocated(absent)) return
      extents = dataset%get_extents()
      allocate (frequency(product(extents)))
      if (size(frequency) < point*size(omega)) return
      call dataset%read(frequency, error)
      if (allocated(error)) return
      frequency = frequency((point - 1)*size(omega) + 1:point*size(omega))
      if (any(abs(frequency - omega) > same_frequency*abs(omega))) call fail(error, "is about other base frequencies: "// &
         to_text(frequency(1))//" rad/s of the first tone, here "//to_text(omega(1))//" rad/s")
   end subroutine check_point
end module hb_benchmark_reference
